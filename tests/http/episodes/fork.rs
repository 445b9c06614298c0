//! Forks: who may make them, what they take over, and that they count nowhere.

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::fork::verify_fork;
use swarmbench_journal::replay::JournalReport;

use super::{finish, request, with};
use crate::app::{Call, Episode, HttpAnswer, TestApp, fields, list, texts, verified};
use crate::cup::{Cup, pass_minutes, server};

const SECRETS: [&str; 3] = ["CANARY-ANSWER", "CANARY-REASON", "987654"];

fn call(app: &TestApp, parent: &Episode, body: &Value) -> Call {
    app.post(&parent.path("/fork")).json(body)
}

/// Forks an episode as its creator.
async fn fork(app: &TestApp, parent: &Episode, body: Value) -> Vec<Episode> {
    let made = call(app, parent, &body).ok().await;
    list(&made["episodes"]).iter().map(Episode::of).collect()
}

/// An act whose answer, reasons and costs nobody else may learn.
fn answer(round: u64, agent: usize) -> Value {
    let action =
        ["SWITCH", "UP", "LEFT", "STAY"][(agent + usize::try_from(round).expect("small")) % 4];
    json!({
        "round": round,
        "response": format!("CANARY-ANSWER of {agent}\nACTION: {action}\nMSG: {agent} in {round}"),
        "reasoning": "CANARY-REASON", "usage": { "prompt_tokens": 987_654 },
    })
}

/// An episode in which a language model has answered some rounds.
async fn answered(app: &TestApp, create: Value, rounds: u64) -> Episode {
    let episode = app.create(create).await;
    play(app, &episode, 0..rounds).await;
    episode
}

async fn play(app: &TestApp, episode: &Episode, rounds: std::ops::Range<u64>) {
    for round in rounds {
        for (agent, token) in episode.seats().enumerate() {
            app.act(token, &answer(round, agent)).await;
        }
    }
}

fn digests(journal: &str) -> Vec<String> {
    let lines = journal.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let records = lines.map(|line| line["record"].clone());
    let with_digest = records.filter(|record| record["digest"].is_string());
    with_digest.map(|record| record["digest"].as_str().expect("a text").to_owned()).collect()
}

fn compared(fork: &str, parent: &str) -> JournalReport {
    verify_fork(fork.as_bytes(), parent.as_bytes(), None, Solver::Flow, |_, _| ())
        .expect("it belongs")
}

#[tokio::test]
async fn the_same_acts_lead_to_the_same_states() {
    let app = TestApp::start().await;
    let settings = json!({
        "task": "Foraging", "seed": 27, "num_agents": 4, "max_round": 9, "noise": 0.3, "max_delay": 2, "memory": 3,
    });
    let parent = answered(&app, settings, 9).await;
    let whole = app.journal(&parent).await;
    for round in [0, 1, 5, 8] {
        let made = call(&app, &parent, &json!({ "round": round, "model": "again" })).ok().await;
        assert_eq!(
            (&made["fork"]["episode"], &made["fork"]["round"]),
            (&json!(parent.id), &json!(round))
        );
        let fork = Episode::of(&made["episodes"][0]);
        let shown = app.show(&fork).await;
        assert_eq!((&shown["round"], &shown["status"]), (&json!(round), &json!("running")));
        assert_eq!(shown["fork"], made["fork"]);
        assert_eq!(
            app.state(&fork).await,
            app.get(&parent.path(&format!("/state?round={round}"))).ok().await
        );
        play(&app, &fork, round..9).await;
        let journal = app.journal(&fork).await;
        assert_eq!(digests(&journal), digests(&whole));
        let report = compared(&journal, &whole);
        assert_eq!((report.rounds, report.opening.config.model.as_str()), (9, "again"));
        assert_eq!(report.end.map(|end| end.reason).as_deref(), Some("rounds_played"));
        assert_eq!(report.tally.acts, (9 - round) * 4, "what was taken over is not counted");
        assert_eq!(report.opening.fork.map(|fork| json!(fork)), Some(made["fork"].clone()));
    }
}

