//! `POST /swarm/act?wait=`: acts, and what their seats see next, in one request.

use std::time::Duration;

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench_testkit::needs;

use super::{agents, look};
use crate::across::memory::until_in_memory;
use crate::across::vectors;
use crate::app::{
    Call, Episode, HttpAnswer, TestApp, check_problem, game, list, number, texts, until,
};
use crate::cup::{Attempt, Cup, server};

/// Sends acts with a token.
fn call(app: &TestApp, token: &str, query: &str, acts: &[Value]) -> Call {
    app.post(&format!("/swarm/act{query}")).token(token).json(&json!({ "acts": acts }))
}

async fn step(app: &TestApp, episode: &Episode, query: &str, acts: &[Value]) -> Value {
    call(app, &episode.swarm, query, acts).ok().await
}

/// These agents stay.
fn stay(episode: &Episode, round: u64, agents: &[u32]) -> Vec<Value> {
    let act = |agent: &u32| episode.act(&json!(format!("Agent_{agent}")), round, "STAY");
    agents.iter().map(act).collect()
}

fn seen(answer: &Value) -> Vec<Value> {
    list(&answer["observations"])
}

fn members(answer: &Value) -> Vec<&str> {
    answer.as_object().expect("an object").keys().map(String::as_str).collect()
}

/// Two of three seats, which somebody else holds, with a token for them.
async fn claimed(app: &TestApp) -> (Episode, String) {
    let mut request = game(3, 3);
    request["open_seats"] = json!(2);
    let episode = app.create(request).await;
    let claim = app.post(&episode.path("/claims")).json(&json!({ "seats": 2 })).ok().await;
    (episode, claim["swarm_token"].as_str().expect("a token").to_owned())
}

#[tokio::test]
async fn a_step_is_one_request() {
    let app = TestApp::start().await;
    let episode = app.create(game(3, 2)).await;
    let without = step(&app, &episode, "", &stay(&episode, 0, &[0])).await;
    assert_eq!(members(&without), ["receipts"]);
    let answer = step(&app, &episode, "?wait=60", &stay(&episode, 0, &[2, 1])).await;
    assert_eq!(members(&answer), ["finished", "observations", "receipts"]);
    assert_eq!(texts(&list(&answer["receipts"]), "agent"), ["Agent_2", "Agent_1"]);
    // In the order of the acts, and nobody's who did not act in this request.
    let shown = [app.obs(episode.seat(2)).await, app.obs(episode.seat(1)).await];
    assert_eq!((seen(&answer), number(&shown[0]["round"])), (shown.to_vec(), 1));
    assert_eq!(answer["finished"], false);

    // The last round is followed by the end.
    let answer = step(&app, &episode, "?wait=60", &stay(&episode, 1, &[0, 1, 2])).await;
    assert_eq!(answer["finished"], true);
    let mut shown = Vec::new();
    for token in episode.seats() {
        shown.push(app.obs(token).await);
    }
    assert_eq!(seen(&answer), shown);
    assert_eq!(
        (&shown[0]["status"], number(&shown[0]["result"]["rounds"])),
        (&json!("finished"), 2)
    );
}

#[tokio::test]
async fn it_waits_for_the_acts_of_others() {
    let app = TestApp::with_manual_clock().await;
    let (episode, claim) = claimed(&app).await;
    let (own, others) = (stay(&episode, 0, &[0]), stay(&episode, 0, &[1, 2]));
    let (own, others) = tokio::join!(
        call(&app, &episode.swarm, "?wait=60", &own).ok(),
        call(&app, &claim, "?wait=60", &others).ok(),
    );
    for (answer, expected) in [(own, vec!["Agent_0"]), (others, vec!["Agent_1", "Agent_2"])] {
        assert_eq!(agents(&answer), expected);
        assert!(seen(&answer).iter().all(|seen| seen["round"] == 1), "{answer}");
    }
    // One that an act for another's seat is refused to waits all the same.
    let (own, others) = (stay(&episode, 1, &[0, 2]), stay(&episode, 1, &[1, 2]));
    let (own, _) = tokio::join!(
        call(&app, &episode.swarm, "?wait=60", &own).ok(),
        call(&app, &claim, "", &others).ok(),
    );
    check_problem(&own["receipts"][1], 403, "forbidden");
    assert_eq!(
        (agents(&own), &own["observations"][0]["round"]),
        (vec!["Agent_0".into()], &json!(2))
    );
}

