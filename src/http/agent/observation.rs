//! Observations as JSON: small ones are written on the async threads, all others on worker threads.

use std::sync::Arc;

use bytes::Bytes;
use swarmbench_engine::AgentId;

use super::super::observation_cache::Key;
use super::super::prelude::*;
use crate::episode::Snapshot;
use crate::episode::actor::Handle;
use crate::fair::Permit;
use crate::telemetry;
use swarmbench_clock::{millis, until};
use swarmbench_prompt::tasks;
use swarmbench_protocol::episode::EpisodeResult;
use swarmbench_protocol::observation::{Moment, Sight};

/// Maximum cells that are written in one piece: about a millisecond of work. The async thread writes one piece of a request;
/// worker threads write all others.
const PIECE_CELLS_MAX: usize = 32 * 1024;

/// Cost of a prompt beside its cells, in cells.
const PROMPT_CELLS: usize = 4096;

/// A seat, and the state to show it.
#[derive(Clone)]
pub(in super::super) struct ObservationRequest {
    handle: Handle,
    snapshot: Arc<Snapshot>,
    agent: AgentId,
    acted: bool,
    /// The sight, if it is in the cache.
    cached: Option<Bytes>,
}

struct Rendered {
    sight: Bytes,
    prompt: Option<Vec<u8>>,
}

impl ObservationRequest {
    pub(in super::super) fn now(
        app: &App,
        handle: &Handle,
        snapshot: &Arc<Snapshot>,
        agent: AgentId,
    ) -> Self {
        let acted = snapshot.has_acted(agent);
        Self { acted, ..Self::waiting(app, handle, snapshot, agent) }
    }

    /// Shows a state in which the seat has to act, as if it had not acted yet.
    pub(in super::super) fn waiting(
        app: &App,
        handle: &Handle,
        snapshot: &Arc<Snapshot>,
        agent: AgentId,
    ) -> Self {
        let (handle, snapshot) = (handle.clone(), Arc::clone(snapshot));
        let mut request = Self { handle, snapshot, agent, acted: false, cached: None };
        request.cached = app.observation_cache.get(&request.key());
        request
    }

    fn key(&self) -> Key {
        let Snapshot { status, world, .. } = &*self.snapshot;
        (self.handle.key, world.round(), *status, self.agent)
    }

    /// Estimated work of writing the observation, in cells.
    fn cells(&self, with_prompt: bool) -> usize {
        let cells = self.snapshot.world.observation_cells(self.agent);
        match &self.cached {
            _ if with_prompt => PROMPT_CELLS + 4 * cells,
            Some(sight) => 1 + sight.len() / 32,
            None => cells,
        }
    }

    fn sight(&self) -> Sight {
        Sight::of(
            &self.snapshot.world.observe(self.agent),
            self.handle.id.to_string(),
            tasks::description(&self.handle.spec.config),
            self.snapshot.status,
            result(&self.snapshot),
        )
    }

    /// Writes the part that stays the same while the round is open.
    fn write(&self, app: &App, with_prompt: bool) -> Result<Rendered, ApiError> {
        if let (Some(sight), false) = (&self.cached, with_prompt) {
            return Ok(Rendered { sight: sight.clone(), prompt: None });
        }
        let seen = self.sight();
        let sight = self.cached.clone().unwrap_or_else(|| {
            let sight = Bytes::from(serde_json::to_vec(&seen).expect("string keys"));
            app.observation_cache.insert(self.key(), &sight);
            sight
        });
        let spec = &self.handle.spec;
        let prompt = with_prompt
            .then(|| swarmbench_prompt::render(&spec.prompt_template, &seen, &spec.config));
        let prompt = prompt.transpose()?;
        let prompt = prompt.map(|text| serde_json::to_vec(&text).expect("a text"));
        Ok(Rendered { sight, prompt })
    }

    /// Appends the whole observation to a body.
    fn add_to(&self, body: &mut Vec<u8>, rendered: &Rendered, app: &App) {
        let moment = serde_json::to_vec(&self.moment(app)).expect("string keys");
        let prompt_bytes = rendered.prompt.as_ref().map_or(0, Vec::len);
        body.reserve(rendered.sight.len() + moment.len() + prompt_bytes + 16);
        // Two objects are joined to one: `{…`, `,…` and `}`.
        body.extend_from_slice(&rendered.sight[..rendered.sight.len() - 1]);
        body.push(b',');
        body.extend_from_slice(&moment[1..moment.len() - 1]);
        if let Some(prompt) = &rendered.prompt {
            body.extend_from_slice(b",\"prompt\":");
            body.extend_from_slice(prompt);
        }
        body.push(b'}');
    }