#[tokio::test]
async fn other_acts_lead_elsewhere_and_observations_go_on() {
    let app = TestApp::start().await;
    let parent = answered(&app, request(3, 6), 3).await;
    let seen = app.obs(parent.seat(1)).await;
    let fork = fork(&app, &parent, json!({ "round": 3 })).await.remove(0);
    let mut same = app.obs(fork.seat(1)).await;
    same["episode"] = seen["episode"].clone();
    assert_eq!(same, seen, "memory and messages included");
    let prompt = |token: &str| app.get("/obs?prompt=true").token(token);
    assert_eq!(
        prompt(fork.seat(1)).ok().await["prompt"],
        prompt(parent.seat(1)).ok().await["prompt"]
    );
    app.all_act(&fork, "SWITCH").await;
    app.all_act(&parent, "STAY").await;
    assert_ne!(app.state(&fork).await, app.state(&parent).await);
    // What was done in a round that was taken over cannot be changed.
    let late = json!({ "round": 1, "action": "DOWN", "message": "never" });
    app.post("/act").token(fork.seat(0)).json(&late).problem(409, "already_acted").await;
    finish(&app, &fork).await;
    let report = compared(&app.journal(&fork).await, &app.journal(&parent).await);
    assert_eq!(report.rounds, 6);
}

#[tokio::test]
async fn answers_reasons_and_costs_are_not_taken_over() {
    let app = TestApp::start().await;
    let parent = answered(&app, request(3, 6), 4).await;
    let hidden = app.journal(&parent).await;
    assert!(SECRETS.iter().all(|secret| hidden.contains(secret)), "there is something to hide");
    let invalid =
        json!({ "round": 4, "response": "CANARY-ANSWER, and no action", "failure": null });
    app.act(parent.seat(0), &invalid).await;
    app.all_act(&parent, "SWITCH").await;
    let fork = fork(&app, &parent, json!({ "round": 5 })).await.remove(0);
    finish(&app, &fork).await;
    let journal = app.journal(&fork).await;
    let replay = app.get(&fork.path("/replay")).ok().await.to_string();
    let act = app.get(&fork.path("/rounds/4/agents/Agent_0")).ok().await;
    let exported =
        app.get(&format!("/api/v1/exports/acts.jsonl?episode={}", fork.id)).send().await.text();
    for secret in SECRETS {
        for text in [&journal, &replay, &act.to_string(), &exported] {
            assert!(!text.contains(secret), "{secret} in {text}");
        }
    }
    // That an answer did not count is part of the game.
    assert_eq!(act["act"]["valid"], false, "{act}");
    let report = compared(&journal, &app.journal(&parent).await);
    assert_eq!((report.tally.acts, report.tally.invalid), (3, 0));
}

#[tokio::test]
async fn a_group_has_one_state_and_tokens_of_its_own() {
    let app = TestApp::start().await;
    let parent = answered(&app, request(2, 6), 3).await;
    let body = json!({ "round": 2, "count": 64, "model": "sixty-four" });
    let answer = call(&app, &parent, &body).send().await;
    assert_eq!(answer.status, 201, "{}", answer.text());
    assert_eq!(answer.header("cache-control"), "no-store");
    let path = answer.header("location").to_owned();
    let forks: Vec<Episode> = list(&answer.json()["episodes"]).iter().map(Episode::of).collect();
    assert_eq!(forks.len(), 64);
    let listed = list(&app.get(&format!("{path}&limit=1000")).ok().await["items"]);
    let mut ids = texts(&listed, "id");
    ids.reverse();
    assert_eq!(ids, forks.iter().map(|fork| fork.id.clone()).collect::<Vec<_>>());
    let states = app.state(&forks[0]).await;
    for (number, fork) in forks.iter().enumerate() {
        assert_eq!(app.state(fork).await, states);
        let action = if number % 2 == 0 { "SWITCH" } else { "STAY" };
        assert_eq!(app.all_act(fork, action).await, 2);
        verified(&app.journal(fork).await);
    }
    assert_ne!(app.state(&forks[0]).await, app.state(&forks[1]).await);
    assert_eq!(list(&app.get("/api/v1/episodes?fork_of=ep_unknown").ok().await["items"]).len(), 0);
}