#[tokio::test]
async fn when_the_time_is_up_the_receipts_come_alone() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(game(2, 2)).await;
    let sent = call(&app, &episode.swarm, "?wait=20", &stay(&episode, 0, &[0]));
    let answer = app.pass_until(tokio::spawn(sent.ok())).await;
    assert_eq!((number(&answer["receipts"][0]["waiting_for"]), seen(&answer)), (1, vec![]));
    assert_eq!((&answer["finished"], answer.get("problem")), (&json!(false), None));
    let at_once = step(&app, &episode, "?wait=0", &stay(&episode, 0, &[0])).await;
    assert_eq!((&at_once["receipts"][0]["duplicate"], seen(&at_once)), (&json!(true), vec![]));
    let nothing = step(&app, &episode, "?wait=60", &[]).await;
    assert_eq!(nothing, json!({ "receipts": [], "observations": [], "finished": false }));
}

/// The clock stands still, so a wait would not end.
#[rstest]
#[case::action(json!({ "action": "JUMP" }), 422)]
#[case::unknown_field(json!({ "speed": 2 }), 422)]
#[case::no_round(json!({ "round": null }), 422)]
#[case::round_ahead(json!({ "round": 1 }), 409)]
#[case::too_large(json!({ "reasoning": "x".repeat(256 * 1024) }), 413)]
#[tokio::test]
async fn what_is_refused_and_still_needed_is_not_waited_for(
    #[case] change: Value,
    #[case] status: u16,
) {
    let app = TestApp::with_manual_clock().await;
    let (episode, other) = (app.create(game(2, 2)).await, app.create(game(2, 2)).await);
    let mut acts = stay(&episode, 0, &[1, 0]);
    for (field, value) in change.as_object().expect("an object") {
        acts[0][field] = value.clone();
    }
    acts.extend(stay(&other, 0, &[0]));
    let answer = step(&app, &episode, "?wait=60", &acts).await;
    assert_eq!(answer["receipts"][0]["status"], status);
    assert_eq!(answer["receipts"][1]["waiting_for"], 1);
    check_problem(&answer["receipts"][2], 404, "not_found");
    assert!(seen(&answer).is_empty());
    // A better one completes the round.
    let answer = step(&app, &episode, "?wait=60", &stay(&episode, 0, &[1, 0])).await;
    assert_eq!(texts(&seen(&answer), "agent"), ["Agent_1", "Agent_0"]);
}

#[tokio::test]
async fn what_is_refused_and_not_needed_is_waited_for() {
    let app = TestApp::with_manual_clock().await;
    let (episode, claim) = claimed(&app).await;
    call(&app, &claim, "", &stay(&episode, 0, &[1])).ok().await;
    let other = [episode.act(&json!("Agent_1"), 0, "UP"), stay(&episode, 0, &[2]).remove(0)];
    let own = stay(&episode, 0, &[0]);
    let (answer, _) = tokio::join!(
        call(&app, &claim, "?wait=60", &other).ok(),
        call(&app, &episode.swarm, "", &own).ok(),
    );
    check_problem(&answer["receipts"][0], 409, "already_acted");
    assert_eq!(
        (agents(&answer), &answer["observations"][0]["round"]),
        (vec!["Agent_2".into()], &json!(1))
    );
}

