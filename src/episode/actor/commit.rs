//! What a commit makes visible.

use std::sync::Arc;

use jiff::Timestamp;
use swarmbench_engine::AgentId;
use tokio::sync::watch;

use super::super::snapshot::Snapshot;
use super::host::Host;
use super::times::Times;
use crate::ids::{EpisodeId, EpisodeKey, RunKey};

/// What is published and counted once a commit is durable.
pub(super) struct AfterCommit {
    /// The state for which the acts were sent.
    pub(super) open: Arc<Snapshot>,
    pub(super) acted: Vec<(AgentId, &'static str)>,
    /// The state after them, if a round or the episode ended.
    pub(super) next: Option<Arc<Snapshot>>,
    pub(super) times: Arc<Times>,
    pub(super) last_act_at: Timestamp,
    pub(super) episode: EpisodeId,
    pub(super) key: EpisodeKey,
    pub(super) run: Option<RunKey>,
    pub(super) is_sealed: bool,
}

impl AfterCommit {
    /// Marks and publishes what is durable now, and counts it.
    pub(super) fn publish(self, host: &Host, publish: &watch::Sender<Arc<Snapshot>>) {
        for (agent, kind) in self.acted {
            self.open.set_acted(agent);
            metrics::counter!("swarmbench_acts_total", "kind" => kind).increment(1);
        }
        self.times.note_act(self.last_act_at);
        let Some(next) = self.next else { return };
        let task = next.world.config().task().name();
        let rounds = u64::from(next.world.round() - self.open.world.round());
        metrics::counter!("swarmbench_rounds_total", "task" => task).increment(rounds);
        if let Some(outcome) = next.outcome {
            let status = outcome.ending.status().name();
            host.quotas.release(self.key);
            metrics::counter!("swarmbench_episodes_ended_total", "status" => status).increment(1);
            let score = (!self.is_sealed).then(|| next.world.score());
            tracing::info!(
                episode = %self.episode, status, reason = outcome.ending.name(), score, "ended"
            );
        }
        let ended = self.run.filter(|_| next.outcome.is_some());
        next.set_opened(host.clock.now());
        publish.send_replace(next);
        if let Some(run) = ended {
            // The receiver is gone if runs are not managed.
            _ = host.ended.send(run);
        }
    }
}