#[tokio::test]
async fn a_repeat_gives_the_same_forks_with_new_tokens() {
    let app = TestApp::start().await;
    let (parent, other) =
        (answered(&app, request(2, 6), 2).await, answered(&app, request(2, 6), 2).await);
    let body = json!({ "round": 1, "count": 3 });
    let once =
        |parent: &Episode, body: &Value| call(&app, parent, body).header("Idempotency-Key", "k");
    let first = once(&parent, &body).ok().await;
    let second = once(&parent, &body).ok().await;
    let of = |made: &Value| list(&made["episodes"]).iter().map(Episode::of).collect::<Vec<_>>();
    let (first, second) = (of(&first), of(&second));
    for (before, now) in first.iter().zip(&second) {
        assert_eq!(before.id, now.id);
        app.get("/obs").token(before.seat(0)).problem(401, "unauthorized").await;
        assert_eq!(app.obs(now.seat(0)).await["round"], 1);
    }
    assert_eq!(first.len(), 3);
    once(&parent, &json!({ "round": 1, "count": 2 })).problem(422, "invalid").await;
    // The same body means other forks where it is sent for another episode.
    once(&other, &body).problem(422, "invalid").await;
    let create = app.post("/api/v1/episodes").header("Idempotency-Key", "k").json(&request(1, 1));
    create.problem(422, "invalid").await;
    assert_eq!(app.count("SELECT count(*) FROM episodes").await, 5);
}

#[rstest]
#[case("round", json!(null))]
#[case("round", json!(-1))]
#[case("round", json!(4))]
#[case("round", json!("2"))]
#[case("round", json!(1.5))]
#[case("count", json!(0))]
#[case("count", json!(65))]
#[case("count", json!(-1))]
#[case("model", json!(""))]
#[case("visibility", json!("sealed"))]
#[case("open_seats", json!(3))]
#[case("player", json!("nobody"))]
#[case("bank_s", json!(-1))]
#[case("prompt_template", json!("{{ agent"))]
#[case("seed", json!(1))]
#[case("max_round", json!(100))]
#[case("task", json!("Synchronization"))]
#[tokio::test]
async fn what_is_not_allowed_is_named(#[case] field: &str, #[case] value: Value) {
    let app = TestApp::start().await;
    let parent = answered(&app, request(2, 6), 3).await;
    let body = with(json!({ "round": 2 }), field, value);
    assert_eq!(fields(&call(&app, &parent, &body).problem(422, "invalid").await), [field]);
    assert_eq!(app.count("SELECT count(*) FROM episodes").await, 1);
    call(&app, &parent, &json!({ "round": 3 })).ok().await;
}

#[tokio::test]
async fn a_game_that_is_over_has_nothing_after_its_last_round() {
    let app = TestApp::start().await;
    let parent = answered(&app, request(2, 3), 3).await;
    let problem = call(&app, &parent, &json!({ "round": 3 })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["round"]);
    assert!(
        problem["detail"].as_str().is_some_and(|text| text.contains("earlier one")),
        "{problem}"
    );
    // One that was aborted is not over by the rules.
    let aborted = answered(&app, request(2, 6), 3).await;
    app.delete(&aborted.path("")).token(&aborted.swarm).ok().await;
    let fork = fork(&app, &aborted, json!({ "round": 3 })).await.remove(0);
    finish(&app, &fork).await;
    compared(&app.journal(&fork).await, &app.journal(&aborted).await);
    let nowhere = app.post("/api/v1/episodes/ep_0/fork").json(&json!({ "round": 0 }));
    nowhere.problem(404, "not_found").await;
}

