//! `GET /api/v1/episodes/{id}/events`: resolved rounds as Server-Sent Events.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures::Stream;
use serde::Deserialize;
use swarmbench_engine::World;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use utoipa::IntoParams;

use super::super::App;
use super::super::agent::look::result;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::{Id, Params};
use super::super::refusals::{IdRefusals, QueryRefusals, TokenRefusals};
use crate::episode::actor::Handle;
use crate::episode::recovery::state_at;
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

/// How long a reader may take for what is pending before it is dropped.
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
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, ApiError> {
    let handle = app.readable(&caller, id).await?;
    let last = match headers.get("last-event-id").map(|value| value.to_str().map(str::parse)) {
        None => params.after,
        Some(Ok(Ok(last))) => Some(last),
        Some(_) => {
            let detail = "Last-Event-ID must be the id of an event: a round's number";
            return Err(ApiError::new(Code::Malformed, detail));
        }
    };
    let (events, stream) = mpsc::channel(app.limits.events_pending_max);
    tokio::spawn(async move {
        let stop = app.stop.clone();
        tokio::select! {
            () = tell(&app, &handle, last.unwrap_or(0), &events) => {}
            () = stop.cancelled() => {}
        }
    });
    Ok(Sse::new(ReceiverStream::new(stream)).keep_alive(KeepAlive::default()))
}

/// Sends every round after `told`, then the end. Ends early where the reader is gone or too slow.
async fn tell(
    app: &App,
    handle: &Handle,
    mut told: u32,
    events: &mpsc::Sender<Result<Event, Infallible>>,
) {
    let mut published = handle.follow();
    let mut last: Option<Arc<World>> = None;
    loop {
        let snapshot = published.borrow_and_update().clone();
        while told < snapshot.world.round() {
            told += 1;
            let world = if told == snapshot.world.round() {
                snapshot.world.clone()
            } else {
                match state_at(app.registry.journal(), handle, told, last.as_ref()).await {
                    Ok(world) => world,
                    Err(error) => {
                        tracing::error!(%error, "events cannot be told");
                        return;
                    }
                }
            };
            if !send(events, round(&world)).await {
                return;
            }
            last = Some(world);
        }
        if snapshot.status.is_over() {
            let data = serde_json::to_string(&result(&snapshot)).expect("string keys");
            send(events, Event::default().event("finished").data(data)).await;
            return;
        }
        tokio::select! {
            changed = published.changed() => if changed.is_err() { return },
            () = events.closed() => return,
        }
    }
}

/// Sends an event; false where the reader is gone or too slow.
pub(in super::super) async fn send(
    events: &mpsc::Sender<Result<Event, Infallible>>,
    event: Event,
) -> bool {
    matches!(tokio::time::timeout(PATIENCE, events.send(Ok(event))).await, Ok(Ok(())))
}

fn round(world: &World) -> Event {
    let event = RoundEvent {
        round: world.round(),
        score: world.score(),
        agents: world.agent_states().map(Into::into).collect(),
    };
    let data = serde_json::to_string(&event).expect("string keys");
    Event::default().event("round").id(world.round().to_string()).data(data)
}
