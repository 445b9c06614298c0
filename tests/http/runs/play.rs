//! Runs are played: open games, waits, cursors, and limits that delay the next game.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::{Value, json};

use super::{
    TestRun, create, look, play, play_game, seen, send, show, slots, small, stay, text, until, with,
};
use crate::app::{TestApp, check_problem, list, number};

#[tokio::test]
async fn a_run_is_played_with_one_token_and_its_games_are_opened_as_others_end() {
    let app = TestApp::with_manual_clock().await;
    let run = create(&app, with(small(), &json!({ "parallel": 3 }))).await;
    assert_eq!(slots(&run.created, "running"), [0, 1, 2]);
    assert_eq!(slots(&run.created, "planned"), [3]);
    let plan: Vec<_> = list(&run.created["games"])
        .iter()
        .map(|game| (text(game, "task").to_owned(), number(&game["seed"])))
        .collect();
    let expected =
        [("Synchronization", 4), ("Synchronization", 9), ("Foraging", 4), ("Foraging", 9)];
    assert_eq!(plan, expected.map(|(task, seed)| (task.to_owned(), seed)));

    let shown = play(&app, &run).await;
    // Four games, two seats, two rounds: every observation came, and only once.
    assert_eq!(shown.len(), 16);
    assert_eq!(shown.iter().collect::<BTreeSet<_>>().len(), 16);
    let result = show(&app, &run).await;
    assert_eq!(result["status"], "finished");
    assert_eq!(slots(&result, "finished"), [0, 1, 2, 3]);
    assert_eq!((&result["played"], &result["planned"]), (&json!(4), &json!(4)));
    assert_eq!((&result["acts"]["sent"], &result["acts"]["clock_outs"]), (&json!(16), &json!(0)));
    assert_eq!(result["acts"]["invalid_share"], 0.0);

    // Its episodes say to which run they belong, and are found by it.
    let listed = app.get(&format!("/api/v1/episodes?run={}", run.id)).ok().await;
    assert_eq!(list(&listed["items"]).len(), 4);
    for item in list(&listed["items"]) {
        assert_eq!((&item["run"], &item["model"]), (&json!(run.id), &json!("a model")));
        assert_eq!(item["status"], "finished");
    }
    let other = app.get("/api/v1/episodes?run=run_0").ok().await;
    assert_eq!(other["items"], json!([]));

    // The token stays valid.
    let looked = look(&app, &run, "?wait=60").await;
    assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(true)));
    let (episode, agent, _) = &shown[0];
    let act = |round: u64, action: &str| json!({ "episode": episode, "agent": agent, "round": round, "action": action });
    let receipts = send(&app, &run, &[act(1, "STAY"), act(2, "STAY")]).await;
    assert_eq!(receipts[0]["duplicate"], true);
    check_problem(&receipts[1], 409, "episode_over");
}

#[tokio::test]
async fn a_wait_sees_other_games_and_games_that_are_still_to_be_opened() {
    let app = TestApp::with_manual_clock().await;
    let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
    let looked = look(&app, &run, "?wait=60").await;
    assert_eq!(seen(&looked).len(), 4);
    let of = |game: usize| text(&run.created["games"][game], "episode").to_owned();
    let acts = |looked: &Value, episode: &str| {
        let seen = seen(looked).into_iter().filter(|seen| seen["episode"] == episode);
        seen.map(|seen| stay(&seen)).collect::<Vec<_>>()
    };
    // The second game continues while the first is waited for, too.
    let place = format!("?wait=60&after={}", text(&looked, "cursor"));
    let second = acts(&looked, &of(1));
    let (next, _) = tokio::join!(look(&app, &run, &place), send(&app, &run, &second));
    assert_eq!(seen(&next).len(), 2);
    for seen in seen(&next) {
        assert_eq!((text(&seen, "episode"), &seen["round"]), (&*of(1), &json!(1)));
    }
    // It ends; what comes next is a game that was not there when the wait began.
    let place = format!("?wait=60&after={}", text(&next, "cursor"));
    let last = acts(&next, &of(1));
    let (opened, _) = tokio::join!(look(&app, &run, &place), send(&app, &run, &last));
    assert_eq!(seen(&opened).len(), 2);
    for seen in seen(&opened) {
        assert_eq!((&seen["round"], &seen["task"]["name"]), (&json!(0), &json!("Foraging")));
    }
    // Without a cursor all that wait are shown, the oldest first.
    let all = look(&app, &run, "").await;
    let episodes: Vec<_> = seen(&all).iter().map(|seen| text(seen, "episode").to_owned()).collect();
    assert_eq!(episodes[0], of(0));
    assert_eq!(episodes.len(), 4);
    assert_ne!(episodes[2], of(0));
}

