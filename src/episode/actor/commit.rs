//! Effects of a commit: what it publishes and counts.

use std::sync::Arc;

use jiff::Timestamp;
use metrics::Counter;
use swarmbench_engine::AgentId;
use tokio::sync::watch;

use super::super::snapshot::Snapshot;
use super::super::spec::Visibility;
use super::handle::Running;
use super::host::Host;
use crate::telemetry;
use swarmbench_journal::record::{Decision, Source};

/// Kind of an act, for the counters.
#[derive(Clone, Copy)]
pub(super) enum ActKind {
    Valid,
    Invalid,
    /// The seat's clock expired.
    Clock,
}

impl ActKind {
    pub(super) fn of(decision: &Decision) -> Self {
        match (decision.source, decision.valid) {
            (Source::Clock, _) => Self::Clock,
            (Source::Player, true) => Self::Valid,
            (Source::Player, false) => Self::Invalid,
        }
    }

    fn counter(self) -> &'static Counter {
        let frequent = telemetry::frequent();
        match self {
            Self::Valid => &frequent.acts_valid,
            Self::Invalid => &frequent.acts_invalid,
            Self::Clock => &frequent.acts_of_clock,
        }
    }
}

/// Work to do once a commit is durable: what to publish and to count.
pub(super) struct AfterCommit {
    /// State for which the acts were sent.
    pub(super) open: Arc<Snapshot>,
    pub(super) acted: Vec<(AgentId, ActKind)>,
    /// State after the acts, if a round opened or the episode ended.
    pub(super) next: Option<Arc<Snapshot>>,
    pub(super) last_act_at: Timestamp,
    pub(super) episode: Arc<Running>,
}

impl AfterCommit {
    /// Marks, publishes and counts what is durable now.
    pub(super) fn publish(self, host: &Host, publish: &watch::Sender<Arc<Snapshot>>) {
        for (agent, kind) in self.acted {
            self.open.set_acted(agent);
            kind.counter().increment(1);
        }
        self.episode.times.note_act(self.last_act_at);
        let Some(next) = self.next else { return };
        let task = next.world.config().task().name();
        let rounds = u64::from(next.world.round() - self.open.world.round());
        metrics::counter!("swarmbench_rounds_total", "task" => task).increment(rounds);
        note_end(host, &self.episode, &next);
        next.set_opened(host.clock.now());
        publish.send_replace(next);
    }
}

/// Counts an episode that has ended, durably, and notifies its run.
pub(in super::super) fn note_end(host: &Host, episode: &Running, snapshot: &Snapshot) {
    let Some(outcome) = snapshot.outcome else { return };
    let status = outcome.ending.status().name();
    host.quotas.release(episode.key);
    metrics::counter!("swarmbench_episodes_ended_total", "status" => status).increment(1);
    let is_sealed = episode.spec.visibility == Visibility::Sealed;
    let score = (!is_sealed).then(|| snapshot.world.score());
    tracing::info!(episode = %episode.id, status, reason = outcome.ending.name(), score, "ended");
    if let Some(run) = episode.run {
        // The receiver is gone where runs are not managed.
        _ = host.ended.send(run);
    }
}