#[tokio::test]
async fn limits_are_named() {
    let app = TestApp::builder().limits(|limits| {
        (limits.fork_rounds_max, limits.fork_count_max) = (3, 4);
        (limits.fork_seats_max, limits.fork_acts_max) = (7, 12);
    });
    let app = app.start().await;
    let parent = answered(&app, request(2, 9), 5).await;
    for (body, limit) in [
        (json!({ "round": 4 }), "fork_rounds_max"),
        (json!({ "round": 0, "count": 5 }), "fork_count_max"),
        (json!({ "round": 0, "count": 4 }), "fork_seats_max"),
        (json!({ "round": 3, "count": 3 }), "fork_acts_max"),
    ] {
        let problem = call(&app, &parent, &body).problem(422, "invalid").await;
        assert!(problem["detail"].as_str().is_some_and(|text| text.contains(limit)), "{problem}");
    }
    fork(&app, &parent, json!({ "round": 3, "count": 2 })).await;
}

#[tokio::test]
async fn forks_are_under_the_quota_of_episodes() {
    let app = TestApp::builder().limits(|limits| limits.episodes_unfinished_max = 4).start().await;
    let parent = answered(&app, request(2, 9), 2).await;
    let problem =
        call(&app, &parent, &json!({ "round": 1, "count": 4 })).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_unfinished_max");
    assert_eq!(app.count("SELECT count(*) FROM episodes").await, 1, "none of four is made");
    fork(&app, &parent, json!({ "round": 1, "count": 3 })).await;
    call(&app, &parent, &json!({ "round": 1 })).problem(503, "overloaded").await;
}

#[tokio::test]
async fn forks_are_under_the_quota_of_bytes() {
    let builder =
        TestApp::builder().keys().limits(|limits| limits.journal_bytes_per_key_max = 5_000);
    let app = builder.start().await;
    let (key, _) = app.key(json!({ "name": "owner" })).await;
    let parent = app.create_with(&key, request(2, 40)).await;
    for _ in 0..10 {
        app.all_act(&parent, "SWITCH").await;
    }
    let call =
        |count: u32| call(&app, &parent, &json!({ "round": 10, "count": count })).token(&key);
    let problem = call(4).problem(403, "forbidden").await;
    assert_eq!(problem["limit"], json!({ "name": "journal_bytes_per_key_max", "value": 5_000 }));
    call(1).ok().await;
}

#[tokio::test]
async fn bytes_of_forks_have_a_rate() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.journal_bytes_per_key_s_max = 100).start().await;
    let (key, _) = app.key(json!({ "name": "owner" })).await;
    let parent = app.create_with(&key, request(2, 40)).await;
    for _ in 0..10 {
        app.all_act(&parent, "SWITCH").await;
    }
    let call = || call(&app, &parent, &json!({ "round": 10 })).token(&key);
    call().ok().await;
    let problem = call().problem(429, "rate_limited").await;
    assert_eq!(problem["limit"]["name"], "journal_bytes_per_key_s_max");
    app.pass(std::time::Duration::from_secs(16));
    call().ok().await;
}

#[tokio::test]
async fn who_may_read_the_journal_may_fork() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    for visibility in ["public", "owner"] {
        let parent =
            app.create_with(&owner, with(request(2, 3), "visibility", json!(visibility))).await;
        app.all_act(&parent, "SWITCH").await;
        let fork = |token: &str| call(&app, &parent, &json!({ "round": 1 })).token(token);
        let (status, code) =
            if visibility == "public" { (403, "forbidden") } else { (404, "not_found") };
        fork(&member).problem(status, code).await;
        fork(&parent.swarm).problem(403, "forbidden").await;
        fork(parent.seat(0)).problem(403, "forbidden").await;
        call(&app, &parent, &json!({ "round": 1 })).problem(401, "unauthorized").await;
        for key in [&owner, &app.organizer] {
            let made = fork(key).ok().await;
            // Nobody sees more of a fork than of its parent.
            assert_eq!(made["episodes"][0]["config"]["visibility"], visibility);
        }
        finish(&app, &parent).await;
        let made = Episode::of(&fork(&member).ok().await["episodes"][0]);
        // It is the member's now.
        app.delete(&made.path(""))
            .token(&owner)
            .problem(if visibility == "public" { 403 } else { 404 }, code)
            .await;
        app.delete(&made.path("")).token(&member).ok().await;
    }
}