#[tokio::test]
async fn a_page_is_cut_through_several_games() {
    let app = TestApp::start().await;
    let run = create(&app, with(small(), &json!({ "parallel": 4 }))).await;
    let (mut counts, mut all) = (Vec::new(), Vec::new());
    let mut place = String::new();
    for _ in 0..4 {
        let looked = look(&app, &run, &format!("?limit=3{place}")).await;
        counts.push(seen(&looked).len());
        all.extend(seen(&looked));
        place = format!("&after={}", text(&looked, "cursor"));
    }
    assert_eq!(counts, [3, 3, 2, 0]);
    assert_eq!(all, seen(&look(&app, &run, "?limit=1024").await));
    let order: Vec<_> = all.iter().map(|seen| text(seen, "episode")).collect();
    let games = list(&run.created["games"]);
    let expected: Vec<_> =
        games.iter().flat_map(|game| [text(game, "episode"), text(game, "episode")]).collect();
    assert_eq!(order, expected, "the oldest first");
}

#[tokio::test]
async fn a_wait_for_nothing_is_empty_when_the_time_is_up() {
    let app = TestApp::with_manual_clock().await;
    let run = create(&app, small()).await;
    let looked = look(&app, &run, "").await;
    let place = text(&looked, "cursor").to_owned();
    let wait = app.get(&format!("/swarm/obs?wait=10&after={place}")).token(&run.token);
    let looked = app.pass_until(tokio::spawn(wait.ok())).await;
    assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(false)));
    assert_eq!(text(&looked, "cursor"), place);
}

#[tokio::test]
async fn acts_go_to_their_own_games_and_to_no_others() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    let other = create(&app, small()).await;
    let alone = app.create(json!({ "task": "Foraging", "num_agents": 2 })).await;
    let of = |run: &TestRun, game: usize| run.created["games"][game]["episode"].clone();
    let act = |episode: Value, agent: &str, round: u64| json!({ "episode": episode, "agent": agent, "round": round, "action": "STAY" });
    let table = [
        (act(of(&run, 1), "Agent_0", 0), Ok((1, false))),
        (act(of(&run, 0), "Agent_1", 0), Ok((1, false))),
        (act(of(&other, 0), "Agent_0", 0), Err((404, "not_found"))),
        (act(json!(alone.id), "Agent_0", 0), Err((404, "not_found"))),
        (act(json!("ep_0"), "Agent_0", 0), Err((404, "not_found"))),
        (act(of(&run, 2), "Agent_2", 0), Err((404, "not_found"))),
        (act(of(&run, 2), "Agent_1", 1), Err((409, "round_ahead"))),
        (act(of(&run, 1), "Agent_1", 0), Ok((0, false))),
        (act(of(&run, 0), "Agent_1", 0), Ok((1, true))),
        (json!({ "agent": "Agent_0" }), Err((422, "invalid"))),
    ];
    let acts: Vec<Value> = table.iter().map(|(act, _)| act.clone()).collect();
    let receipts = send(&app, &run, &acts).await;
    assert_eq!(receipts.len(), table.len());
    for (receipt, (act, expected)) in receipts.iter().zip(&table) {
        match expected {
            Ok((waiting, duplicate)) => {
                assert_eq!(receipt["episode"], act["episode"], "{receipt}");
                assert_eq!(receipt["agent"], act["agent"], "{receipt}");
                assert_eq!(receipt["waiting_for"], *waiting, "{receipt}");
                assert_eq!(receipt["duplicate"], *duplicate, "{receipt}");
            }
            Err((status, code)) => check_problem(receipt, *status, code),
        }
    }
    let rounds: Vec<_> =
        list(&show(&app, &run).await["games"]).iter().map(|game| number(&game["round"])).collect();
    assert_eq!(rounds, [0, 1, 0, 0]);
    assert_eq!(app.obs(alone.seat(0)).await["acted"], false);
    assert_eq!(seen(&look(&app, &other, "").await).len(), 8);
}

