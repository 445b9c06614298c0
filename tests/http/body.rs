//! Bodies: how large without a token, and how much memory they take at once.

use std::time::Duration;

use serde_json::json;
use swarmbench_testkit::needs;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use crate::app::{TestApp, game};

#[tokio::test]
async fn too_many_large_bodies_at_once_are_refused() {
    let app = TestApp::builder().limits(|limits| limits.bodies_bytes_max = 20_000).start().await;
    let episode = app.create(game(2, 50)).await;
    let act =
        |bytes: usize| json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(bytes) });
    // Each byte counts three times, and as much again is there for those who play.
    let sent = app.post("/act").token(episode.seat(0)).json(&act(14_000));
    let problem = sent.problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "bodies_bytes_max", "value": 20_000 }));
    // What was given up does not count any more.
    for _ in 0..3 {
        app.act(episode.seat(0), &act(12_000)).await;
    }
}

#[tokio::test]
async fn a_body_without_a_token_has_room_for_its_fields_and_no_more() {
    let app = TestApp::builder().access(|access| access.open = true).start().await;
    let create = |template: usize| {
        let template = "x".repeat(template);
        app.post("/api/v1/episodes")
            .json(&json!({ "task": "Foraging", "prompt_template": template }))
    };
    create(32_000).ok().await;
    let problem = create(70_000).problem(413, "too_large").await;
    assert_eq!(problem["limit"], json!({ "name": "anonymous_body_bytes_max", "value": 65_536 }));
}

/// Sends the head of a request with a body that never comes; the answer has to come without it.
async fn without_its_body(app: &TestApp, method: &str, path: &str, token: &str) -> String {
    let address = app.base().strip_prefix("http://").expect("an address");
    let mut stream = TcpStream::connect(address).await.expect("open");
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{token}Content-Length: 60000\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).await.expect("it is open");
    let mut answer = vec![0; 15];
    let read = stream.read_exact(&mut answer);
    tokio::time::timeout(Duration::from_mins(1), read).await.expect("an answer").expect("bytes");
    String::from_utf8_lossy(&answer[9..12]).into_owned()
}

const UNKNOWN: &str =
    "Authorization: Bearer seat_aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\r\n";

/// A server whose requests may take longer to send their bodies than the test takes.
async fn patient() -> TestApp {
    TestApp::builder().keys().limits(|limits| limits.body_ms_max = 1_000_000).start().await
}

#[tokio::test]
async fn an_unknown_token_is_refused_without_its_body() {
    let app = patient().await;
    for path in ["/act", "/swarm/act", "/api/v1/episodes", "/api/v1/competitions", "/api/v1/keys"] {
        assert_eq!(without_its_body(&app, "POST", path, UNKNOWN).await, "401", "{path}");
    }
}

#[needs(own_server)]
#[tokio::test]
async fn no_body_is_read_before_it_is_known_who_sends_it() {
    let app = patient().await;
    for (path, status) in [
        ("/act", "401"),
        ("/api/v1/episodes", "401"),
        ("/api/v1/runs", "401"),
        ("/api/v1/keys", "401"),
        ("/api/v1/competitions/nope/entrants", "404"),
        ("/api/v1/competitions/nope/attempts", "401"),
        ("/api/v1/episodes/nope/claims", "401"),
        ("/api/v1/episodes/nope/fork", "401"),
    ] {
        assert_eq!(without_its_body(&app, "POST", path, "").await, status, "{path}");
    }
}
