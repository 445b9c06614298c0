//! Many requests at once over one connection between two servers: those by which single seats are played. They are many and
//! short, and a connection for each would cost more system calls than the game itself.
//!
//! A server posts to [`PATH`] of another one and leaves the request open. Its body is a stream of [`Ask`], the body of the answer
//! one of [`Reply`]; each has its length before it. All that was queued while the connection was busy is sent as one piece.
//! What does not fit ([`Reply::ByHttp`]), or is not answered as the connection ends, is sent as a request of its own.
//!
//! A server that stops says so ([`Reply::Closing`]), and answers what comes until the other one ends the body of its request.

mod ask;
mod reply;

use std::convert::Infallible;
use std::io;
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use bytes::{Bytes, BytesMut};
use futures::{Stream, StreamExt as _, TryStreamExt as _, stream};
use serde::{Deserialize, Serialize};
use tokio::sync::Notify;
use tokio_util::codec::{Encoder as _, FramedRead, LengthDelimitedCodec};
use tokio_util::io::StreamReader;
use tokio_util::sync::CancellationToken;

pub(super) use ask::Relay;
pub(in super::super) use reply::answer;

/// Where a server takes the requests of another one. Another form of messages needs another path.
pub(in super::super) const PATH: &str = "/cluster/relay/1";

/// Bytes of the messages in a queue. A longer message is queued only while the queue is empty.
const QUEUED_BYTES_MAX: usize = 1024 * 1024;

/// Bytes of a message as most are, and of the longest: an answer to acts, which are not done again for their answer.
const MESSAGE_BYTES: usize = 1024;
const MESSAGE_BYTES_MAX: usize = 32 * 1024 * 1024;

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
    /// The answer is too long, or too many requests are being answered: it is to be sent as a request of its own.
    ByHttp { id: u64 },
    /// No further requests are to come.
    Closing,
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
    FramedRead::new(bytes, codec()).map_ok(BytesMut::freeze)
}

/// Messages that wait to be sent.
#[derive(Debug, Default)]
struct Queue {
    state: Mutex<Queued>,
    /// Wakes those who wait for room.
    room: Notify,
    closed: CancellationToken,
}

#[derive(Debug, Default)]
struct Queued {
    bytes: BytesMut,
    is_closed: bool,
    /// What is queued has let others join it.
    has_waited: bool,
    sender: Option<Waker>,
}

/// What became of a message.
#[derive(Debug, PartialEq, Eq)]
enum Pushed {
    Queued,
    /// There is no room for it at this moment.
    Full,
    /// Nothing is sent any more.
    Closed,
}

impl Queue {
    fn state(&self) -> MutexGuard<'_, Queued> {
        self.state.lock().expect("nothing panics while it holds this")
    }

    fn push(&self, message: &impl Serialize) -> Pushed {
        self.push_bytes(&bytes_of(message))
    }

    fn push_bytes(&self, message: &[u8]) -> Pushed {
        let mut state = self.state();
        if state.is_closed {
            return Pushed::Closed;
        }
        if !state.bytes.is_empty() && state.bytes.len() + message.len() > QUEUED_BYTES_MAX {
            return Pushed::Full;
        }
        codec().encode(message, &mut state.bytes).expect("messages are limited");
        let sender = state.sender.take();
        drop(state);
        sender.into_iter().for_each(Waker::wake);
        Pushed::Queued
    }

    /// Adds a message once there is room for it, if anything is sent still.
    async fn send(&self, message: &impl Serialize) {
        let message = bytes_of(message);
        loop {
            let mut room = pin!(self.room.notified());
            room.as_mut().enable();
            if self.push_bytes(&message) != Pushed::Full {
                return;
            }
            room.await;
        }
    }

    /// Ends the stream after what is queued.
    fn close(&self) {
        let mut state = self.state();
        state.is_closed = true;
        let sender = state.sender.take();
        drop(state);
        self.closed.cancel();
        self.room.notify_waiters();
        sender.into_iter().for_each(Waker::wake);
    }

    fn poll(&self, context: &Context<'_>) -> Poll<Option<Bytes>> {
        let mut state = self.state();
        if !state.bytes.is_empty() && !state.has_waited {
            // A task that was woken runs next. Those that are ready as well may add to what is queued first, so that one system
            // call sends it all.
            state.has_waited = true;
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        state.has_waited = false;
        if !state.bytes.is_empty() {
            let bytes = state.bytes.split().freeze();
            drop(state);
            self.room.notify_waiters();
            return Poll::Ready(Some(bytes));
        }
        if state.is_closed {
            return Poll::Ready(None);
        }
        state.sender = Some(context.waker().clone());
        Poll::Pending
    }

    /// A body with all that is queued, until the queue is closed. It closes the queue when it is dropped.
    fn body(self: &Arc<Self>) -> Body {
        let queue = CloseOnDrop(Arc::clone(self));
        let pieces = stream::poll_fn(move |context| queue.0.poll(context));
        Body::from_stream(pieces.map(Ok::<_, Infallible>))
    }
}

struct CloseOnDrop(Arc<Queue>);

impl Drop for CloseOnDrop {
    fn drop(&mut self) {
        self.0.close();
    }
}

fn codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().max_frame_length(MESSAGE_BYTES_MAX).new_codec()
}

fn bytes_of(message: &impl Serialize) -> Vec<u8> {
    postcard::to_extend(message, Vec::with_capacity(MESSAGE_BYTES)).expect("it has a form")
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
        for message in [&ask, &Ask::Cancelled { id: 7 }] {
            assert_eq!(queue.push(message), Pushed::Queued);
        }
        let mut messages = messages(queue.body());
        queue.close();
        assert_eq!(queue.push(&Ask::Cancelled { id: 8 }), Pushed::Closed);
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

    #[tokio::test]
    async fn a_full_queue_takes_more_when_something_was_sent_and_nothing_after_its_end() {
        let queue = Arc::new(Queue::default());
        let body = vec![0; QUEUED_BYTES_MAX];
        let long = Reply::Answered {
            id: 1,
            status: 200,
            headers: Vec::new(),
            body: serde_bytes::Bytes::new(&body),
        };
        // It is longer than the limit, and alone.
        assert_eq!(queue.push(&long), Pushed::Queued);
        assert_eq!(queue.push(&Reply::ByHttp { id: 2 }), Pushed::Full);
        let sending = tokio::spawn({
            let queue = Arc::clone(&queue);
            async move { queue.send(&Reply::ByHttp { id: 2 }).await }
        });
        let mut messages = messages(queue.body());
        let first = messages.next().await.expect("a message").expect("read");
        assert!(matches!(postcard::from_bytes(&first), Ok(Reply::Answered { id: 1, .. })));
        let second = messages.next().await.expect("a message").expect("read");
        assert!(matches!(postcard::from_bytes(&second), Ok(Reply::ByHttp { id: 2 })));
        sending.await.expect("no panic");
        assert_eq!(queue.push(&long), Pushed::Queued);
        let closed = tokio::spawn({
            let queue = Arc::clone(&queue);
            async move { queue.closed.cancelled().await }
        });
        // Nobody reads any more.
        drop(messages);
        closed.await.expect("no panic");
        queue.send(&long).await;
        assert_eq!(queue.push(&long), Pushed::Closed);
    }
}
