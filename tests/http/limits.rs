//! What a server takes at most: requests, episodes, bytes, and a disk that fills up.

use std::time::Duration;

use serde_json::{Value, json};

use crate::app::{TestApp, list};

fn request() -> Value {
    json!({ "task": "Synchronization", "num_agents": 2, "max_round": 50 })
}

#[tokio::test]
async fn an_address_that_asks_too_often_is_told_when_to_come_again() {
    let app = TestApp::builder()
        .manual_clock()
        .limits(|limits| limits.address_requests_per_s_max = 2)
        .access(|access| access.trusted_proxies = vec!["127.0.0.0/8".parse().expect("a net")])
        .start()
        .await;
    let ask = |address: &str| app.get("/api/v1/episodes").header("x-forwarded-for", address);
    for _ in 0..4 {
        ask("198.51.100.7").ok().await;
    }
    let refused = ask("198.51.100.7").send().await;
    assert_eq!((refused.status, refused.header("retry-after")), (429, "1"), "rounded up");
    let problem = refused.json();
    assert_eq!(problem["code"], "rate_limited");
    assert_eq!(problem["retry_after_ms"], 500);
    assert_eq!(problem["limit"], json!({ "name": "address_requests_per_s_max", "value": 2 }));
    // Others are not concerned, nor is this machine.
    ask("198.51.100.8").ok().await;
    for _ in 0..20 {
        app.get("/api/v1/episodes").ok().await;
    }
    app.pass(Duration::from_millis(499));
    ask("198.51.100.7").problem(429, "rate_limited").await;
    app.pass(Duration::from_millis(1));
    ask("198.51.100.7").ok().await;
    let metrics = app.get("/metrics").send().await.text();
    assert!(
        metrics.contains("swarmbench_rate_limited_total{limit=\"address_requests_per_s_max\"}")
    );
}

#[tokio::test]
async fn a_key_that_asks_too_often_takes_nothing_from_others() {
    let app = TestApp::builder()
        .manual_clock()
        .keys()
        .limits(|limits| limits.key_requests_per_s_max = 5)
        .start()
        .await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (red, _) = app.key(json!({ "name": "red" })).await;
    let episode = app.create_with(&blue, request()).await;
    // The tokens of its episodes count for the key.
    for _ in 0..4 {
        app.obs(episode.seat(0)).await;
        app.obs(episode.seat(1)).await;
    }
    app.get("/api/v1/episodes").token(&blue).ok().await;
    app.get("/obs").token(episode.seat(0)).problem(429, "rate_limited").await;
    app.get("/api/v1/episodes").token(&blue).problem(429, "rate_limited").await;
    app.get("/api/v1/episodes").token(&red).ok().await;
    app.pass(Duration::from_secs(1));
    app.obs(episode.seat(0)).await;
}

#[tokio::test]
async fn a_key_has_a_share_of_the_episodes() {
    let app =
        TestApp::builder().keys().limits(|limits| limits.episodes_per_key_max = 2).start().await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (red, _) = app.key(json!({ "name": "red" })).await;
    let first = app.create_with(&blue, request()).await;
    app.create_with(&blue, request()).await;
    let create = |key: &str| app.post("/api/v1/episodes").token(key).json(&request());
    let problem = create(&blue).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_per_key_max");
    create(&red).ok().await;
    app.delete(&first.path("")).token(&blue).ok().await;
    create(&blue).ok().await;
}

#[tokio::test]
async fn an_episode_that_talks_too_much_may_still_act() {
    let mut app = TestApp::builder()
        .limits(|limits| limits.journal_bytes_per_episode_max = 20_000)
        .start()
        .await;
    let episode = app.create(request()).await;
    let talk =
        |round: u64| json!({ "round": round, "action": "STAY", "reasoning": "x".repeat(9_000) });
    for round in 0..2 {
        app.act(episode.seat(0), &talk(round)).await;
        app.act(episode.seat(1), &json!({ "round": round, "action": "STAY" })).await;
    }
    // It is counted again after a restart.
    for restart in [false, true] {
        if restart {
            app.restart().await;
        }
        let refused = app.post("/act").token(episode.seat(0)).json(&talk(2));
        let problem = refused.problem(413, "too_large").await;
        assert_eq!(problem["limit"]["name"], "journal_bytes_per_episode_max");
        // What was taken is still answered.
        assert_eq!(app.act(episode.seat(0), &talk(1)).await["duplicate"], true);
    }
    let act = json!({ "round": 2, "action": "STAY", "message": "🐝".repeat(120) });
    assert_eq!(app.act(episode.seat(0), &act).await["duplicate"], false);
}

