//! `GET /swarm/obs`: observations of seats that the open rounds wait for.

use std::sync::Arc;
use std::time::Duration;

use futures::StreamExt;
use futures::stream::FuturesUnordered;
use serde::Deserialize;
use swarmbench_engine::AgentId;
use tokio::sync::watch;
use utoipa::IntoParams;

use super::super::agent::observation::{ObservationRequest, observations};
use super::super::answer::{json, with_field};
use super::super::auth::Swarm;
use super::super::extract::{flag, wait};
use super::super::prelude::*;
use super::{Seated, Source};
use crate::episode::{Snapshot, Status};
use swarmbench_protocol::act::SwarmObsResponse;

/// Default of `limit`.
const OBSERVATIONS_DEFAULT: usize = 256;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct SwarmObsParams {
    /// Cursor of an earlier answer: return only what was opened since.
    after: Option<String>,
    /// Seconds to wait for at least one observation, up to 60.
    wait: Option<f64>,
    /// Maximum number of observations, up to 1,024; 256 by default.
    #[param(minimum = 1, maximum = 1024)]
    limit: Option<usize>,
    /// Whether to add the texts for a language model.
    #[serde(default, deserialize_with = "flag")]
    prompt: bool,
}

/// Get the observations of several seats that wait for an act, oldest first.
///
/// The answer has at least one observation, unless the time is up or all episodes are over. It has at most 8 MB: it may have
/// fewer observations than `limit`, and its cursor is that of its last one.
#[utoipa::path(
    get,
    path = "/swarm/obs",
    operation_id = "get_swarm_obs",
    tag = "swarm",
    params(SwarmObsParams),
    responses(
        (status = 200, description = "The observations that wait for an act", body = SwarmObsResponse),
        (status = 403, description = "`forbidden`: not a swarm token"),
        (status = 422, description = "`template_failed`: prompts were requested and cannot be made"),
    )
)]
pub(in super::super) async fn get_swarm_obs(
    State(app): State<App>,
    swarm: Swarm,
    Params(params): Params<SwarmObsParams>,
) -> Result<Response, ApiError> {
    let timeout = wait(&app, params.wait)?;
    let most = app.limits.observations_max;
    let limit = params.limit.unwrap_or(OBSERVATIONS_DEFAULT);
    if !(1..=most).contains(&limit) {
        let detail = format!("limit must be from 1 to {most}, is {limit}");
        return Err(ApiError::limit(Code::Malformed, "observations_max", most, detail));
    }
    let after = match &params.after {
        Some(text) => Cursor::parse(text, app.boot)?,
        None => Cursor::START,
    };
    let mut source = Source::of(&app, swarm).await?;
    let (open, finished) = wait_for_seats(&app, &mut source, after, timeout).await?;
    let open = &open[..open.len().min(limit)];
    let requests = open.iter().map(|open| open.request(&app)).collect();
    let bytes_max = app.limits.answer_bytes_max - REST_BYTES_MAX;
    let (observations, given) = observations(&app, requests, params.prompt, bytes_max).await?;
    // The next answer has the observations that did not fit.
    let cursor = open[..given].last().map_or(after, |last| last.seat);
    let rest = Rest { cursor: cursor.write(app.boot), finished };
    Ok(json(with_field(&rest, "observations", &observations)))
}

/// Bytes of an answer beside its observations.
const REST_BYTES_MAX: usize = 256;

/// Pause before an episode is found again after its actor has ended by a fault.
const GONE_PAUSE: Duration = Duration::from_secs(1);

/// A seat that waits for an act.
struct Open {
    seat: Cursor,
    seated: Arc<Seated>,
    snapshot: Arc<Snapshot>,
}

impl Open {
    fn request(&self, app: &App) -> ObservationRequest {
        ObservationRequest::waiting(
            app,
            &self.seated.handle,
            &self.snapshot,
            AgentId(self.seat.agent),
        )
    }
}

/// Waits for seats that were opened after `after` and have to act, until there are any, everything is over, or the time is up.
/// Also returns whether everything is over.
async fn wait_for_seats(
    app: &App,
    source: &mut Source,
    after: Cursor,
    timeout: Duration,
) -> Result<(Vec<Open>, bool), ApiError> {
    let mut waiting = None;
    let mut is_up = timeout.is_zero();
    let mut up = app.clock.sleep_until(swarmbench_clock::after(app.clock.now(), timeout));
    loop {
        // `changed` reports changes from here on.
        let (seated, is_over) = source.open(app).await?;
        let mut followed: Vec<Followed> = seated.into_iter().map(Followed::new).collect();
        loop {
            let Some((open, are_over)) = collect_open(app, source, &mut followed, after) else {
                break;
            };
            // The run opens further games when these are over.
            let is_over = is_over.unwrap_or(are_over);
            if !open.is_empty() || is_over || is_up {
                return Ok((open, is_over));
            }
            if waiting.is_none() {
                waiting = Some(app.waits.start()?);
            }
            tokio::select! {
                is_alive = any_changed(&mut followed) => if !is_alive {
                    // An actor has ended by a fault: its episode is found again, recovered.
                    tokio::select! {
                        () = app.clock.sleep_until(swarmbench_clock::after(app.clock.now(), GONE_PAUSE)) => {}
                        () = &mut up => is_up = true,
                        () = app.stop.cancelled() => is_up = true,
                    }
                    source.find_again(app).await?;
                    break;
                },
                () = source.changed() => break,
                () = &mut up => is_up = true,
                () = app.stop.cancelled() => is_up = true,
            }
        }
    }
}

