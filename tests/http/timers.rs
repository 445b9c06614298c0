//! Timeouts of connections.

use std::time::Duration;

use serde_json::json;
use tokio::time::Instant;

use crate::app::raw::{Raw, act_head, cuts, playing, was_cut};
use crate::app::{TestApp, check_problem, until};

/// Waits for longer than heads may take, by a connection that is cut for it.
async fn outlast_a_head(app: &TestApp) {
    let mut slow = Raw::open(app).await;
    slow.send("GET /obs HT").await;
    slow.closed().await;
}

#[tokio::test]
async fn a_head_that_dribbles_in_is_cut() {
    let app = TestApp::builder().limits(|limits| limits.head_ms_max = 200).start().await;
    let mut first = Raw::open(&app).await;
    first.dribble(b'G').await;
    first.closed().await;
    assert!(first.received.is_empty());

    // Not only at the beginning of a connection.
    let mut second = Raw::open(&app).await;
    assert_eq!(second.get("/healthz").await.status, 200);
    second.dribble(b'G').await;
    second.closed().await;

    // Nor does it help to say nothing.
    Raw::open(&app).await.closed().await;
    assert!(was_cut(&app, "head").await);
}

#[tokio::test]
async fn a_body_that_dribbles_in_is_refused_and_changes_nothing() {
    let app = TestApp::builder()
        .limits(|limits| {
            limits.body_ms_max = 200;
            limits.body_bytes_per_s_min = 1_000_000;
        })
        .start()
        .await;
    let episode = playing(&app).await;
    let mut slow = Raw::open(&app).await;
    slow.send(&format!("{}\r\n{}", act_head(&episode, 100_000), r#"{"round": 0, "action": "UP"}"#))
        .await;
    slow.dribble(b' ').await;
    let answer = slow.answer().await.expect("an answer");
    check_problem(&answer.json(), 400, "malformed");
    assert_eq!(answer.status, 400);
    slow.closed().await;
    assert!(was_cut(&app, "body").await);
    assert_eq!(app.obs(episode.seat(0)).await["acted"], false);
}

#[tokio::test]
async fn a_body_that_keeps_coming_may_take_its_time() {
    // Each byte is worth a second.
    let app = TestApp::builder()
        .limits(|limits| {
            limits.body_ms_max = 200;
            limits.body_bytes_per_s_min = 1;
        })
        .start()
        .await;
    let episode = playing(&app).await;
    let act = r#"{"round": 0, "action": "UP"}"#;
    let mut slow = Raw::open(&app).await;
    let started = Instant::now();
    slow.send(&format!("{}\r\n{act}", act_head(&episode, act.len() + 20))).await;
    slow.dribble(b' ').await;
    assert!(started.elapsed() > Duration::from_millis(200));
    assert_eq!(slow.answer().await.expect("an answer").status, 200);
}

#[tokio::test]
async fn an_idle_connection_is_kept_for_longer_than_a_head_may_take_and_then_closed() {
    let app = TestApp::builder()
        .limits(|limits| {
            limits.head_ms_max = 300;
            limits.idle_ms_max = 500;
        })
        .start()
        .await;
    let mut idle = Raw::open(&app).await;
    let asked = Instant::now();
    assert_eq!(idle.get("/healthz").await.status, 200);
    idle.closed().await;
    assert!(asked.elapsed() >= Duration::from_millis(500), "{:?}", asked.elapsed());
    assert!(was_cut(&app, "idle").await);
}

#[tokio::test]
async fn a_long_poll_waits_for_longer_than_anything_else_may_take() {
    let app = TestApp::builder()
        .limits(|limits| {
            limits.head_ms_max = 300;
            limits.write_ms_max = 300;
            limits.idle_ms_max = 300;
        })
        .start()
        .await;
    let episode = playing(&app).await;
    let mut waiting = Raw::open(&app).await;
    waiting.wait_for_round(&episode, "").await;
    for _ in 0..3 {
        outlast_a_head(&app).await;
    }
    app.all_act(&episode, "STAY").await;
    let answer = waiting.answer().await.expect("an answer");
    assert_eq!((answer.status, &answer.json()["round"]), (200, &json!(1)));
}

#[tokio::test]
async fn a_client_that_does_not_read_is_cut() {
    let app = TestApp::builder().limits(|limits| limits.write_ms_max = 200).start().await;
    // Far more than the buffers of both hosts hold.
    let asked = 1000;
    // The count is that of all servers of these tests: where another one has cut a client, this one is asked again.
    until("the client is cut", async || {
        let before = cuts(&app, "write").await;
        let mut deaf = Raw::open(&app).await;
        deaf.send(&"GET /openapi.json HTTP/1.1\r\nHost: test\r\n\r\n".repeat(asked)).await;
        until("the server has enough", async || cuts(&app, "write").await > before).await;
        let mut answered = 0;
        while deaf.answer().await.is_some() {
            answered += 1;
        }
        // The first answer may be larger than what the hosts hold for a client that is cut.
        answered < asked
    })
    .await;
}
