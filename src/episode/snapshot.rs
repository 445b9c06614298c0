//! Published state of an episode.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};

use super::lockstep::Lockstep;
use super::spec::Spec;
use super::status::{Outcome, Status};
use swarmbench_clock::after;
use swarmbench_journal::chain::Head;

/// State of an episode between two rounds, shared by all readers. Only the marks of seats that have acted change.
#[derive(Debug)]
pub struct Snapshot {
    pub status: Status,
    pub world: Arc<World>,
    /// Head of the journal's hash chain.
    pub head: Head,
    pub outcome: Option<Outcome>,
    /// Time of the publication, from which the clock of the open round runs; empty before.
    opened_at: OnceLock<Timestamp>,
    /// Position of the open round in the order in which rounds were first seen; empty until somebody sees it.
    place: OnceLock<u64>,
    /// Rest of the bank of each agent when the round opened.
    pub banks: Vec<Duration>,
    /// Agents whose act in the open round is durable.
    acted: Vec<AtomicBool>,
}

impl Snapshot {
    /// Snapshot of the state of the barrier.
    pub(super) fn new(lockstep: &Lockstep, world: &Arc<World>, head: Head) -> Arc<Self> {
        let agents = usize::from(world.config().num_agents());
        let snapshot = Self {
            status: lockstep.status(),
            world: Arc::clone(world),
            head,
            outcome: lockstep.outcome(),
            opened_at: OnceLock::new(),
            place: OnceLock::new(),
            banks: lockstep.banks(),
            acted: (0..agents).map(|_| AtomicBool::new(false)).collect(),
        };
        for agent in lockstep.acted() {
            snapshot.set_acted(agent);
        }
        Arc::new(snapshot)
    }

    /// Whether the agent's act for the open round is durable.
    pub fn has_acted(&self, agent: AgentId) -> bool {
        self.acted[agent.index()].load(Ordering::Acquire)
    }

    /// Marks the agent's act for the open round as durable.
    pub(crate) fn set_acted(&self, agent: AgentId) {
        self.acted[agent.index()].store(true, Ordering::Release);
    }

    pub fn opened_at(&self) -> Option<Timestamp> {
        self.opened_at.get().copied()
    }

    /// Sets the time of the publication, once.
    pub(crate) fn set_opened(&self, at: Timestamp) {
        self.opened_at.get_or_init(|| at);
    }

    /// Position of the open round in the order in which rounds were first seen. The first look sets it, so an unseen round never
    /// comes before a seen one.
    pub fn place(&self, next: impl FnOnce() -> u64) -> u64 {
        *self.place.get_or_init(next)
    }

    /// Whether the open round waits for this agent.
    pub fn waits_for(&self, agent: AgentId) -> bool {
        self.status == Status::Running && self.world.is_alive(agent) && !self.has_acted(agent)
    }

    /// Time at which the agent's clock runs out in the open round: the deadline, plus its bank.
    pub fn deadline(&self, spec: &Spec, agent: AgentId) -> Option<Timestamp> {
        let round = spec.round_deadline.filter(|_| self.status == Status::Running)?;
        let opened_at = self.opened_at()?;
        let bank = self.banks[agent.index()];
        self.world.is_alive(agent).then(|| after(opened_at, round + bank))
    }
}
