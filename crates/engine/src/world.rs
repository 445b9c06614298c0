//! The whole state of an episode.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::act::{Act, AgentId};
use crate::body::Board;
use crate::config::Config;
use crate::mail::{Delivery, Mail};
use crate::message::Message;
use crate::tasks::{self, Task};

/// The whole state: it decides all further rounds and the observations of every agent.
///
/// Clones share the remembered rounds, so a clone costs about as much as the board.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    pub(crate) config: Arc<Config>,
    pub(crate) board: Board,
    pub(crate) task: Task,
    pub(crate) round: u32,
    pub(crate) score: f64,
    pub(crate) mail: Mail,
    /// The last rounds, newest first, as many as an agent remembers.
    pub(crate) past: VecDeque<Arc<Moment>>,
}

/// The remembered part of a resolved round.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moment {
    pub(crate) round: u32,
    /// The board before the round, which its observations showed.
    pub(crate) board: Board,
    pub(crate) flags: Vec<bool>,
    /// The acts, by agent.
    pub(crate) acts: Vec<Act>,
    /// Approximate memory that no newer board shares, in bytes.
    pub(crate) bytes: usize,
}

impl Moment {
    /// Computes `bytes`, given the board after the round, with which the moment shares memory.
    pub(crate) fn settle(&mut self, after: &Board) {
        let texts: usize =
            self.acts.iter().filter_map(|act| act.message.as_ref()).map(Message::bytes).sum();
        self.bytes = size_of::<Self>()
            + self.board.bytes_beside(after)
            + size_of_val(&*self.flags)
            + size_of_val(&*self.acts)
            + texts;
    }
}

impl World {
    /// Lays an episode out (rules: *Layouts*).
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        let (board, task) = tasks::lay_out(&config);
        let mail = Mail::new(config.num_agents.into());
        Self { config, board, task, round: 0, score: 0.0, mail, past: VecDeque::new() }
    }

    /// The settings of the episode.
    #[must_use]
    pub const fn config(&self) -> &Arc<Config> {
        &self.config
    }

    /// All bodies, and the cells on which they lie.
    #[must_use]
    pub const fn board(&self) -> &Board {
        &self.board
    }

    /// Number of resolved rounds; also the number of the current round.
    #[must_use]
    pub const fn round(&self) -> u32 {
        self.round
    }

    /// The score so far.
    #[must_use]
    pub const fn score(&self) -> f64 {
        self.score
    }

    /// True if the task itself is done, before the last round or with it.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.task.is_done(&self.board)
    }

    /// True if the episode has ended: the task is done or all rounds are played.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.round >= self.config.max_round || self.is_done()
    }

    /// True if an agent is on the map; an escaped agent neither sees nor acts any more.
    #[must_use]
    pub fn is_alive(&self, agent: AgentId) -> bool {
        self.board.agents().get(agent.index()).is_some_and(|body| !body.gone)
    }

    /// Approximate memory of this state in bytes, including the remembered rounds. Clones and later states share a part
    /// of it, so the sum over several states is too large.
    ///
    /// The call takes time in proportion to the number of messages under way.
    #[must_use]
    pub fn approximate_bytes(&self) -> usize {
        let past: usize = self.past.iter().map(|moment| moment.bytes).sum();
        let layout = 4096;
        layout + size_of::<Self>() + self.board.bytes() + self.mail.bytes(&self.config) + past
    }

    /// The messages delivered with the current observations, by receiver, then by text.
    pub fn heard(&self) -> impl Iterator<Item = Delivery<'_>> {
        self.mail.deliveries()
    }

    /// All agents in order of their numbers.
    pub fn agents(&self) -> impl Iterator<Item = AgentId> + use<> {
        (0..self.config.num_agents).map(AgentId)
    }
}