/// The seed could be found by trying which one leads to a head that is shown.
#[tokio::test]
async fn the_head_is_shown_with_the_seed() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let parent = app.create_with(&owner, with(request(2, 3), "visibility", json!("public"))).await;
    app.all_act(&parent, "SWITCH").await;
    let made = call(&app, &parent, &json!({ "round": 1 })).token(&owner).ok().await;
    let fork = Episode::of(&made["episodes"][0]);
    let shown = app.get(&fork.path("")).ok().await;
    assert_eq!((&shown["config"]["seed"], &shown["fork"]["head"]), (&json!(null), &json!(null)));
    assert_eq!(shown["fork"]["episode"], parent.id);
    assert_eq!(app.get(&fork.path("")).token(&owner).ok().await["fork"], made["fork"]);
    finish(&app, &fork).await;
    assert_eq!(app.get(&fork.path("")).ok().await["fork"], made["fork"]);
}

#[tokio::test]
async fn a_game_of_several_holders_is_forked_after_its_end() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let parent = app.create_with(&owner, with(request(2, 3), "open_seats", json!(1))).await;
    let claim = app.post(&parent.path("/claims")).token(&member).json(&json!({})).ok().await;
    let claimed = claim["seats"][0]["token"].as_str().expect("a token");
    let act = async |round: u64| {
        app.act(parent.seat(0), &answer(round, 0)).await;
        app.act(claimed, &answer(round, 1)).await;
    };
    act(0).await;
    let fork = |token: &str| call(&app, &parent, &json!({ "round": 1 })).token(token);
    for key in [&owner, &member, &app.organizer] {
        fork(key).problem(403, "forbidden").await;
    }
    act(1).await;
    act(2).await;
    let made = Episode::of(&fork(&member).ok().await["episodes"][0]);
    finish(&app, &made).await;
    let (journal, whole) = (app.journal(&made).await, app.journal(&parent).await);
    compared(&journal, &whole);
    assert!(SECRETS.iter().all(|secret| whole.contains(secret) && !journal.contains(secret)));
}

#[tokio::test]
async fn sealed_games_are_forked_after_the_reveal_only() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "attempts": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 2).await;
    let all =
        list(&app.get("/api/v1/episodes?limit=1000").token(&app.organizer).ok().await["items"]);
    let path = format!("/api/v1/episodes/{}/fork", all[0]["id"].as_str().expect("an id"));
    let fork = |token: &str| app.post(&path).token(token).json(&json!({ "round": 1 }));
    let (member, _) = app.key(json!({ "name": "member" })).await;
    for (token, status, code) in [
        (&app.organizer, 403, "forbidden"),
        (&member, 404, "not_found"),
        (&blue.key, 403, "forbidden"),
    ] {
        fork(token).problem(status, code).await;
    }
    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let made = Episode::of(&fork(&member).ok().await["episodes"][0]);
    let shown = app.show(&made).await;
    assert_eq!((&shown["run"], &shown["config"]["visibility"]), (&json!(null), &json!("owner")));
    while app.show(&made).await["status"] == "running" {
        app.all_act(&made, "STAY").await;
    }
    verified(&app.journal(&made).await);
    let file = cup.export(&app).await;
    assert!(!file.contains(&made.id), "the published file has no forks");
}

