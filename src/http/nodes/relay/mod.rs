//! Many requests at once over one connection between two servers: those by which single seats are played. They are many and
//! short, and a connection for each would cost more system calls than the game itself.
//!
//! A server posts to [`PATH`] of another one and leaves the request open. Its body is a stream of [`Ask`], the body of the answer
//! one of [`Reply`]; each has its length before it. All that was queued while the connection was busy is sent as one piece.
//! What does not fit ([`Reply::ByHttp`]) is sent as a request of its own.

mod ask;
mod reply;

use std::convert::Infallible;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use bytes::{Bytes, BytesMut};
use futures::{Stream, StreamExt as _, TryStreamExt as _, stream};
use serde::{Deserialize, Serialize};
use tokio_util::codec::{Encoder as _, FramedRead, LengthDelimitedCodec};
use tokio_util::io::StreamReader;

pub(super) use ask::{Relay, Relayed};
pub(in super::super) use reply::answer;

/// Where a server takes the requests of another one.
pub(in super::super) const PATH: &str = "/cluster/relay";

/// Bytes that wait to be sent to another server.
const QUEUED_BYTES_MAX: usize = 16 * 1024 * 1024;

/// Bytes of a message as most are.
const MESSAGE_BYTES: usize = 1024;

/// Requests of another server that are answered at once.
const ANSWERING_MAX: usize = 20_000;

/// Headers of a request, or of an answer.
type Headers<'a> = Vec<(&'a str, &'a serde_bytes::Bytes)>;

#[derive(Debug, Serialize, Deserialize)]
enum Ask<'a> {
    Request {
        /// Another one for each request of a connection.
        id: u64,
        method: &'a str,
        path: &'a str,
        #[serde(borrow)]
        headers: Headers<'a>,
        body: &'a serde_bytes::Bytes,
    },
    /// Nobody waits for its answer any more.
    Cancelled { id: u64 },
}

#[derive(Debug, Serialize, Deserialize)]
enum Reply<'a> {
    Answered {
        id: u64,
        status: u16,
        #[serde(borrow)]
        headers: Headers<'a>,
        body: &'a serde_bytes::Bytes,
    },
    /// The answer is too long, or too many requests are being answered: it may be sent as a request of its own.
    ByHttp { id: u64 },
}

fn header<'a>(name: &'a HeaderName, value: &'a HeaderValue) -> (&'a str, &'a serde_bytes::Bytes) {
    (name.as_str(), serde_bytes::Bytes::new(value.as_bytes()))
}

fn headers_to(headers: &HeaderMap) -> Headers<'_> {
    // There is room for what a server adds.
    let mut all = Headers::with_capacity(headers.len() + 2);
    all.extend(headers.iter().map(|(name, value)| header(name, value)));
    all
}

/// Reads headers out of the message that holds them.
fn headers_of(message: &Bytes, headers: &Headers<'_>) -> Option<HeaderMap> {
    let mut read = HeaderMap::with_capacity(headers.len());
    for (name, value) in headers {
        let name = HeaderName::from_bytes(name.as_bytes()).ok()?;
        let value = HeaderValue::from_maybe_shared(message.slice_ref(value)).ok()?;
        read.append(name, value);
    }
    Some(read)
}

/// The messages in a body.
fn messages(body: Body) -> impl Stream<Item = io::Result<Bytes>> + Unpin {
    let bytes = StreamReader::new(body.into_data_stream().map_err(io::Error::other));
    FramedRead::new(bytes, LengthDelimitedCodec::new()).map_ok(BytesMut::freeze)
}

/// Messages that wait to be sent.
#[derive(Debug, Default)]
struct Queue {
    state: Mutex<Queued>,
}

#[derive(Debug, Default)]
struct Queued {
    bytes: BytesMut,
    is_closed: bool,
    sender: Option<Waker>,
}

impl Queue {
    fn state(&self) -> MutexGuard<'_, Queued> {
        self.state.lock().expect("nothing panics while it holds this")
    }

    /// Adds a message; whether there was room for it.
    fn push(&self, message: &impl Serialize) -> bool {
        let buffer = Vec::with_capacity(MESSAGE_BYTES);
        let Ok(message) = postcard::to_extend(message, buffer) else { return false };
        let mut state = self.state();
        if state.is_closed || state.bytes.len() + message.len() > QUEUED_BYTES_MAX {
            return false;
        }
        if LengthDelimitedCodec::new().encode(&message[..], &mut state.bytes).is_err() {
            return false;
        }
        let sender = state.sender.take();
        drop(state);
        sender.into_iter().for_each(Waker::wake);
        true
    }

    /// Ends the stream after what is queued.
    fn close(&self) {
        let mut state = self.state();
        state.is_closed = true;
        let sender = state.sender.take();
        drop(state);
        sender.into_iter().for_each(Waker::wake);
    }

    fn poll(&self, context: &Context<'_>) -> Poll<Option<Bytes>> {
        let mut state = self.state();
        if !state.bytes.is_empty() {
            return Poll::Ready(Some(state.bytes.split().freeze()));
        }
        if state.is_closed {
            return Poll::Ready(None);
        }
        state.sender = Some(context.waker().clone());
        Poll::Pending
    }

    /// A body with all that is queued, until the queue is closed.
    fn body(self: &Arc<Self>) -> Body {
        let queue = Arc::clone(self);
        let pieces = stream::poll_fn(move |context| queue.poll(context));
        Body::from_stream(pieces.map(Ok::<_, Infallible>))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_is_queued_arrives_message_by_message_until_the_end() {
        let queue = Arc::new(Queue::default());
        let mut headers = HeaderMap::new();
        headers.append("x-a", HeaderValue::from_static("1"));
        headers.append("x-a", HeaderValue::from_bytes(b"\xff").expect("opaque"));
        let ask = Ask::Request {
            id: 7,
            method: "POST",
            path: "/act",
            headers: headers_to(&headers),
            body: serde_bytes::Bytes::new(b"{}"),
        };
        assert!(queue.push(&ask) && queue.push(&Ask::Cancelled { id: 7 }));
        queue.close();
        assert!(!queue.push(&Ask::Cancelled { id: 8 }), "it is closed");
        let mut messages = messages(queue.body());
        let first = messages.next().await.expect("a message").expect("read");
        match postcard::from_bytes(&first) {
            Ok(Ask::Request { id: 7, method: "POST", path: "/act", headers: found, body }) => {
                assert_eq!((headers_of(&first, &found), &body[..]), (Some(headers), &b"{}"[..]));
            }
            other => panic!("{other:?}"),
        }
        let second = messages.next().await.expect("a message").expect("read");
        assert!(matches!(postcard::from_bytes(&second), Ok(Ask::Cancelled { id: 7 })));
        assert!(messages.next().await.is_none());
    }

    #[test]
    fn a_queue_that_nobody_empties_takes_so_much() {
        let queue = Queue::default();
        let body = vec![0; QUEUED_BYTES_MAX / 4];
        let reply = Reply::Answered {
            id: 1,
            status: 200,
            headers: Vec::new(),
            body: serde_bytes::Bytes::new(&body),
        };
        let taken = (0..10).filter(|_| queue.push(&reply)).count();
        assert_eq!(taken, 3);
    }
}
