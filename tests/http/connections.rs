//! Connections that are slow, idle or too many: they are ended, and nobody else notices.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout};

use crate::app::{Episode, PATIENCE, TestApp, check_problem};

/// How often a slow client sends a byte.
const NOW_AND_THEN: Duration = Duration::from_millis(20);

/// Far longer than any test takes.
const NEVER_MS: u64 = 1_000_000;

/// A connection of which the test holds every byte in its hands.
struct Raw {
    stream: TcpStream,
    /// What was received and not read yet.
    received: Vec<u8>,
}

/// An answer as it came.
struct RawAnswer {
    status: u16,
    /// In lower case.
    head: String,
    body: Vec<u8>,
}

impl RawAnswer {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

impl Raw {
    async fn open(app: &TestApp) -> Self {
        let address = app.base().strip_prefix("http://").expect("an address");
        let stream = TcpStream::connect(address).await.expect("a connection");
        Self { stream, received: Vec::new() }
    }

    async fn send(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).await.expect("it is open");
    }

    async fn get(&mut self, path: &str) -> RawAnswer {
        self.send(&format!("GET {path} HTTP/1.1\r\nHost: test\r\n\r\n")).await;
        self.answer().await.expect("an answer")
    }

    /// Receives some more; whether there was more.
    async fn receive(&mut self) -> bool {
        let received = timeout(PATIENCE, self.stream.read_buf(&mut self.received)).await;
        // One that was closed while something was on its way to it is reset.
        received.expect("it goes on, or is closed").is_ok_and(|count| count > 0)
    }

    /// The next answer; none where the connection is closed before its end.
    async fn answer(&mut self) -> Option<RawAnswer> {
        let end = loop {
            if let Some(at) = self.received.windows(4).position(|four| four == b"\r\n\r\n") {
                break at + 4;
            }
            if !self.receive().await {
                return None;
            }
        };
        let head = String::from_utf8(self.received.drain(..end).collect()).expect("ASCII");
        let head = head.to_lowercase();
        let length = head.split("content-length: ").nth(1).and_then(|rest| rest.lines().next());
        let length = length.map_or(0, |length| length.parse().expect("a number"));
        while self.received.len() < length {
            if !self.receive().await {
                return None;
            }
        }
        let status = head.split(' ').nth(1).expect("a status").parse().expect("a number");
        Some(RawAnswer { status, head, body: self.received.drain(..length).collect() })
    }

    /// Reads until the connection is closed.
    async fn closed(&mut self) {
        while self.receive().await {}
    }

    /// Sends a byte now and then until something comes back, or the connection is closed.
    async fn dribble(&mut self, byte: u8) {
        let mut ticks = tokio::time::interval(NOW_AND_THEN);
        let ended = timeout(PATIENCE, async {
            loop {
                tokio::select! {
                    () = async { drop(self.stream.readable().await) } => return,
                    _ = ticks.tick() => if self.stream.write_all(&[byte]).await.is_err() { return },
                }
            }
        });
        ended.await.expect("the server has enough at some time");
    }
}

async fn playing(app: &TestApp) -> Episode {
    let request = json!({ "task": "Synchronization", "seed": 6, "num_agents": 2, "max_round": 4 });
    app.create(request).await
}

/// The head of a request that acts, with a body of so many bytes.
fn act_head(episode: &Episode, length: usize) -> String {
    let token = episode.seat(0);
    format!(
        "POST /act HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/json\r\nContent-Length: {length}\r\n"
    )
}

/// Whether connections were cut for this reason, by any test of this process.
async fn was_cut(app: &TestApp, reason: &str) -> bool {
    let metrics = app.get("/metrics").send().await.text();
    metrics.contains(&format!("swarmbench_connections_cut_total{{reason=\"{reason}\"}}"))
}

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
            limits.head_ms_max = 50;
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
            limits.head_ms_max = 50;
            limits.write_ms_max = 50;
            limits.idle_ms_max = 50;
        })
        .start()
        .await;
    let episode = playing(&app).await;
    let mut waiting = Raw::open(&app).await;
    let token = episode.seat(0);
    waiting
        .send(&format!(
            "GET /obs?after=0&wait=60 HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n\r\n"
        ))
        .await;
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
    let mut deaf = Raw::open(&app).await;
    // Far more than the buffers of both hosts hold.
    let asked = 1000;
    deaf.send(&"GET /openapi.json HTTP/1.1\r\nHost: test\r\n\r\n".repeat(asked)).await;
    let cut = async { while !was_cut(&app, "write").await {} };
    timeout(PATIENCE, cut).await.expect("the server has enough at some time");
    let mut answered = 0;
    while deaf.answer().await.is_some() {
        answered += 1;
    }
    // The first answer may be larger than what the hosts hold for a client that is cut.
    assert!(answered < asked, "{answered}");
}

#[tokio::test]
async fn beyond_the_last_place_a_client_is_told_so_at_once() {
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
    let token = episode.seat(0);
    waiting
        .send(&format!(
            "GET /obs?after=0&wait=60 HTTP/1.1\r\nHost: test\r\nX-Forwarded-For: 192.0.2.2\r\n\
             Authorization: Bearer {token}\r\n\r\n"
        ))
        .await;
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