#[tokio::test]
async fn forks_count_nowhere() {
    let app = TestApp::start().await;
    let suite = json!({ "name": "s", "tasks": ["Synchronization"], "seeds": [1], "settings": { "num_agents": 2, "max_round": 2 } });
    let run = app.post("/api/v1/runs").json(&json!({ "suite": suite, "model": "m" })).ok().await;
    let mut parent = app.create(request(1, 1)).await;
    run["games"][0]["episode"].as_str().expect("an id").clone_into(&mut parent.id);
    run["swarm_token"].as_str().expect("a token").clone_into(&mut parent.swarm);
    app.all_act(&parent, "SWITCH").await;
    app.all_act(&parent, "SWITCH").await;
    let path = format!("/api/v1/runs/{}", run["id"].as_str().expect("an id"));
    while app.get(&path).ok().await["status"] == "running" {}
    let board = app.get("/api/v1/leaderboard?suite=s").ok().await;
    let results = app.count("SELECT count(*) FROM results").await;
    let shown = app.get(&path).ok().await;
    // A fork of a game that counts, and one with several holders, neither of which counts.
    let one = fork(&app, &parent, json!({ "round": 1, "model": "m" })).await.remove(0);
    finish(&app, &one).await;
    let mixed = fork(&app, &parent, json!({ "round": 1, "open_seats": 1 })).await.remove(0);
    let claim = app.post(&mixed.path("/claims")).json(&json!({ "model": "other" })).ok().await;
    app.act(mixed.seat(0), &json!({ "round": 1, "action": "SWITCH" })).await;
    let claimed = claim["seats"][0]["token"].as_str().expect("a token");
    app.act(claimed, &json!({ "round": 1, "action": "SWITCH" })).await;
    assert_eq!(app.show(&mixed).await["status"], "finished");
    let report = verified(&app.journal(&mixed).await);
    assert!(report.seats.is_some_and(|seats| seats.holders.len() == 2));
    assert_eq!(app.count("SELECT count(*) FROM results").await, results);
    assert_eq!(app.get("/api/v1/leaderboard?suite=s").ok().await, board);
    assert_eq!(app.get(&path).ok().await, shown);
    assert_eq!(list(&app.get("/api/v1/cross-play").ok().await["items"]).len(), 0);
    let rows = async |query: &str| {
        app.get(&format!("/api/v1/exports/episodes.jsonl{query}")).send().await.text()
    };
    assert!(!rows("").await.contains(&one.id), "only who asks for forks gets them");
    assert_eq!(rows(&format!("?episode={}", one.id)).await.lines().count(), 1);
    let rows = rows("?forks=true").await;
    let rows: Vec<Value> =
        rows.lines().map(|row| serde_json::from_str(row).expect("JSON")).collect();
    let row = rows.iter().find(|row| row["episode"] == json!(one.id)).expect("its row");
    assert_eq!(
        (&row["fork_of"], &row["fork_round"], &row["acts"]),
        (&json!(parent.id), &json!(1), &json!(2))
    );
}

/// All kinds of players on the seats of forks, over a restart and a fork of a fork.
#[tokio::test]
async fn a_fork_is_recovered_and_forked_again() {
    let mut app = TestApp::start().await;
    let parent = answered(&app, with(request(3, 8), "seed", json!(4)), 3).await;
    let running = fork(&app, &parent, json!({ "round": 2, "bank_s": 5, "round_deadline_s": 500 }))
        .await
        .remove(0);
    let hosted = fork(&app, &parent, json!({ "round": 3, "player": "default" })).await.remove(0);
    let waiting = fork(&app, &parent, json!({ "round": 3, "player": "random", "start": "manual" }))
        .await
        .remove(0);
    let open = fork(&app, &parent, json!({ "round": 1, "open_seats": 2 })).await.remove(0);
    app.all_act(&running, "UP").await;
    let before = [app.journal(&running).await, app.journal(&waiting).await];
    app.restart().await;
    let after = [app.journal(&running).await, app.journal(&waiting).await];
    assert_eq!(after, before);
    let again = fork(&app, &running, json!({ "round": 3, "count": 2 })).await.remove(1);
    let early = fork(&app, &running, json!({ "round": 1 })).await.remove(0);
    for episode in [&running, &again, &early] {
        finish(&app, episode).await;
    }
    app.post(&waiting.path("/start")).token(&waiting.swarm).ok().await;
    for episode in [&hosted, &waiting] {
        while app.show(episode).await["status"] == "running" {}
        let report = compared(&app.journal(episode).await, &app.journal(&parent).await);
        assert!(report.seats.is_some() && report.rounds == 8, "{report:?}");
        // Its own seats come after what was taken over.
        let again = fork(&app, episode, json!({ "round": 3 })).await.remove(0);
        compared(&app.journal(&again).await, &app.journal(episode).await);
    }
    let claim = app.post(&open.path("/claims")).json(&json!({ "seats": 2 })).ok().await;
    let mut others = open.clone();
    claim["swarm_token"].as_str().expect("a token").clone_into(&mut others.swarm);
    while app.show(&open).await["status"] == "running" {
        app.all_act(&open, "SWITCH").await;
        app.all_act(&others, "SWITCH").await;
    }
    let ended = app.journal(&open).await;
    compared(&ended, &app.journal(&parent).await);
    compared(&app.journal(&again).await, &app.journal(&running).await);
    compared(&app.journal(&early).await, &app.journal(&running).await);
    assert_eq!(app.count("SELECT count(*) FROM forking").await, 0);
    assert_sound(&mut app).await;
}

