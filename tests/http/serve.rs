//! The server stops while connections are open.

use tokio::time::timeout;

use crate::app::raw::{Raw, act_head, playing};
use crate::app::{PATIENCE, TestApp};

/// Far longer than any test takes.
const NEVER_MS: u64 = 1_000_000;

#[tokio::test]
async fn idle_connections_do_not_hold_up_the_end() {
    let mut app = TestApp::builder().limits(|limits| limits.drain_ms_max = NEVER_MS).start().await;
    let (mut idle, mut fresh) = (Raw::open(&app).await, Raw::open(&app).await);
    assert_eq!(idle.get("/healthz").await.status, 200);
    timeout(PATIENCE, app.stop()).await.expect("it ends at once");
    idle.closed().await;
    fresh.closed().await;
}

#[tokio::test]
async fn a_request_that_is_sent_by_halves_does_not_hold_up_the_end() {
    let mut app = TestApp::builder()
        .limits(|limits| {
            limits.head_ms_max = NEVER_MS;
            limits.body_ms_max = NEVER_MS;
            limits.drain_ms_max = 200;
        })
        .start()
        .await;
    let episode = playing(&app).await;
    let (mut head, mut body) = (Raw::open(&app).await, Raw::open(&app).await);
    head.send("GET /healthz HT").await;
    body.send(&format!("{}Expect: 100-continue\r\n\r\n", act_head(&episode, 100))).await;
    assert_eq!(body.answer().await.expect("it is asked to go on").status, 100);
    body.send(r#"{"round": 0, "#).await;
    timeout(PATIENCE, app.stop()).await.expect("it ends after the drain");
    head.closed().await;
    body.closed().await;
    assert!(body.received.is_empty());
}