#[tokio::test]
async fn a_key_that_filled_its_share_of_the_journal_creates_nothing_more() {
    let mut app = TestApp::builder()
        .keys()
        .limits(|limits| limits.journal_bytes_per_key_max = 10_000)
        .start()
        .await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (first, second) =
        (app.create_with(&blue, request()).await, app.create_with(&blue, request()).await);
    let talk = json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(6_000) });
    for episode in [&first, &second] {
        // The second one brings it over its share.
        let sent = app.post("/act").token(episode.seat(0)).json(&talk).send().await;
        assert_eq!(sent.status, if episode.id == first.id { 200 } else { 413 });
    }
    for seat in [1, 0] {
        let act = json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(1_900) });
        for episode in [&first, &second] {
            app.post("/act").token(episode.seat(seat)).json(&act).send().await;
        }
    }
    app.delete(&first.path("")).token(&blue).ok().await;
    for _ in 0..2 {
        let create = app.post("/api/v1/episodes").token(&blue).json(&request());
        let problem = create.problem(403, "forbidden").await;
        assert_eq!(problem["limit"]["name"], "journal_bytes_per_key_max");
        // Small acts are always taken.
        app.act(
            second.seat(1),
            &json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(1_900) }),
        )
        .await;
        // What has ended and what runs is counted again after a restart.
        app.restart().await;
    }
}

#[tokio::test]
async fn a_disk_that_fills_up_ends_creations_and_nothing_else() {
    let app = TestApp::builder().start().await;
    let episode = app.create(request()).await;
    app.disk.set(4);
    let refused = app.post("/api/v1/episodes").json(&request()).send().await;
    assert_eq!((refused.status, refused.header("retry-after")), (503, "60"));
    assert_eq!(refused.json()["limit"], json!({ "name": "disk_free_percent_min", "value": 5 }));
    app.all_act(&episode, "STAY").await;
    app.get("/readyz").ok().await;
    // All servers of these tests share the metrics: another one may have told of its own disk in between.
    let mut told = false;
    for _ in 0..100 {
        let metrics = app.get("/metrics").send().await.text();
        told |= metrics.contains("swarmbench_disk_free_percent 4");
    }
    assert!(told, "the metrics never told how much of the disk is free");
    app.disk.set(5);
    app.create(request()).await;
}

#[tokio::test]
async fn many_large_bodies_at_once_are_told_to_come_again() {
    let app = TestApp::builder().limits(|limits| limits.bodies_bytes_max = 10_000).start().await;
    let episode = app.create(request()).await;
    let act =
        |bytes: usize| json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(bytes) });
    let sent = app.post("/act").token(episode.seat(0)).json(&act(11_000));
    let problem = sent.problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "bodies_bytes_max", "value": 10_000 }));
    // What was given up does not count any more.
    for _ in 0..3 {
        app.act(episode.seat(0), &act(9_000)).await;
    }
}

#[tokio::test]
async fn large_bodies_come_at_a_pace_and_small_ones_always() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.large_body_bytes_per_key_s_max = 200 * 1024);
    let app = app.start().await;
    let (key, _) = app.key(json!({ "name": "blue" })).await;
    let episode = app.create_with(&key, request()).await;
    let act = |round: u32, kib: usize| {
        let text = "x".repeat(kib * 1024);
        json!({ "round": round, "action": "STAY", "reasoning": text })
    };
    // Two seconds' worth at once.
    app.act(episode.seat(0), &act(0, 190)).await;
    app.act(episode.seat(1), &act(0, 190)).await;
    let late = || app.post("/act").token(episode.seat(0)).json(&act(0, 190));
    let problem = late().problem(429, "rate_limited").await;
    let limit = json!({ "name": "large_body_bytes_per_key_s_max", "value": 200 * 1024 });
    assert_eq!(problem["limit"], limit);
    app.act(episode.seat(0), &act(1, 120)).await;
    app.pass(Duration::from_secs(1));
    assert_eq!(late().ok().await["duplicate"], true);
}

/// What `/metrics` says of something that is counted in whole numbers.
fn metric(text: &str, name: &str) -> u64 {
    let line = text.lines().find(|line| line.starts_with(name) && !line.starts_with('#'));
    line.and_then(|line| line.rsplit(' ').next()?.parse().ok())
        .unwrap_or_else(|| panic!("{name} is missing in {text}"))
}

/// Waits for the server's next sweep.
pub(crate) async fn until_in_memory(app: &TestApp, expected: u64) {
    for _ in 0..2_000 {
        let metrics = app.get("/metrics").send().await.text();
        if metric(&metrics, "swarmbench_episodes_in_memory") == expected {
            return;
        }
        app.pass(Duration::from_secs(1));
    }
    panic!("there are never {expected} episodes in memory");
}

#[tokio::test]
async fn episodes_that_nobody_asks_for_leave_memory_and_come_back() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request()).await;
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

#[tokio::test]
async fn a_clock_keeps_its_episode_in_memory() {
    let app = TestApp::with_manual_clock().await;
    let slow = json!({ "task": "Synchronization", "num_agents": 2, "round_deadline_s": 3600 });
    let episode = app.create(slow).await;
    app.create(request()).await;
    until_in_memory(&app, 1).await;
    app.pass(Duration::from_hours(1));
    assert_eq!(app.obs_after(episode.seat(0), 0).await["round"], 1, "the clock ran out");
}

#[tokio::test]
async fn forgotten_episodes_are_abandoned_in_memory_or_not() {
    let mut app = TestApp::with_manual_clock().await;
    let mut forgotten = request();
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
    let metrics = app.get("/metrics").send().await.text();
    assert_eq!(metric(&metrics, "swarmbench_episodes_unfinished"), 0);
}