#[tokio::test]
async fn the_same_acts_again_bring_the_observations_that_were_lost() {
    let mut app = TestApp::with_manual_clock().await;
    let episode = app.create(game(2, 3)).await;
    let acts = stay(&episode, 0, &[0, 1]);
    let first = step(&app, &episode, "?wait=60", &acts).await;
    for lost in ["in memory", "evicted", "restarted"] {
        match lost {
            "evicted" => until_in_memory(&app, 0).await,
            "restarted" => app.restart().await,
            _ => {}
        }
        let again = step(&app, &episode, "?wait=60", &acts).await;
        assert_eq!(again["observations"], first["observations"], "{lost}");
        assert!(list(&again["receipts"]).iter().all(|receipt| receipt["duplicate"] == true));
    }
    // Later they are those of that moment, also after the end.
    for (round, status) in [(1, "running"), (2, "finished")] {
        app.all_act(&episode, "STAY").await;
        let again = step(&app, &episode, "?wait=60", &acts).await;
        for seen in seen(&again) {
            assert_eq!((number(&seen["round"]), &seen["status"]), (round + 1, &json!(status)));
        }
        assert_eq!(seen(&again).len(), 2);
    }
    let late = step(&app, &episode, "?wait=60", &stay(&episode, 3, &[0, 1])).await;
    check_problem(&late["receipts"][0], 409, "episode_over");
    assert_eq!((seen(&late), &late["finished"]), (vec![], &json!(true)));
}

#[tokio::test]
async fn an_escaped_agent_is_seen_once_more() {
    let app = TestApp::start().await;
    let (config, rounds) = vectors::recorded_transport();
    let episode = app.create(config).await;
    let mut escaped = 0;
    for (round, acts) in (0..).zip(&rounds) {
        let sent = vectors::acts(&episode, round, acts);
        let answer = step(&app, &episode, "?wait=60", &sent).await;
        assert_eq!(texts(&seen(&answer), "agent"), texts(&sent, "agent"));
        escaped += seen(&answer).iter().filter(|seen| seen["alive"] == false).count();
    }
    assert_eq!(escaped, rounds[0].len());
}

#[tokio::test]
async fn a_wait_ends_with_its_episode() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(game(2, 2)).await;
    let acts = stay(&episode, 0, &[0]);
    let abort = async {
        while app.obs(episode.seat(0)).await["acted"] == false {}
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    };
    let (answer, ()) = tokio::join!(step(&app, &episode, "?wait=60", &acts), abort);
    assert_eq!(answer["observations"], json!([app.obs(episode.seat(0)).await]));
    assert_eq!(
        (&answer["observations"][0]["status"], &answer["finished"]),
        (&json!("aborted"), &json!(true))
    );
}

/// A request of `Agent_0` that waits, on a server where one may.
async fn waiting(app: &TestApp, episode: &Episode) -> tokio::task::JoinHandle<HttpAnswer> {
    let acts = stay(episode, 0, &[0]);
    let ask = || tokio::spawn(call(app, &episode.swarm, "?wait=60", &acts).send());
    let mut waiting = ask();
    loop {
        // It gets a head start, as the other one is refused if it is first, and the other way round.
        for _ in 0..50 {
            app.get("/healthz").ok().await;
        }
        if waiting.is_finished() {
            waiting = ask();
            continue;
        }
        let other = app.get("/obs?after=0&wait=0.001").token(episode.seat(0)).send().await;
        if other.status == 503 {
            return waiting;
        }
    }
}

#[needs(own_server)]
#[tokio::test]
async fn waits_are_limited_and_end_when_the_server_stops() {
    let mut app = TestApp::builder().limits(|limits| limits.waits_max = 1).start().await;
    let (episode, other) = (app.create(game(2, 2)).await, app.create(game(2, 2)).await);
    let waiting = waiting(&app, &episode).await;
    // Acts are taken all the same, and what can be seen is shown.
    let answer = step(&app, &other, "?wait=60", &stay(&other, 0, &[0])).await;
    check_problem(&answer["problem"], 503, "overloaded");
    assert_eq!(answer["problem"]["limit"], json!({ "name": "waits_max", "value": 1 }));
    assert_eq!((number(&answer["receipts"][0]["waiting_for"]), seen(&answer)), (1, vec![]));
    let answer = step(&app, &other, "?wait=60", &stay(&other, 0, &[0, 1])).await;
    assert_eq!((answer.get("problem"), seen(&answer).len()), (None, 2));
    app.stop().await;
    let answer = waiting.await.expect("no panic").json();
    assert_eq!((number(&answer["receipts"][0]["waiting_for"]), seen(&answer)), (1, vec![]));
    app.start_again().await;
    assert_eq!(app.obs(episode.seat(0)).await["acted"], true);
}

