//! Request rates by address and by key, and the host that a request names.

use std::time::Duration;

use serde_json::json;
use swarmbench_testkit::needs;

use crate::app::raw::Raw;
use crate::app::{TestApp, game};

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

#[needs(own_server)]
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
    let episode = app.create_with(&blue, game(2, 50)).await;
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
async fn a_request_says_once_for_which_host_it_is() {
    let app = TestApp::start().await;
    for (line, headers, status) in [
        ("GET /healthz HTTP/1.1", "Host: test\r\n", 200),
        ("GET /healthz HTTP/1.1", "Host: [::1]:8080\r\n", 200),
        ("GET /healthz HTTP/1.1", "Host:\r\n", 200),
        ("GET /healthz HTTP/1.0", "", 200),
        ("GET /healthz HTTP/1.0", "Host: test\r\n", 200),
        ("GET /healthz HTTP/1.1", "", 400),
        ("GET /healthz HTTP/1.1", "Host: test\r\nHost: test\r\n", 400),
        ("GET /healthz HTTP/1.0", "Host: test\r\nhost: other\r\n", 400),
        ("GET /healthz HTTP/1.1", "Host: one, two\r\n", 400),
        ("GET /healthz HTTP/1.1", "Host: user@test\r\n", 400),
        ("GET http://test/healthz HTTP/1.1", "", 400),
        ("GET /no-such-route HTTP/1.1", "", 400),
    ] {
        let mut raw = Raw::open(&app).await;
        raw.send(&format!("{line}\r\n{headers}\r\n")).await;
        let answer = raw.answer().await.expect("an answer");
        assert_eq!(answer.status, status, "{line} {headers:?}: {}", answer.head);
        if status == 400 {
            assert_eq!(answer.json()["code"], "malformed", "{headers:?}");
            assert!(answer.json()["detail"].to_string().contains("Host"), "{headers:?}");
        }
    }
}