/// An episode with the receiver of its states.
struct Followed {
    seated: Arc<Seated>,
    published: watch::Receiver<Arc<Snapshot>>,
}

impl Followed {
    fn new(seated: Seated) -> Self {
        Self { published: seated.handle.follow(), seated: Arc::new(seated) }
    }

    /// Completes with true when another state is published, and with false when the actor has ended before the episode. Never
    /// completes where the episode is over.
    async fn changed(&mut self) -> bool {
        if self.published.changed().await.is_ok() {
            return true;
        }
        if self.published.borrow().status.is_over() {
            std::future::pending::<()>().await;
        }
        false
    }
}

/// Completes when any episode has changed since it was last collected; with false where its actor has ended.
async fn any_changed(followed: &mut [Followed]) -> bool {
    let changes: FuturesUnordered<_> = followed.iter_mut().map(Followed::changed).collect();
    match { changes }.next().await {
        Some(is_alive) => is_alive,
        None => std::future::pending().await,
    }
}

/// Looks at all episodes at one moment. Returns the seats that have to act and were opened after `after`, oldest first, and
/// whether all episodes are over; `None` if other games were opened meanwhile.
fn collect_open(
    app: &App,
    source: &Source,
    followed: &mut [Followed],
    after: Cursor,
) -> Option<(Vec<Open>, bool)> {
    let (snapshots, are_over) = {
        // The first look that sees a round numbers it. Without one lock for the whole look, another look could give a smaller
        // number to a round that this one has not seen.
        let mut seen = app.rounds_seen.lock().expect("nothing panics while it holds this");
        // Nor may this look number rounds without a game that another look has already numbered: its cursor would pass that game.
        if source.has_changed() {
            return None;
        }
        let mut snapshots: Vec<_> = followed
            .iter_mut()
            .map(|followed| (followed.published.borrow_and_update().clone(), &followed.seated))
            .collect();
        let are_over = snapshots.iter().all(|(snapshot, _)| snapshot.status.is_over());
        snapshots.retain(|(snapshot, _)| snapshot.status == Status::Running);
        snapshots.sort_by_key(|(snapshot, _)| snapshot.opened_at());
        let mut next = || {
            *seen += 1;
            *seen
        };
        let placed =
            snapshots.into_iter().map(|(snapshot, of)| (snapshot.place(&mut next), snapshot, of));
        (placed.collect::<Vec<_>>(), are_over)
    };
    let mut open = Vec::new();
    for (opened, snapshot, seated) in snapshots {
        let waiting = snapshot.world.agents().filter(|&agent| snapshot.waits_for(agent));
        let seats = waiting
            .filter(|&agent| seated.holds(agent))
            .map(|agent| Cursor { opened, agent: agent.0 })
            .filter(|seat| *seat > after);
        open.extend(seats.map(|seat| Open {
            seat,
            seated: Arc::clone(seated),
            snapshot: Arc::clone(&snapshot),
        }));
    }
    open.sort_by_key(|open| open.seat);
    Some((open, are_over))
}

/// A [`SwarmObsResponse`] without its observations, which are already written.
#[derive(serde::Serialize)]
struct Rest {
    cursor: String,
    finished: bool,
}

/// Position in the order in which observations were opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Cursor {
    opened: u64,
    agent: u16,
}

impl Cursor {
    /// Position before all observations.
    const START: Self = Self { opened: 0, agent: 0 };

    fn write(self, boot: u64) -> String {
        format!("{boot:016x}.{}.{}", self.opened, self.agent)
    }

    /// Parses a cursor. A cursor of an earlier run of the server is before everything: a restart opens all open rounds anew.
    fn parse(text: &str, boot: u64) -> Result<Self, ApiError> {
        let read = || {
            let mut parts = text.split('.');
            let run = u64::from_str_radix(parts.next()?, 16).ok()?;
            let opened = parts.next()?.parse().ok()?;
            let agent = parts.next()?.parse().ok()?;
            parts.next().is_none().then_some((run, Self { opened, agent }))
        };
        let (run, cursor) = read().ok_or_else(|| {
            ApiError::new(Code::Malformed, "after must be the cursor of an earlier answer")
        })?;
        Ok(if run == boot { cursor } else { Self::START })
    }
}