#[tokio::test]
async fn a_client_that_hangs_up_waits_no_more() {
    let app = TestApp::builder().limits(|limits| limits.waits_max = 1).start().await;
    let episode = app.create(game(2, 2)).await;
    let waiting = waiting(&app, &episode).await;
    waiting.abort();
    let acts = stay(&episode, 0, &[0]);
    let may_wait = async || {
        let answer = step(&app, &episode, "?wait=0.001", &acts).await;
        assert_eq!(answer["receipts"][0]["duplicate"], true, "its act is there");
        answer.get("problem").is_none()
    };
    until("the place of the client is free", may_wait).await;
}

#[tokio::test]
async fn prompts_come_where_they_are_asked_for() {
    let app = TestApp::start().await;
    let mut request = game(2, 3);
    // It fails from the third round on.
    request["prompt_template"] = json!("{% if round == 2 %}{{ nothing.at.all }}{% endif %}fine");
    let episode = app.create(request).await;
    let answer = step(&app, &episode, "?wait=60&prompt=true", &stay(&episode, 0, &[0, 1])).await;
    assert_eq!(texts(&seen(&answer), "prompt"), ["fine", "fine"]);
    let refused = call(&app, &episode.swarm, "?prompt=true", &stay(&episode, 1, &[0, 1]));
    let problem = refused.problem(400, "malformed").await;
    assert!(problem["detail"].as_str().is_some_and(|text| text.contains("wait")), "{problem}");
    // The acts are there whatever becomes of the prompts.
    let answer = step(&app, &episode, "?wait=60&prompt=true", &stay(&episode, 1, &[0, 1])).await;
    check_problem(&answer["problem"], 422, "template_failed");
    assert_eq!((list(&answer["receipts"]).len(), seen(&answer)), (2, vec![]));
    assert_eq!(look(&app, &episode, "").await["observations"][0]["round"], 2);
}

#[tokio::test]
async fn an_answer_has_as_many_observations_as_fit() {
    let bytes_max = 12_000;
    let app = TestApp::builder().limits(|limits| limits.answer_bytes_max = bytes_max).start().await;
    let episode = app.create(game(12, 2)).await;
    let mut acts = stay(&episode, 0, &(0..12).collect::<Vec<_>>());
    let mut shown = Vec::new();
    for _ in 0..12 {
        let answer = call(&app, &episode.swarm, "?wait=60", &acts).send().await;
        let given = texts(&seen(&answer.json()), "agent");
        assert!(answer.body.len() <= bytes_max || given.len() == 1, "{}", answer.body.len());
        // The acts of those that are missing are sent again.
        acts.drain(..given.len());
        shown.extend(given);
        if acts.is_empty() {
            break;
        }
    }
    assert_eq!(shown, (0..12).map(|agent| format!("Agent_{agent}")).collect::<Vec<_>>());
}

