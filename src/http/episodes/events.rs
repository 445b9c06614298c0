//! `GET /api/v1/episodes/{id}/events`: resolved rounds as Server-Sent Events.

use std::sync::Arc;

use axum::http::HeaderMap;
use serde::Deserialize;
use swarmbench_engine::World;
use utoipa::IntoParams;

use super::super::agent::observation::result;
use super::super::feed::{Events, Feed, feed};
use super::super::prelude::*;
use crate::budget::Reservation;
use crate::episode::actor::Handle;
use crate::episode::memory;
use swarmbench_protocol::episode::{RoundEvent, StreamedEvent};

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct EventsParams {
    /// Round after which events begin; all events if neither this nor `Last-Event-ID` is given.
    after: Option<u32>,
}

/// Listen to resolved rounds (Server-Sent Events).
///
/// Each resolved round is a `round` event, from the first on; the id of the event is the `round` of the state after it. The
/// last event is `finished`, with the end of the episode. `Last-Event-ID` resumes. A reader that is too slow is disconnected
/// and may resume.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/events",
    operation_id = "stream_events",
    tag = "episodes",
    params(
        ("Last-Event-ID" = Option<u32>, Header, description = "The last event that was received"),
        EventsParams,
    ),
    responses(
        (status = 200, description = "Events: `round` with a RoundEvent as data, `finished` with an EpisodeResult", body = StreamedEvent, content_type = "text/event-stream"),
        (status = 403, description = "`forbidden`: only the creator may read it before the end"),
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
    let (feed, events) = feed(&app, &caller)?;
    crate::telemetry::spawn(async move {
        tokio::select! {
            () = send_events(&app, &handle, last.unwrap_or(0), &feed) => {}
            () = feed.gone() => {}
            () = app.stop.cancelled() => {}
        }
    });
    Ok(events)
}

/// Sends every round after `last`, then the end. Ends early where the reader is too slow.
async fn send_events(app: &App, handle: &Handle, mut last: u32, feed: &Feed) {
    let mut published = handle.follow();
    loop {
        let snapshot = published.borrow_and_update().clone();
        let mut replay = Replay::default();
        while last < snapshot.world.round() {
            last += 1;
            let world = if last == snapshot.world.round() {
                Ok(Arc::clone(&snapshot.world))
            } else {
                replay.to(app, handle, last).await
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

fn round(world: &World) -> RoundEvent {
    RoundEvent {
        round: world.round(),
        score: world.score(),
        agents: world.agent_states().map(Into::into).collect(),
    }
}
