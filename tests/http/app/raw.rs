//! HTTP byte by byte, for clients that are slow or wrong.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::{Episode, PATIENCE, TestApp};

/// A connection whose bytes the test sends and reads itself.
pub(crate) struct Raw {
    stream: TcpStream,
    /// Bytes that were received and not read yet.
    pub(crate) received: Vec<u8>,
}

/// An answer as it came.
pub(crate) struct RawAnswer {
    pub(crate) status: u16,
    /// In lower case.
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl RawAnswer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

impl Raw {
    pub(crate) async fn open(app: &TestApp) -> Self {
        let address = app.base().strip_prefix("http://").expect("an address");
        let stream = TcpStream::connect(address).await.expect("a connection");
        Self { stream, received: Vec::new() }
    }

    pub(crate) async fn send(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).await.expect("it is open");
    }

    /// Asks for the observation after the first round, which it waits for.
    pub(crate) async fn wait_for_round(&mut self, episode: &Episode, headers: &str) {
        let token = episode.seat(0);
        self.send(&format!(
            "GET /obs?after=0&wait=60 HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n{headers}\r\n"
        ))
        .await;
    }

    pub(crate) async fn get(&mut self, path: &str) -> RawAnswer {
        self.send(&format!("GET {path} HTTP/1.1\r\nHost: test\r\n\r\n")).await;
        self.answer().await.expect("an answer")
    }

    /// Receives some more; whether there was more.
    pub(crate) async fn receive(&mut self) -> bool {
        let received = timeout(PATIENCE, self.stream.read_buf(&mut self.received)).await;
        // One that was closed while something was on its way to it is reset.
        received.expect("it goes on, or is closed").is_ok_and(|count| count > 0)
    }

    /// The next answer, if it is complete before the connection is closed.
    pub(crate) async fn answer(&mut self) -> Option<RawAnswer> {
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
    pub(crate) async fn closed(&mut self) {
        while self.receive().await {}
    }

    /// Sends a byte now and then until something comes back, or the connection is closed.
    pub(crate) async fn dribble(&mut self, byte: u8) {
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

/// Interval between two bytes of a slow client.
const NOW_AND_THEN: Duration = Duration::from_millis(20);

pub(crate) async fn playing(app: &TestApp) -> Episode {
    let request = json!({ "task": "Synchronization", "seed": 6, "num_agents": 2, "max_round": 4 });
    app.create(request).await
}

/// The head of a request that acts, with a body of `length` bytes.
pub(crate) fn act_head(episode: &Episode, length: usize) -> String {
    let token = episode.seat(0);
    format!(
        "POST /act HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/json\r\nContent-Length: {length}\r\n"
    )
}

/// True if connections were cut for this reason, by any test of this process.
pub(crate) async fn was_cut(app: &TestApp, reason: &str) -> bool {
    cuts(app, reason).await > 0
}

/// Number of connections that servers of this process have cut for a reason.
pub(crate) async fn cuts(app: &TestApp, reason: &str) -> u64 {
    let metrics = app.get("/metrics").send().await.text();
    let series = format!("swarmbench_connections_cut_total{{reason=\"{reason}\"}} ");
    let count = metrics.lines().find_map(|line| line.strip_prefix(&series));
    count.map_or(0, |count| count.parse().expect("a whole number"))
}