#[tokio::test]
async fn a_run_of_64_games_is_stepped_at_once() {
    let app = TestApp::start().await;
    let suite = json!({
        "name": "many", "tasks": ["Synchronization"], "seeds": (0..65).collect::<Vec<_>>(),
        "settings": { "num_agents": 2, "max_round": 2 },
    });
    let request = json!({ "suite": suite, "model": "m", "parallel": 64 });
    let run = app.post("/api/v1/runs").json(&request).ok().await;
    let token = run["swarm_token"].as_str().expect("a token");
    let mut steps = Vec::new();
    loop {
        let mut now = app.get("/swarm/obs?wait=60").token(token).ok().await;
        if now["finished"] == true {
            break;
        }
        loop {
            let open = seen(&now).into_iter().filter(|seen| seen["status"] == "running");
            let act = |seen: Value| json!({ "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "action": "STAY" });
            let acts: Vec<Value> = open.map(act).collect();
            if acts.is_empty() {
                break;
            }
            now = call(&app, token, "?wait=60", &acts).ok().await;
            assert_eq!(texts(&seen(&now), "episode"), texts(&acts, "episode"));
            assert_eq!(texts(&seen(&now), "agent"), texts(&acts, "agent"));
            steps.push(acts.len());
        }
    }
    assert_eq!((steps[0], steps.iter().sum::<usize>()), (128, 65 * 2 * 2));
}

#[tokio::test]
async fn how_a_sealed_game_ends_is_not_shown() {
    let app = server().await;
    let suite = json!({
        "tasks": ["Synchronization"], "seeds": 2, "settings": { "num_agents": 2, "max_round": 2 },
    });
    let cup = Cup::open(&app, json!({ "suite": suite, "parallel": 1, "attempts": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let Attempt { swarm, .. } = cup.start(&app, &blue).await;
    let mut now = app.get("/swarm/obs?wait=60").token(&swarm).ok().await;
    for expected in [2, 0] {
        let act = |seen: &Value| json!({ "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "action": "SWITCH" });
        let acts: Vec<Value> = seen(&now).iter().map(act).collect();
        now = call(&app, &swarm, "?wait=60", &acts).ok().await;
        assert_eq!((list(&now["receipts"]).len(), seen(&now).len()), (2, expected));
    }
}

#[rstest]
#[case("wait=60.5")]
#[case("wait=-1")]
#[case("wait=soon")]
#[case("wait=1&wait=2")]
#[case("wait=1&prompt=perhaps")]
#[case("wait=1&after=0.1.2")]
#[case("prompt=true")]
#[tokio::test]
async fn a_bad_query_is_malformed_and_takes_no_act(#[case] query: &str) {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 2)).await;
    let refused = call(&app, &episode.swarm, &format!("?{query}"), &stay(&episode, 0, &[0]));
    refused.problem(400, "malformed").await;
    assert_eq!(app.obs(episode.seat(0)).await["acted"], false);
}

/// A clock that runs out ends a wait, too: the round is resolved without who did not act.
#[tokio::test]
async fn a_round_that_its_clock_ends_is_seen() {
    let app = TestApp::with_manual_clock().await;
    let mut request = game(2, 3);
    request["round_deadline_s"] = json!(10);
    let episode = app.create(request).await;
    let waiting =
        tokio::spawn(call(&app, &episode.swarm, "?wait=60", &stay(&episode, 0, &[0])).ok());
    while app.obs(episode.seat(0)).await["acted"] == false {}
    app.pass(Duration::from_secs(11));
    let answer = waiting.await.expect("no panic");
    assert_eq!(
        (agents(&answer), &answer["observations"][0]["round"]),
        (vec!["Agent_0".into()], &json!(1))
    );
}

/// Receipts are sent where no memory is free for the observations: the acts are durable.
#[tokio::test]
async fn receipts_come_without_observations_that_are_too_large() {
    let app = TestApp::builder().limits(|limits| limits.memory_bytes_max = 4_000_000).start().await;
    let mut request = game(80, 3);
    request["prompt_template"] = json!("x".repeat(30_000));
    (request["width"], request["height"]) = (json!(32), json!(32));
    let episode = app.create(request).await;
    let seats: Vec<u32> = (0..80).collect();
    for acts in [stay(&episode, 0, &seats), stay(&episode, 0, &seats)] {
        let answer = step(&app, &episode, "?wait=60&prompt=true", &acts).await;
        check_problem(&answer["problem"], 503, "overloaded");
        assert_eq!((list(&answer["receipts"]).len(), seen(&answer).len()), (80, 0));
    }
    let looks = app.get("/swarm/obs?prompt=true&limit=80").token(&episode.swarm);
    let problem = looks.problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "memory_bytes_max", "value": 2_000_000 }));
    let fewer = app.get("/swarm/obs?prompt=true&limit=20").token(&episode.swarm).ok().await;
    assert_eq!(seen(&fewer).len(), 20);
}
