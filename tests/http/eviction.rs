//! More connections than the limit: refused, or one of the greediest client is evicted.

use serde_json::json;
use tokio::time::timeout;

use crate::app::raw::{Raw, playing, was_cut};
use crate::app::{PATIENCE, TestApp, check_problem};

#[tokio::test]
async fn a_connection_beyond_the_limit_is_refused_at_once() {
    // One place is for the test's own client.
    let app = TestApp::builder().limits(|limits| limits.connections_max = 3).start().await;
    let (mut first, mut second) = (Raw::open(&app).await, Raw::open(&app).await);
    for served in [&mut first, &mut second] {
        assert_eq!(served.get("/healthz").await.status, 200);
    }
    for path in ["/healthz", "/no-such-route"] {
        let mut third = Raw::open(&app).await;
        let answer = third.get(path).await;
        assert_eq!(answer.status, 503);
        let problem = answer.json();
        check_problem(&problem, 503, "overloaded");
        assert_eq!(problem["limit"], json!({ "name": "connections_max", "value": 3 }));
        for header in ["retry-after: 5", "connection: close", "x-request-id: "] {
            assert!(answer.head.contains(header), "{header} is missing in {}", answer.head);
        }
        third.closed().await;
    }
    // One that says nothing is not listened to for long.
    Raw::open(&app).await.closed().await;
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_connections_refused_total{reason=\"server\"}"));

    for served in [&mut first, &mut second] {
        assert_eq!(served.get("/healthz").await.status, 200);
    }
    drop(second);
    let again = async { while Raw::open(&app).await.get("/healthz").await.status != 200 {} };
    timeout(PATIENCE, again).await.expect("the place is free at some time");
}

/// Asks on this connection for a client behind the proxy.
async fn ask_for(raw: &mut Raw, client: &str) -> u16 {
    let head = format!("GET /healthz HTTP/1.1\r\nHost: test\r\nX-Forwarded-For: {client}\r\n\r\n");
    raw.send(&head).await;
    raw.answer().await.expect("an answer").status
}

#[tokio::test]
async fn a_client_behind_a_proxy_that_has_most_places_makes_room_for_another() {
    // One place is for the test's own client.
    let app = TestApp::builder()
        .limits(|limits| limits.connections_max = 7)
        .access(|access| access.trusted_proxies = vec!["127.0.0.0/8".parse().expect("a net")])
        .start()
        .await;
    let episode = playing(&app).await;
    let mut waiting = Raw::open(&app).await;
    waiting.wait_for_round(&episode, "X-Forwarded-For: 192.0.2.2\r\n").await;
    let mut greedy = Vec::new();
    for _ in 0..5 {
        let mut one = Raw::open(&app).await;
        assert_eq!(ask_for(&mut one, "192.0.2.1").await, 200);
        greedy.push(one);
    }
    // All places are taken, and each is idle for less time than the one before it.
    let mut others = Vec::new();
    for first in &mut greedy[..3] {
        let mut other = Raw::open(&app).await;
        assert_eq!(ask_for(&mut other, "192.0.2.3").await, 200);
        first.closed().await;
        others.push(other);
    }
    for kept in &mut greedy[3..] {
        assert_eq!(ask_for(kept, "192.0.2.1").await, 200);
    }
    assert!(was_cut(&app, "room").await);
    app.all_act(&episode, "STAY").await;
    assert_eq!(waiting.answer().await.expect("an answer").json()["round"], json!(1));
}