/// Each of several clients sees every observation once, though rounds of many games are resolved at
/// the same moments, and games come and go.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn nobody_misses_a_round_that_is_opened_while_others_look() {
    let app = TestApp::start().await;
    let suite = json!({
        "name": "many", "tasks": ["Synchronization"], "seeds": (0..40).collect::<Vec<_>>(),
        "settings": { "num_agents": 1, "max_round": 5 },
    });
    let request = with(small(), &json!({ "suite": suite, "parallel": 16 }));
    let run = create(&app, request).await;
    let app = &app;
    // Each of them plays the games whose ids end so; all of them see all.
    let client = |part: u64| {
        let run = run.clone();
        async move {
            let mut all = Vec::new();
            let mut place = String::new();
            loop {
                let looked = look(app, &run, &format!("?wait=60{place}")).await;
                if looked["finished"] == true {
                    return all;
                }
                assert!(!seen(&looked).is_empty(), "a wait that saw nothing");
                let mine = |seen: &&Value| {
                    let id = text(seen, "episode");
                    u64::from_str_radix(&id[id.len() - 2..], 16).expect("digits") % 4 == part
                };
                let acts: Vec<Value> = seen(&looked).iter().filter(mine).map(stay).collect();
                if !acts.is_empty() {
                    for receipt in send(app, &run, &acts).await {
                        assert_eq!(receipt["duplicate"], false, "{receipt}");
                    }
                }
                all.extend(
                    seen(&looked)
                        .iter()
                        .filter(mine)
                        .map(|seen| (text(seen, "episode").to_owned(), number(&seen["round"]))),
                );
                place = format!("&after={}", text(&looked, "cursor"));
            }
        }
    };
    let parts = tokio::join!(client(0), client(1), client(2), client(3));
    let all: Vec<_> = [parts.0, parts.1, parts.2, parts.3].concat();
    assert_eq!(all.len(), 200, "every round of every game was seen by who played it");
    assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 200, "and once");
    assert_eq!(show(app, &run).await["played"], 40);
}

#[tokio::test]
async fn a_run_waits_until_others_have_ended() {
    let builder = TestApp::builder().manual_clock();
    let app = builder.limits(|limits| limits.episodes_unfinished_max = 3).start().await;
    let alone = app.create(json!({ "task": "Foraging" })).await;
    let run = create(&app, small()).await;
    assert_eq!(slots(&run.created, "running"), [0, 1]);
    let problem = app.post("/api/v1/runs").json(&small()).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_unfinished_max");
    // Whenever one of its games has ended, the next one is opened.
    let first = text(&run.created["games"][0], "episode").to_owned();
    play_game(&app, &run, &first).await;
    until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
    // The place of another is found by the sweep, which comes every minute.
    app.delete(&alone.path("")).token(&alone.swarm).ok().await;
    assert_eq!(slots(&show(&app, &run).await, "running"), [1, 2]);
    app.pass(Duration::from_secs(61));
    until(&app, &run, |shown| slots(shown, "running") == [1, 2, 3]).await;
    play(&app, &run).await;
    assert_eq!(show(&app, &run).await["status"], "finished");
}

#[tokio::test]
async fn nothing_is_opened_on_a_full_disk() {
    let app = TestApp::with_manual_clock().await;
    let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
    app.disk.set(4);
    let problem = app.post("/api/v1/runs").json(&small()).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "disk_free_percent_min");
    let first = text(&run.created["games"][0], "episode").to_owned();
    play_game(&app, &run, &first).await;
    app.pass(Duration::from_secs(61));
    let shown = until(&app, &run, |shown| slots(shown, "running").is_empty()).await;
    assert_eq!((&shown["status"], slots(&shown, "planned")), (&json!("running"), vec![1, 2, 3]));
    app.disk.set(50);
    // The sweep of a minute before may not have ended yet: then the next one finds the place.
    for _ in 0..200 {
        app.pass(Duration::from_secs(61));
        if slots(&show(&app, &run).await, "running") == [1] {
            return;
        }
    }
    panic!("no game is opened: {}", show(&app, &run).await);
}

#[tokio::test]
async fn a_run_that_nobody_plays_any_more_is_abandoned() {
    let app = TestApp::with_manual_clock().await;
    let request = with(small(), &json!({ "parallel": 2, "idle_timeout_s": 100 }));
    let run = create(&app, request).await;
    app.pass(Duration::from_mins(1));
    // One of the two games advances a little.
    let act = json!({
        "episode": run.created["games"][1]["episode"], "agent": "Agent_0", "round": 0, "action": "UP",
    });
    send(&app, &run, &[act]).await;
    app.pass(Duration::from_mins(1));
    let shown = until(&app, &run, |shown| !slots(shown, "abandoned").is_empty()).await;
    assert_eq!((slots(&shown, "abandoned"), slots(&shown, "running")), (vec![0], vec![1]));
    assert_eq!(shown["status"], "running", "the game that is open may be played to its end");
    app.pass(Duration::from_mins(1));
    let shown = until(&app, &run, |shown| shown["status"] != "running").await;
    assert_eq!(shown["status"], "abandoned");
    assert_eq!(slots(&shown, "planned"), [2, 3]);
    assert_eq!(look(&app, &run, "?wait=60").await["finished"], true);
}

#[tokio::test]
async fn a_game_that_is_aborted_counts_as_it_stands() {
    let app = TestApp::start().await;
    let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
    let first = text(&run.created["games"][0], "episode").to_owned();
    app.delete(&format!("/api/v1/episodes/{first}")).token(&run.token).ok().await;
    play(&app, &run).await;
    let result = show(&app, &run).await;
    assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
    assert_eq!(slots(&result, "aborted"), [0]);
}
