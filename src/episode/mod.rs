//! Running episodes.
//!
//! [`lockstep`] is the barrier as a pure machine: who acted, who may, whose clock ran out. [`actor`]
//! performs what it says, one task an episode. [`seating`] says who holds which seat. [`registry`] finds and starts them, and evicts idle
//! ones; [`recovery`] makes a running episode of a journal; [`replay`] makes states of
//! earlier rounds again; [`heavy`] says what leaves the async threads; [`quota`] counts what each owner
//! uses, [`memory`] how much memory an episode takes. Readers look at a [`Snapshot`], which never changes.

pub mod actor;
pub mod heavy;
pub mod in_flight;
pub mod lockstep;
pub mod memory;
pub mod quota;
pub mod recovery;
pub mod registry;
pub mod replay;
pub mod seating;
pub mod spec;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};

use crate::clock::after;
use crate::journal::chain::Head;
use spec::Spec;
pub use swarmbench_protocol::status::Status;

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The task was done.
    TaskDone,
    /// All rounds were played.
    RoundsPlayed,
    /// Its creator ended it.
    Aborted,
    /// Nobody acted for too long.
    Idle,
    /// Its competition closed.
    Closed,
}

impl Ending {
    /// Its name on the wire and in the journal.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TaskDone => "task_done",
            Self::RoundsPlayed => "rounds_played",
            Self::Aborted => "aborted",
            Self::Idle => "idle",
            Self::Closed => "closed",
        }
    }

    /// The ending with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::TaskDone, Self::RoundsPlayed, Self::Aborted, Self::Idle, Self::Closed]
            .into_iter()
            .find(|ending| ending.name() == name)
    }

    /// The status of an episode that ended so.
    #[must_use]
    pub const fn status(self) -> Status {
        match self {
            Self::TaskDone | Self::RoundsPlayed => Status::Finished,
            Self::Aborted | Self::Closed => Status::Aborted,
            Self::Idle => Status::Abandoned,
        }
    }
}

/// How an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Why.
    pub ending: Ending,
    /// When.
    pub at: Timestamp,
}

/// An episode between two rounds: what all readers share. It never changes, but that seats act.
#[derive(Debug)]
pub struct Snapshot {
    /// The status of the episode.
    pub status: Status,
    /// The state.
    pub world: Arc<World>,
    /// The head of the journal's chain.
    pub head: Head,
    /// How the episode ended, if it has.
    pub outcome: Option<Outcome>,
    /// When this was published: the clock of the open round runs from here. None before that.
    opened_at: OnceLock<Timestamp>,
    /// The place of the open round among all rounds that somebody has seen, once somebody has.
    place: OnceLock<u64>,
    /// By agent, what is left of its bank at the opening of the round.
    pub banks: Vec<Duration>,
    /// By agent, whether it acted in the open round, durably.
    acted: Vec<AtomicBool>,
}

impl Snapshot {
    /// Whether the agent acted in the open round.
    #[must_use]
    pub fn has_acted(&self, agent: AgentId) -> bool {
        self.acted[agent.index()].load(Ordering::Acquire)
    }

    /// Notes that the agent's act for the open round is durable.
    pub(crate) fn set_acted(&self, agent: AgentId) {
        self.acted[agent.index()].store(true, Ordering::Release);
    }

    /// When this was published, if it was.
    #[must_use]
    pub fn opened_at(&self) -> Option<Timestamp> {
        self.opened_at.get().copied()
    }

    /// Notes that this is published now.
    pub(crate) fn set_opened(&self, at: Timestamp) {
        self.opened_at.get_or_init(|| at);
    }

    /// The place of the open round among all rounds that somebody has seen. The first look says
    /// which it is: so an unseen round never comes before a seen one.
    #[must_use]
    pub fn place(&self, next: impl FnOnce() -> u64) -> u64 {
        *self.place.get_or_init(next)
    }

    /// Whether the open round waits for this agent.
    #[must_use]
    pub fn waits_for(&self, agent: AgentId) -> bool {
        self.status == Status::Running && self.world.is_alive(agent) && !self.has_acted(agent)
    }

    /// When the agent's clock runs out in the open round: its deadline, and its bank after that.
    #[must_use]
    pub fn deadline(&self, spec: &Spec, agent: AgentId) -> Option<Timestamp> {
        let round = spec.round_deadline.filter(|_| self.status == Status::Running)?;
        let opened_at = self.opened_at()?;
        let bank = self.banks[agent.index()];
        self.world.is_alive(agent).then(|| after(opened_at, round + bank))
    }
}
