//! An endpoint whose answers a test decides.

use std::convert::Infallible;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Response, StatusCode, Uri};
use futures::StreamExt;
use futures::stream;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

/// Nothing takes this long; a test that hangs is to fail.
pub(crate) const PATIENCE: Duration = Duration::from_secs(100);

/// A request as it came.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    pub(crate) uri: Uri,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Value,
}

impl Seen {
    /// The prompt.
    pub(crate) fn prompt(&self) -> &str {
        let messages =
            ["messages", "input"].into_iter().find_map(|name| self.body[name].as_array());
        messages.expect("messages")[0]["content"].as_str().expect("a prompt")
    }
}

/// Reaction of the endpoint to a request.
pub(crate) struct Reply {
    status: u16,
    headers: Vec<(&'static str, String)>,
    body: Sent,
    stage: usize,
    after: Duration,
}

enum Sent {
    Whole(Bytes),
    /// The rest never comes.
    Stalls(Bytes),
    /// The connection breaks.
    Breaks(Bytes),
    /// The rest comes after a call of [`Endpoint::release`].
    Pauses(Bytes, Bytes),
    /// Pieces of so many bytes.
    Pieces(Bytes, usize),
}

impl Reply {
    pub(crate) fn text(status: u16, body: impl Into<Bytes>) -> Self {
        Self {
            status,
            headers: Vec::new(),
            body: Sent::Whole(body.into()),
            stage: 0,
            after: Duration::ZERO,
        }
    }

    pub(crate) fn json(status: u16, body: &Value) -> Self {
        Self::text(status, body.to_string()).header("content-type", "application/json")
    }

    /// A usual answer of 10 and 5 tokens.
    pub(crate) fn says(content: &str) -> Self {
        Self::json(200, &completion(&json!({ "role": "assistant", "content": content }), "stop"))
    }

    /// A stream of events.
    pub(crate) fn events(events: &[Value]) -> Self {
        let text = |event: &Value| match event.as_str() {
            Some(end) => format!("data: {end}\n\n"),
            None => {
                format!("event: {}\ndata: {event}\n\n", event["type"].as_str().unwrap_or("message"))
            }
        };
        let body: String = events.iter().map(text).collect();
        Self::text(200, body).header("content-type", "text/event-stream; charset=utf-8")
    }

    /// An error in the usual shape.
    pub(crate) fn error(status: u16, message: &str) -> Self {
        Self::json(status, &json!({ "error": { "message": message, "type": "test_error" } }))
    }

    pub(crate) fn header(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.headers.push((name, value.into()));
        self
    }

    /// Without a type.
    pub(crate) fn untyped(mut self) -> Self {
        self.headers.clear();
        self
    }

    /// The reply is held until so many calls of [`Endpoint::release`].
    pub(crate) fn held_until(mut self, stage: usize) -> Self {
        self.stage = stage;
        self
    }

    /// The reply is sent after this time, for measurements.
    pub(crate) fn after(mut self, after: Duration) -> Self {
        self.after = after;
        self
    }

    /// Half of it comes, and then nothing more.
    pub(crate) fn stalling(mut self) -> Self {
        self.body = Sent::Stalls(self.half());
        self
    }

    /// Half of it comes, and then the connection breaks.
    pub(crate) fn breaking(mut self) -> Self {
        self.body = Sent::Breaks(self.half());
        self
    }

    /// What was to come whole pauses before the first place of `text`.
    pub(crate) fn pausing_before(mut self, text: &str) -> Self {
        let Sent::Whole(bytes) = &self.body else { panic!("it is whole") };
        let whole = String::from_utf8_lossy(bytes);
        let at = whole.find(text).expect("the text");
        self.body = Sent::Pauses(bytes.slice(..at), bytes.slice(at..));
        self
    }

    /// It comes in pieces of so many bytes.
    pub(crate) fn in_pieces(mut self, bytes: usize) -> Self {
        let Sent::Whole(whole) = self.body else { panic!("it is whole") };
        self.body = Sent::Pieces(whole, bytes);
        self
    }

    /// Only so many bytes come, and then a good end.
    pub(crate) fn cut(mut self, bytes: usize) -> Self {
        let Sent::Whole(whole) = &self.body else { panic!("it is whole") };
        self.body = Sent::Whole(whole.slice(..bytes));
        self
    }