/// Stops the server, and checks all of its database.
async fn assert_sound(app: &mut TestApp) {
    app.stop().await;
    let formats = &swarmbench::competitions::FORMATS;
    let checked = swarmbench::store::check::check(app.location(), formats, |_, _| ()).await;
    let checked = checked.expect("it can be checked");
    assert!(checked.is_sound(), "{:?}", checked.damages);
}

/// A fork that is written in several commits is there whole, or not at all.
#[tokio::test]
async fn what_a_crash_leaves_of_a_fork_is_deleted() {
    let mut app = TestApp::start().await;
    let parent = answered(&app, request(8, 30), 20).await;
    // 30 × 20 × 9 rows.
    let forks = fork(&app, &parent, json!({ "round": 20, "count": 30 })).await;
    assert_eq!(app.count("SELECT count(*) FROM forking").await, 0);
    let rows = app.count("SELECT count(*) FROM acts").await;
    assert_eq!(rows, 31 * 160);
    // As if the last commit had never come: acts and rounds without an episode.
    app.tamper(
        "INSERT INTO forking (episode) VALUES (1000000);
         INSERT INTO acts SELECT 1000000, round, agent, waiting_for, at, record, source, brief FROM acts WHERE episode = 1;
         INSERT INTO rounds SELECT 1000000, round, digest, score, head, at FROM rounds WHERE episode = 1;",
    )
    .await;
    let mut crashed = app.after_a_crash().await;
    assert_eq!(crashed.count("SELECT count(*) FROM acts").await, rows);
    assert_eq!(crashed.count("SELECT count(*) FROM rounds WHERE episode = 1000000").await, 0);
    assert_eq!(crashed.count("SELECT count(*) FROM forking").await, 0);
    verified(&crashed.journal(&forks[29]).await);
    crashed.all_act(&forks[29], "SWITCH").await;
    assert_sound(&mut crashed).await;
    assert_sound(&mut app).await;
}

#[tokio::test]
async fn replays_metrics_and_scores_of_a_fork_have_all_rounds() {
    let app = TestApp::start().await;
    let parent = answered(&app, request(3, 4), 4).await;
    let fork = fork(&app, &parent, json!({ "round": 3 })).await.remove(0);
    play(&app, &fork, 3..4).await;
    let get = |episode: &Episode, rest: &str| app.get(&episode.path(rest));
    for rest in ["/scores", "/metrics"] {
        let (mut own, of_parent) = (get(&fork, rest).ok().await, get(&parent, rest).ok().await);
        own["episode"] = of_parent["episode"].clone();
        if rest == "/metrics" {
            // What the rounds before have cost is not taken over.
            own["values"]["tokens_per_point"] = of_parent["values"]["tokens_per_point"].clone();
        }
        assert_eq!(own, of_parent, "{rest}");
    }
    let states = |replay: Value| replay["states"].clone();
    assert_eq!(
        states(get(&fork, "/replay").ok().await),
        states(get(&parent, "/replay").ok().await)
    );
    let verification = get(&fork, "/verification").ok().await;
    assert_eq!(verification["ok"], true, "{verification}");
    let answer: HttpAnswer =
        app.get(&format!("/api/v1/exports/rounds.jsonl?episode={}", fork.id)).send().await;
    assert_eq!(answer.text().lines().filter(|line| line.contains(&fork.id)).count(), 5);
}
