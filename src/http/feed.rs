//! Event streams (Server-Sent Events). A slow reader is disconnected.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::http::header;
use axum::response::sse::{Event, KeepAlive, KeepAliveStream};
use axum::response::{Response, Sse};
use futures::StreamExt;
use futures::stream::BoxStream;
use serde::Serialize;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;

use super::App;
use super::auth::Caller;
use super::error::ApiError;
use crate::budget::{Exhausted, Reservation};
use crate::episode::registry::Registry;
use crate::fair::Party;

/// Time for which events may stay pending before the reader is disconnected.
const READER_TIMEOUT: Duration = Duration::from_secs(10);

/// Sending side of an event stream. Pending events are bounded in number and bytes.
pub(super) struct Feed {
    registry: Registry,
    events: mpsc::Sender<Pending>,
    /// Bytes that may be pending.
    bytes: Arc<Semaphore>,
    bytes_max: usize,
    _open: Reservation,
}

/// A pending event.
struct Pending {
    event: Event,
    _bytes: OwnedSemaphorePermit,
    _room: Reservation,
}

/// Receiving side of an event stream.
pub(super) type Events = Sse<KeepAliveStream<BoxStream<'static, Result<Event, Infallible>>>>;

/// Opens an event stream for a caller. Organizers and judges get one even when the limit for others is reached.
pub(super) fn feed(app: &App, caller: &Caller) -> Result<(Feed, Events), ApiError> {
    let open = app.streams.events.reserve(1, Some(Party::current()), caller.rank())?;
    let (events, pending) = mpsc::channel(app.limits.events_pending_max);
    let bytes_max = app.limits.events_pending_bytes_max;
    let bytes = Arc::new(Semaphore::new(bytes_max));
    let registry = app.registry.clone();
    let feed = Feed { registry, events, bytes, bytes_max, _open: open };
    let sent = ReceiverStream::new(pending).map(|pending: Pending| Ok(pending.event));
    Ok((feed, Sse::new(sent.boxed()).keep_alive(KeepAlive::default())))
}

pub(super) fn is_event_stream(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    kind.is_some_and(|kind| kind.as_bytes().starts_with(b"text/event-stream"))
}

impl Feed {
    /// Completes when the reader is disconnected.
    pub(super) async fn gone(&self) {
        self.events.closed().await;
    }

    /// Sends an event; false if the reader is gone or too slow, or no memory is free.
    pub(super) async fn send(&self, name: &str, id: Option<u32>, data: &impl Serialize) -> bool {
        let data = serde_json::to_string(data).expect("string keys");
        let event = Event::default().event(name);
        let event = match id {
            Some(id) => event.id(id.to_string()),
            None => event,
        };
        let event = event.data(&data);
        matches!(
            tokio::time::timeout(READER_TIMEOUT, self.push(event, data.len())).await,
            Ok(Ok(true))
        )
    }

    async fn push(&self, event: Event, bytes: usize) -> Result<bool, Exhausted> {
        let room = self.registry.room(bytes)?;
        // An event larger than the limit waits alone.
        let bytes = u32::try_from(bytes.min(self.bytes_max)).unwrap_or(u32::MAX);
        let Ok(bytes) = Arc::clone(&self.bytes).acquire_many_owned(bytes).await else {
            return Ok(false);
        };
        Ok(self.events.send(Pending { event, _bytes: bytes, _room: room }).await.is_ok())
    }
}
