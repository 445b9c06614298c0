//! Observations after acts: the rest of the answer of `POST /swarm/act?wait=`.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use futures::future::join_all;
use serde::Deserialize;
use serde_json::value::RawValue;
use swarmbench_engine::AgentId;

use super::super::agent::obs::is_past;
use super::super::agent::observation::{ObservationRequest, observations};
use super::super::answer::{add_field, json};
use super::super::prelude::*;
use super::super::stream::Short;
use super::{Seated, Source};
use crate::episode::Snapshot;
use crate::episode::spec::Visibility;
use swarmbench_protocol::act::{SwarmActResponse, SwarmReceipt};

/// Bytes of an answer beside its receipts and its observations.
const REST_BYTES_MAX: usize = 256;

/// Time after which a client looks for observations for which no memory was free.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Episodes that a request acted in, by id.
#[derive(Default)]
pub(super) struct Acted(BTreeMap<String, Episode>);

/// An episode that a request acted in.
struct Episode {
    seated: Seated,
    /// Seats whose acts count.
    counted: BTreeMap<AgentId, Counted>,
    /// Seats with a refused act.
    refused: BTreeSet<AgentId>,
}

/// The acts of a seat that count.
struct Counted {
    /// Place of the first of them in the request.
    place: usize,
    /// Latest round of the acts.
    round: u32,
}

impl Acted {
    /// Notes the outcome of an act, which is at `place` in the request.
    pub(super) fn note(
        &mut self,
        seated: &Seated,
        agent: AgentId,
        receipt: &SwarmReceipt,
        place: usize,
    ) {
        let id = seated.handle.id.to_string();
        let episode = self.0.entry(id).or_insert_with(|| Episode {
            seated: Seated { handle: seated.handle.clone(), seats: seated.seats.clone() },
            counted: BTreeMap::new(),
            refused: BTreeSet::new(),
        });
        match receipt {
            SwarmReceipt::Receipt(receipt) => {
                let first = Counted { place, round: receipt.round };
                let counted = episode.counted.entry(agent).or_insert(first);
                counted.round = counted.round.max(receipt.round);
            }
            SwarmReceipt::Problem(_) => {
                episode.refused.insert(agent);
            }
        }
    }

    /// Notes an act that was refused before it reached its episode, if it names a seat of an episode that the request acted in.
    pub(super) fn note_refused(&mut self, act: &RawValue) {
        /// Seat of an act, whose other fields may be anything.
        #[derive(Deserialize)]
        struct Name<'a> {
            #[serde(borrow)]
            episode: Cow<'a, str>,
            #[serde(borrow)]
            agent: Cow<'a, str>,
        }
        let Ok(Name { episode, agent }) = serde_json::from_str(act.get()) else { return };
        let Some(episode) = self.0.get_mut(&*episode) else { return };
        let num_agents = episode.seated.handle.spec.config.num_agents();
        episode.refused.extend(AgentId::parse(&agent).filter(|agent| agent.0 < num_agents));
    }

    /// Writes the whole answer: `answer` has the receipts, which are sent in any case, as the acts are durable.
    pub(super) async fn answer(
        self,
        app: &App,
        source: &Source,
        patience: Duration,
        with_prompt: bool,
        mut answer: SwarmActResponse,
    ) -> Response {
        answer.problem = self.settle(app, patience).await.err().map(|error| error.problem());
        let requests = self.requests(app);
        answer.finished = Some(source.is_over());
        let body = serde_json::to_vec(&answer).expect("string keys");
        let bytes_max = app.limits.answer_bytes_max.saturating_sub(body.len() + REST_BYTES_MAX);
        let mut without = |error: ApiError| {
            answer.problem = Some(error.problem());
            answer.observations = Some(Vec::new());
            serde_json::to_vec(&answer).expect("string keys")
        };
        match observations(app, requests, with_prompt, bytes_max).await {
            Ok((seen, _)) => Short::of(json(add_field(body, "observations", &seen)), || {
                let detail = "no memory is free for the observations: look again";
                without(ApiError::new(Code::Overloaded, detail).retry_after(LOOK_AGAIN))
            }),
            Err(error) => json(without(error)),
        }
    }

    /// Waits until all of these episodes are settled, the time is up, or the server stops.
    async fn settle(&self, app: &App, patience: Duration) -> Result<(), ApiError> {
        let open = self.0.values().filter(|episode| !episode.is_settled_now());
        let open: Vec<_> = open.map(Episode::settled).collect();
        if !open.is_empty() && !patience.is_zero() {
            app.waits.hold(patience, join_all(open)).await?;
        }
        Ok(())
    }

    /// The seats' next observations, as far as they are available, in the order of the acts.
    fn requests(&self, app: &App) -> Vec<ObservationRequest> {
        let mut requests = Vec::new();
        for Episode { seated, counted, .. } in self.0.values() {
            let handle = &seated.handle;
            let snapshot = handle.snapshot();
            // The ending of a sealed game stays secret until its competition is over.
            if snapshot.status.is_over() && handle.spec.visibility == Visibility::Sealed {
                continue;
            }
            let seen = counted.iter().filter(|(_, counted)| is_past(&snapshot, counted.round));
            requests.extend(seen.map(|(agent, counted)| {
                (counted.place, ObservationRequest::now(app, handle, &snapshot, *agent))
            }));
        }
        requests.sort_by_key(|(place, _)| *place);
        requests.into_iter().map(|(_, request)| request).collect()
    }
}

impl Episode {
    /// Waiting is pointless: the round that was answered is over, or the round waits for a seat whose act was refused, so that a
    /// better act has to come first.
    fn is_settled(&self, snapshot: &Snapshot) -> bool {
        let Some(round) = self.counted.values().map(|counted| counted.round).max() else {
            return true;
        };
        let waits_for = |agent: &AgentId| self.seated.holds(*agent) && snapshot.waits_for(*agent);
        is_past(snapshot, round) || self.refused.iter().any(waits_for)
    }

    fn is_settled_now(&self) -> bool {
        self.is_settled(&self.seated.handle.snapshot())
    }

    /// Completes when the episode is settled, or its actor has ended by a fault.
    async fn settled(&self) {
        let mut published = self.seated.handle.follow();
        drop(published.wait_for(|snapshot| self.is_settled(snapshot)).await);
    }
}
