//! Large bodies: how many at once, and how many a second.

use std::time::Duration;

use serde_json::json;

use crate::app::{TestApp, game};

#[tokio::test]
async fn too_many_large_bodies_at_once_are_refused() {
    let app = TestApp::builder().limits(|limits| limits.bodies_bytes_max = 10_000).start().await;
    let episode = app.create(game(2, 50)).await;
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
    let episode = app.create_with(&key, game(2, 50)).await;
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