    fn half(&self) -> Bytes {
        let Sent::Whole(bytes) = &self.body else { panic!("it is whole") };
        bytes.slice(..bytes.len() / 2)
    }
}

/// A chat completion.
pub(crate) fn completion(message: &Value, finish_reason: &str) -> Value {
    json!({
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "choices": [{ "index": 0, "message": message, "finish_reason": finish_reason }],
        "usage": { "prompt_tokens": 10, "completion_tokens": 5, "total_tokens": 15 },
    })
}

type Act = dyn Fn(usize, &Seen) -> Reply + Send + Sync;

struct Shared {
    act: Box<Act>,
    seen: watch::Sender<Vec<Seen>>,
    stage: watch::Sender<usize>,
    in_flight: Mutex<(usize, usize)>,
}

/// A server on loopback.
pub(crate) struct Endpoint {
    base: String,
    shared: Arc<Shared>,
    task: JoinHandle<()>,
    connections: CancellationToken,
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Endpoint {
    /// Does with each request, counted from 0, what `act` says.
    pub(crate) async fn start(act: impl Fn(usize, &Seen) -> Reply + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            act: Box::new(act),
            seen: watch::Sender::default(),
            stage: watch::Sender::new(0),
            in_flight: Mutex::default(),
        });
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let base = format!("http://{}/v1", listener.local_addr().expect("an address"));
        let router = Router::new().fallback(serve).with_state(shared.clone());
        let connections = CancellationToken::new();
        let end = connections.clone();
        let task = tokio::spawn(async move {
            let serve = axum::serve(listener, router);
            serve.with_graceful_shutdown(end.cancelled_owned()).await.expect("it serves");
        });
        Self { base, shared, task, connections }
    }

    /// Answers the first requests with these replies, in order, and all others as a good endpoint does.
    pub(crate) async fn replies(replies: Vec<Reply>) -> Self {
        let replies: Mutex<Vec<_>> = Mutex::new(replies.into_iter().rev().collect());
        Self::start(move |_, _| {
            let next = replies.lock().expect("a lock").pop();
            next.unwrap_or_else(|| Reply::says("ACTION: UP"))
        })
        .await
    }

    /// The server goes, and its connections with it.
    pub(crate) async fn ends(mut self) {
        self.connections.cancel();
        let task = std::mem::replace(&mut self.task, tokio::spawn(async {}));
        task.await.expect("it ends");
    }

    pub(crate) fn base(&self) -> &str {
        &self.base
    }

    /// All requests that came.
    pub(crate) fn seen(&self) -> Vec<Seen> {
        self.shared.seen.borrow().clone()
    }

    /// Waits for a number of requests.
    pub(crate) async fn has_seen(&self, count: usize) {
        let mut seen = self.shared.seen.subscribe();
        let all = timeout(PATIENCE, seen.wait_for(|seen| seen.len() >= count)).await;
        all.expect("they come").expect("it is there");
    }

    /// Lets out what is held until the next stage.
    pub(crate) fn release(&self) {
        self.shared.stage.send_modify(|stage| *stage += 1);
    }

    /// Maximum requests at once since the last call.
    pub(crate) fn most_at_once(&self) -> usize {
        let mut in_flight = self.shared.in_flight.lock().expect("a lock");
        let most = in_flight.1;
        in_flight.1 = in_flight.0;
        most
    }
}

async fn serve(State(shared): State<Arc<Shared>>, request: Request) -> Response<Body> {
    let (head, body) = request.into_parts();
    let bytes = axum::body::to_bytes(body, usize::MAX).await.expect("a body");
    let seen = Seen {
        uri: head.uri,
        headers: head.headers,
        body: serde_json::from_slice(&bytes).expect("JSON"),
    };
    {
        let mut in_flight = shared.in_flight.lock().expect("a lock");
        in_flight.0 += 1;
        in_flight.1 = in_flight.1.max(in_flight.0);
    }
    let mut number = 0;
    shared.seen.send_modify(|all| {
        number = all.len();
        all.push(seen.clone());
    });
    let reply = (shared.act)(number, &seen);
    let mut stage = shared.stage.subscribe();
    stage.wait_for(|stage| *stage >= reply.stage).await.expect("it is there");
    if !reply.after.is_zero() {
        tokio::time::sleep(reply.after).await;
    }
    shared.in_flight.lock().expect("a lock").0 -= 1;
    let mut response =
        Response::builder().status(StatusCode::from_u16(reply.status).expect("a status"));
    for (name, value) in reply.headers {
        response = response.header(name, value);
    }
    let body = match reply.body {
        Sent::Whole(bytes) => Body::from(bytes),
        Sent::Stalls(bytes) => {
            let first = stream::iter([Ok::<_, Infallible>(bytes)]);
            Body::from_stream(first.chain(stream::pending()))
        }
        Sent::Pauses(first, rest) => {
            let rest = stream::once(async move {
                let now = *stage.borrow();
                stage.wait_for(|stage| *stage > now).await.expect("it is there");
                Ok::<_, Infallible>(rest)
            });
            Body::from_stream(stream::iter([Ok(first)]).chain(rest))
        }
        Sent::Pieces(whole, bytes) => {
            let starts = (0..whole.len()).step_by(bytes);
            let piece = move |at: usize| whole.slice(at..whole.len().min(at + bytes));
            Body::from_stream(stream::iter(starts.map(move |at| Ok::<_, Infallible>(piece(at)))))
        }
        Sent::Breaks(bytes) => {
            Body::from_stream(stream::iter([Ok(bytes), Err(std::io::Error::other("broken"))]))
        }
    };
    response.body(body).expect("a response")
}
