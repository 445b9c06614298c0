//! `GET /api/v1/episodes/{id}/events`: resolved rounds as Server-Sent Events.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive, KeepAliveStream};
use futures::StreamExt;
use futures::stream::BoxStream;
use serde::{Deserialize, Serialize};
use swarmbench_engine::World;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use utoipa::IntoParams;

use super::super::App;
use super::super::agent::look::result;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::{Id, Params};
use super::super::refusals::{IdRefusals, QueryRefusals, TokenRefusals};
use crate::budget::{NoMemory, Reservation};
use crate::episode::actor::Handle;
use crate::episode::memory;
use crate::fair::{Party, Permit};
use crate::wire::episode::{RoundEvent, StreamedEvent};
use crate::wire::problem::Problem;

/// From where to listen.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct EventsParams {
    /// Only rounds after this one; all of them where neither this nor `Last-Event-ID` says otherwise.
    after: Option<u32>,
}

/// How long a reader may leave events pending before it is dropped.
const PATIENCE: Duration = Duration::from_secs(10);

/// Listen to resolved rounds (Server-Sent Events).
///
/// One `round` event a resolved round, from the first on; its number is the id and the `round` of
/// the state after it. `finished` comes at the end, with how the episode ended. `Last-Event-ID`
/// resumes. A reader that is too slow is dropped and may resume.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/events",
    operation_id = "stream_events",
    tag = "episodes",
    params(
        ("id" = String, Path, description = "The episode's id"),
        ("Last-Event-ID" = Option<u32>, Header, description = "The last event that was received"),
        EventsParams,
    ),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
    responses(
        (status = 200, description = "Events: `round` with a RoundEvent as data, `finished` with an EpisodeResult", body = StreamedEvent, content_type = "text/event-stream"),
        IdRefusals,
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: only the creator may read it before the end", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn stream_events(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    headers: HeaderMap,
    Params(params): Params<EventsParams>,
) -> Result<Events, ApiError> {
    let handle = app.readable(&caller, id).await?;
    let last = match headers.get("last-event-id").map(|value| value.to_str().map(str::parse)) {
        None => params.after,
        Some(Ok(Ok(last))) => Some(last),
        Some(_) => {
            let detail = "Last-Event-ID must be the id of an event: a round's number";
            return Err(ApiError::new(Code::Malformed, detail));
        }
    };
    let (feed, events) = app.feed().await?;
    crate::telemetry::spawn(async move {
        tokio::select! {
            () = send_events(&app, &handle, last.unwrap_or(0), &feed) => {}
            () = feed.gone() => {}
            () = app.stop.cancelled() => {}
        }
    });
    Ok(events)
}

/// Sends every round after `told`, then the end. Ends early where the reader is too slow.
async fn send_events(app: &App, handle: &Handle, mut told: u32, feed: &Feed) {
    let mut published = handle.follow();
    loop {
        let snapshot = published.borrow_and_update().clone();
        let mut replay = Replay::default();
        while told < snapshot.world.round() {
            told += 1;
            let world = if told == snapshot.world.round() {
                Ok(Arc::clone(&snapshot.world))
            } else {
                replay.to(app, handle, told).await
            };
            let world = match world {
                Ok(world) => world,
                Err(error) => {
                    if error.code() != Code::Overloaded {
                        tracing::error!(?error, "events cannot be sent");
                    }
                    return;
                }
            };
            if !feed.send("round", Some(world.round()), &round(&world)).await {
                return;
            }
        }
        if snapshot.status.is_over() {
            feed.send("finished", None, &result(&snapshot)).await;
            return;
        }
        // While nothing happens no state is held but the one that all share.
        drop((snapshot, replay));
        if published.changed().await.is_err() {
            return;
        }
    }
}

/// Earlier states for a reader that has to catch up, with the memory that they take.
#[derive(Default)]
struct Replay {
    last: Option<Arc<World>>,
    room: Option<Reservation>,
}

impl Replay {
    async fn to(&mut self, app: &App, handle: &Handle, round: u32) -> Result<Arc<World>, ApiError> {
        let bytes = memory::of_world(&handle.spec.config, round);
        match &self.room {
            Some(room) => room.resize(bytes),
            None => self.room = Some(app.registry.room(bytes)?),
        }
        let world = app.state_at(handle, round, self.last.as_ref()).await?;
        self.last = Some(Arc::clone(&world));
        Ok(world)
    }
}

/// The sending side of an event stream. What waits for the reader is bounded by its number and its bytes.
pub(in super::super) struct Feed {
    app: App,
    events: mpsc::Sender<Pending>,
    /// Bytes that may wait.
    bytes: Arc<Semaphore>,
    _place: Permit,
}

/// An event that waits for the reader.
struct Pending {
    event: Event,
    _bytes: OwnedSemaphorePermit,
    _room: Reservation,
}

/// The receiving side of an event stream.
pub(in super::super) type Events =
    Sse<KeepAliveStream<BoxStream<'static, Result<Event, Infallible>>>>;

impl App {
    /// A new event stream, where there is a place for one.
    pub(in super::super) async fn feed(&self) -> Result<(Feed, Events), ApiError> {
        let place = self.streams.events.take(Party::current()).await?;
        let (events, pending) = mpsc::channel(self.limits.events_pending_max);
        let bytes = Arc::new(Semaphore::new(self.limits.events_pending_bytes_max));
        let feed = Feed { app: self.clone(), events, bytes, _place: place };
        let told = ReceiverStream::new(pending).map(|pending: Pending| Ok(pending.event));
        Ok((feed, Sse::new(told.boxed()).keep_alive(KeepAlive::default())))
    }
}

impl Feed {
    /// Completes when the reader is gone.
    pub(in super::super) async fn gone(&self) {
        self.events.closed().await;
    }

    /// Sends an event; false where the reader is gone or too slow, or no memory is free.
    pub(in super::super) async fn send(
        &self,
        name: &str,
        id: Option<u32>,
        data: &impl Serialize,
    ) -> bool {
        let data = serde_json::to_string(data).expect("string keys");
        let event = Event::default().event(name);
        let event = match id {
            Some(id) => event.id(id.to_string()),
            None => event,
        };
        let event = event.data(&data);
        matches!(tokio::time::timeout(PATIENCE, self.push(event, data.len())).await, Ok(Ok(true)))
    }

    async fn push(&self, event: Event, bytes: usize) -> Result<bool, NoMemory> {
        let room = self.app.registry.room(bytes)?;
        // One that is larger than all that may wait waits alone.
        let most = self.app.limits.events_pending_bytes_max;
        let bytes = u32::try_from(bytes.min(most)).unwrap_or(u32::MAX);
        let Ok(bytes) = Arc::clone(&self.bytes).acquire_many_owned(bytes).await else {
            return Ok(false);
        };
        Ok(self.events.send(Pending { event, _bytes: bytes, _room: room }).await.is_ok())
    }
}

fn round(world: &World) -> RoundEvent {
    RoundEvent {
        round: world.round(),
        score: world.score(),
        agents: world.agent_states().map(Into::into).collect(),
    }
}