    fn moment(&self, app: &App) -> Moment {
        let Self { handle, snapshot, agent, acted, .. } = self;
        let acted = *acted;
        let deadline = snapshot.deadline(&handle.spec, *agent);
        let Some(deadline) = deadline else { return Moment { acted, ..Moment::default() } };
        let left = until(app.clock.now(), deadline);
        // The round's own clock runs first, then the bank.
        let bank = snapshot.banks[agent.index()].min(left);
        Moment {
            acted,
            deadline: Some(app.clock.to_wall(deadline).into()),
            remaining_ms: Some(millis(left)),
            bank_ms: Some(millis(bank)),
            prompt: None,
        }
    }
}

/// Writes an observation as JSON.
pub(in super::super) async fn observation(
    app: &App,
    request: ObservationRequest,
    with_prompt: bool,
) -> Result<Vec<u8>, ApiError> {
    let mut body = Vec::new();
    let _permit = permit(app, std::slice::from_ref(&request), with_prompt).await?;
    for (request, rendered) in ObservationWriter::new(app, with_prompt).write(vec![request]).await?
    {
        request.add_to(&mut body, &rendered, app);
    }
    Ok(body)
}

/// Writes observations as a JSON list, and returns their number: the first one, and as many more as fit into `bytes_max`. After
/// the client has gone, at most one piece is written.
pub(in super::super) async fn observations(
    app: &App,
    requests: Vec<ObservationRequest>,
    with_prompt: bool,
    bytes_max: usize,
) -> Result<(Vec<u8>, usize), ApiError> {
    let (mut body, mut given) = (b"[".to_vec(), 0);
    let _permit = permit(app, &requests, with_prompt).await?;
    let mut writer = ObservationWriter::new(app, with_prompt);
    let mut rest = requests.into_iter().peekable();
    while rest.peek().is_some() {
        let mut cells = 0;
        let mut piece = Vec::new();
        while let Some(request) = rest.next_if(|request| {
            cells += request.cells(with_prompt);
            piece.is_empty() || cells <= PIECE_CELLS_MAX
        }) {
            piece.push(request);
        }
        for (request, rendered) in writer.write(piece).await? {
            let before = body.len();
            if given > 0 {
                body.push(b',');
            }
            request.add_to(&mut body, &rendered, app);
            if given > 0 && body.len() >= bytes_max {
                body.truncate(before);
                body.push(b']');
                return Ok((body, given));
            }
            given += 1;
        }
    }
    body.push(b']');
    Ok((body, given))
}

/// Permit for a large answer; an answer of one piece needs none.
async fn permit(
    app: &App,
    requests: &[ObservationRequest],
    with_prompt: bool,
) -> Result<Option<Permit>, ApiError> {
    let cells: usize = requests.iter().map(|request| request.cells(with_prompt)).sum();
    Ok(if cells > PIECE_CELLS_MAX { Some(Box::pin(app.heavy.large_answer()).await?) } else { None })
}

/// Writes the observations of one request: one piece on this thread, all others on worker threads.
struct ObservationWriter<'a> {
    app: &'a App,
    with_prompt: bool,
    /// Cells written on the async thread, and on worker threads.
    cells: [usize; 2],
}

impl<'a> ObservationWriter<'a> {
    const fn new(app: &'a App, with_prompt: bool) -> Self {
        Self { app, with_prompt, cells: [0; 2] }
    }

    async fn write(
        &mut self,
        requests: Vec<ObservationRequest>,
    ) -> Result<Vec<(ObservationRequest, Rendered)>, ApiError> {
        let with_prompt = self.with_prompt;
        let cells: usize = requests.iter().map(|request| request.cells(with_prompt)).sum();
        let work = {
            let app = self.app.clone();
            move || {
                let write = |request: ObservationRequest| {
                    request.write(&app, with_prompt).map(|rendered| (request, rendered))
                };
                requests.into_iter().map(write).collect()
            }
        };
        let [here, elsewhere] = &mut self.cells;
        if !with_prompt && *here + cells <= PIECE_CELLS_MAX {
            *here += cells;
            work()
        } else {
            *elsewhere += cells;
            Box::pin(self.app.heavy.render(work)).await?
        }
    }
}

impl Drop for ObservationWriter<'_> {
    fn drop(&mut self) {
        let frequent = telemetry::frequent();
        let of = [&frequent.cells_async, &frequent.cells_worker];
        for (histogram, cells) in of.into_iter().zip(self.cells).filter(|(_, cells)| *cells > 0) {
            histogram.record(u32::try_from(cells).unwrap_or(u32::MAX));
        }
    }
}

/// Ending of an episode, as clients see it.
pub(in super::super) fn result(snapshot: &Snapshot) -> Option<EpisodeResult> {
    snapshot.outcome.map(|outcome| EpisodeResult {
        reason: outcome.ending.name().to_owned(),
        score: snapshot.world.score(),
        rounds: snapshot.world.round(),
        journal_head: snapshot.head.to_string(),
    })
}
