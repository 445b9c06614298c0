//! Episodes in memory: idle ones are evicted and recovered, and worlds and large answers share one budget.

use std::time::Duration;

use serde_json::{Value, json};
use swarmbench_testkit::needs;

use crate::app::{Episode, TestApp, game, list, number, verified};

/// A metric that counts whole numbers.
fn metric(text: &str, name: &str) -> u64 {
    let line = text.lines().find(|line| line.starts_with(name) && !line.starts_with('#'));
    line.and_then(|line| line.rsplit(' ').next()?.parse().ok())
        .unwrap_or_else(|| panic!("{name} is missing in {text}"))
}

/// Waits for the server's next sweep.
pub(crate) async fn until_in_memory(app: &TestApp, expected: u64) {
    until(app, "swarmbench_episodes_in_memory", expected).await;
}

/// Lets time pass until `/metrics` counts this many. What is stored comes first, and is counted when the server knows that it is.
async fn until(app: &TestApp, name: &str, expected: u64) {
    for _ in 0..2_000 {
        let metrics = app.get("/metrics").send().await.text();
        if metric(&metrics, name) == expected {
            return;
        }
        app.pass(Duration::from_secs(1));
    }
    panic!("{name} is never {expected}");
}

#[needs(own_server)]
#[tokio::test]
async fn idle_episodes_are_evicted_and_recovered() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(game(2, 50)).await;
    app.all_act(&episode, "SWITCH").await;
    app.act(episode.seat(0), &json!({ "round": 1, "action": "STAY" })).await;
    let before = (app.state(&episode).await, app.journal(&episode).await);
    until_in_memory(&app, 0).await;
    let metrics = app.get("/metrics").send().await.text();
    assert_eq!(metric(&metrics, "swarmbench_episodes_unfinished"), 1);
    assert_eq!((app.state(&episode).await, app.journal(&episode).await), before);
    let again = app.act(episode.seat(0), &json!({ "round": 1, "action": "STAY" })).await;
    assert_eq!(again["duplicate"], true);
    app.act(episode.seat(1), &json!({ "round": 1, "action": "STAY" })).await;
    assert_eq!(app.state(&episode).await["round"], 2);
    until_in_memory(&app, 0).await;
}

#[needs(own_server)]
#[tokio::test]
async fn a_clock_keeps_its_episode_in_memory() {
    let app = TestApp::with_manual_clock().await;
    let slow = json!({ "task": "Synchronization", "num_agents": 2, "round_deadline_s": 3600 });
    let episode = app.create(slow).await;
    app.create(game(2, 50)).await;
    until_in_memory(&app, 1).await;
    app.pass(Duration::from_hours(1));
    assert_eq!(app.obs_after(episode.seat(0), 0).await["round"], 1, "the clock ran out");
}

#[tokio::test]
async fn forgotten_episodes_are_abandoned_in_memory_or_not() {
    let mut app = TestApp::with_manual_clock().await;
    let mut forgotten = game(2, 50);
    forgotten["idle_timeout_s"] = json!(7200);
    let episode = app.create(forgotten.clone()).await;
    app.all_act(&episode, "SWITCH").await;
    until_in_memory(&app, 0).await;
    for restart in [false, true] {
        let other = app.create(forgotten.clone()).await;
        if restart {
            app.restart().await;
        }
        let waiting = [&episode, &other].map(|episode| episode.id.clone());
        // Nobody asks for them: that would take them up.
        let mut left = 10_000;
        loop {
            let path = "/api/v1/episodes?status=abandoned";
            let ended = list(&app.get(path).ok().await["items"]);
            if waiting.iter().all(|id| ended.iter().any(|item| item["id"] == id.as_str())) {
                break;
            }
            app.pass(Duration::from_secs(10));
            left -= 1;
            assert!(left > 0, "they are not abandoned: {ended:?}");
        }
        assert_eq!(app.show(&other).await["result"]["reason"], "idle");
    }
    until(&app, "swarmbench_episodes_unfinished", 0).await;
}

/// A world of about 200 kB in its first round.
fn large() -> Value {
    json!({
        "task": "Synchronization", "num_agents": 1, "width": 256, "height": 256, "view_size": 3,
        "memory": 5, "max_round": 50, "visibility": "public",
    })
}

#[tokio::test]
async fn idle_worlds_are_evicted_for_others_and_recovered() {
    let app = TestApp::builder()
        .manual_clock()
        .limits(|limits| limits.memory_bytes_max = 2_000_000)
        .start()
        .await;
    let mut games = Vec::new();
    for _ in 0..20 {
        let game = app.create(large()).await;
        app.all_act(&game, "STAY").await;
        games.push((app.obs(game.seat(0)).await, game));
        app.pass(Duration::from_secs(11));
    }
    for (seen, game) in &games {
        assert_eq!(&app.obs(game.seat(0)).await, seen);
        app.pass(Duration::from_secs(11));
    }
    // Nobody waits for the sweep, which comes after five minutes without a request.
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_evictions_total"), "{metrics}");
}

#[tokio::test]
async fn a_full_server_refuses_what_is_large_and_plays_on_what_is_small() {
    let mut app = TestApp::builder()
        .manual_clock()
        .limits(|limits| limits.memory_bytes_max = 2_000_000)
        .start()
        .await;
    let small = app.create(game(2, 3)).await;
    // All of them were just asked for.
    let mut games = Vec::new();
    let refused = loop {
        let answer = app.post("/api/v1/episodes").json(&large()).send().await;
        if answer.status != 201 {
            break answer;
        }
        games.push(Episode::of(&answer.json()));
        assert!(games.len() < 20, "all of them fit");
    };
    assert_eq!((refused.status, refused.header("retry-after")), (503, "5"));
    let limit = json!({ "name": "memory_bytes_max", "value": 2_000_000 });
    assert_eq!(refused.json()["limit"], limit);
    // A state of 65,536 cells is a large answer.
    let problem = app.get(&games[0].path("/state")).problem(503, "overloaded").await;
    assert_eq!(problem["limit"], limit);
    // What is small is created and played as ever, and so is every game that is there.
    let another = app.create(game(2, 3)).await;
    for game in [&small, &another] {
        while app.show(game).await["status"] == "running" {
            app.all_act(game, "STAY").await;
        }
        assert_eq!(number(&app.show(game).await["result"]["rounds"]), 3);
        verified(&app.journal(game).await);
    }
    for game in &games {
        app.all_act(game, "STAY").await;
    }
    // The same holds for games that are recovered after a restart.
    app.restart().await;
    let mut found = 0;
    for game in &games {
        let answer = app.get("/obs").token(game.seat(0)).send().await;
        if answer.status == 200 {
            found += 1;
        } else {
            assert_eq!(answer.json()["limit"], limit);
        }
    }
    assert!((1..games.len()).contains(&found), "{found} of {}", games.len());
    app.pass(Duration::from_secs(11));
    for game in games.iter().rev() {
        app.obs(game.seat(0)).await;
        app.pass(Duration::from_secs(11));
    }
}
