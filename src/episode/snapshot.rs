//! What is published of an episode.

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

/// An episode between two rounds: what all readers share. Only the marks of seats that have acted change.
#[derive(Debug)]
pub struct Snapshot {
    pub status: Status,
    pub world: Arc<World>,
    /// The head of the journal's chain.
    pub head: Head,
    /// How the episode ended, if it has.
    pub outcome: Option<Outcome>,
    /// When this was published: the clock of the open round runs from here. None before that.
    opened_at: OnceLock<Timestamp>,
    /// The place of the open round among all rounds that were seen, once it was.
    place: OnceLock<u64>,
    /// By agent, what is left of its bank at the opening of the round.
    pub banks: Vec<Duration>,
    /// By agent, whether it acted in the open round, durably.
    acted: Vec<AtomicBool>,
}

impl Snapshot {
    /// The state of an episode as its barrier has it.
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

    /// Whether the agent acted in the open round.
    pub fn has_acted(&self, agent: AgentId) -> bool {
        self.acted[agent.index()].load(Ordering::Acquire)
    }

    /// Notes that the agent's act for the open round is durable.
    pub(crate) fn set_acted(&self, agent: AgentId) {
        self.acted[agent.index()].store(true, Ordering::Release);
    }

    /// When this was published, if it was.
    pub fn opened_at(&self) -> Option<Timestamp> {
        self.opened_at.get().copied()
    }

    /// Notes that this is published now.
    pub(crate) fn set_opened(&self, at: Timestamp) {
        self.opened_at.get_or_init(|| at);
    }

    /// The place of the open round among all rounds that were seen. The first look sets
    /// it: so an unseen round never comes before a seen one.
    pub fn place(&self, next: impl FnOnce() -> u64) -> u64 {
        *self.place.get_or_init(next)
    }

    /// Whether the open round waits for this agent.
    pub fn waits_for(&self, agent: AgentId) -> bool {
        self.status == Status::Running && self.world.is_alive(agent) && !self.has_acted(agent)
    }

    /// When the agent's clock runs out in the open round: its deadline, and its bank after that.
    pub fn deadline(&self, spec: &Spec, agent: AgentId) -> Option<Timestamp> {
        let round = spec.round_deadline.filter(|_| self.status == Status::Running)?;
        let opened_at = self.opened_at()?;
        let bank = self.banks[agent.index()];
        self.world.is_alive(agent).then(|| after(opened_at, round + bank))
    }
}
