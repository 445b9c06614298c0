//! The arrays into which environments write.
//!
//! All arrays are row by row, environments first; [`Shape`](crate::Shape) has the sizes. Each thread writes into its own part,
//! split between environments.

use crate::options::Shape;

/// Observations of agents.
#[derive(Debug)]
pub struct Frame<'a> {
    /// Environments × agents × planes × rows × columns.
    pub view: &'a mut [u8],
    /// Environments × agents × rows × columns: the number of the agent in a cell, −1 for none and for the agent itself.
    /// Empty without windows.
    pub numbers: &'a mut [i16],
    /// Environments × agents × 2: row and column, −1 once an agent has escaped.
    pub position: &'a mut [i32],
    /// Environments: rounds resolved.
    pub round: &'a mut [i32],
    /// Environments: the score of the whole swarm.
    pub score: &'a mut [f32],
    /// Environments × agents: whether the agent's light is on, or it carries food. Empty in tasks without either.
    pub flag: &'a mut [u8],
    /// Environments × agents: whether the agent may act.
    pub alive: &'a mut [bool],
    /// Environments × agents × actions.
    pub action_mask: &'a mut [bool],
    /// Environments: the seed of the current layout.
    pub seed: &'a mut [i64],
}

/// Rewards of a step, and the ends of agents and episodes.
#[derive(Debug)]
pub struct Gains<'a> {
    /// Environments × agents.
    pub rewards: &'a mut [f32],
    /// Environments: the change of the score.
    pub team_reward: &'a mut [f32],
    /// Environments: whether the episode has ended.
    pub terminated: &'a mut [bool],
    /// Environments × agents: whether the agent has escaped or the episode has ended.
    pub agent_done: &'a mut [bool],
}

/// Splits each slice in two; the first part has the elements of the first `count` environments.
macro_rules! split {
    ($kind:ident, $from:expr, $count:expr, { $($field:ident: $each:expr),* $(,)? }) => {{
        $(let $field = $from.$field.split_at_mut($count * $each);)*
        ($kind { $($field: $field.0),* }, $kind { $($field: $field.1),* })
    }};
}

impl Frame<'_> {
    pub(crate) fn reborrow(&mut self) -> Frame<'_> {
        Frame {
            view: self.view,
            numbers: self.numbers,
            position: self.position,
            round: self.round,
            score: self.score,
            flag: self.flag,
            alive: self.alive,
            action_mask: self.action_mask,
            seed: self.seed,
        }
    }
}

impl Frame<'_> {
    pub(crate) fn split(self, count: usize, shape: &Shape) -> (Self, Self) {
        let Shape { agents, planes, actions, flag, .. } = *shape;
        let cells = shape.cells();
        split!(Frame, self, count, {
            view: agents * planes * cells,
            numbers: if planes == 0 { 0 } else { agents * cells },
            position: agents * 2,
            round: 1,
            score: 1,
            flag: if flag.is_some() { agents } else { 0 },
            alive: agents,
            action_mask: agents * actions,
            seed: 1,
        })
    }

    /// True if all slices have the sizes of the shape.
    pub(crate) fn fits(&self, shape: &Shape) -> bool {
        let Shape { environments, agents, planes, actions, flag, .. } = *shape;
        let seats = environments * agents;
        let windows = if planes == 0 { 0 } else { seats * shape.cells() };
        self.view.len() == windows * planes
            && self.numbers.len() == windows
            && self.position.len() == seats * 2
            && [self.round.len(), self.score.len(), self.seed.len()] == [environments; 3]
            && self.flag.len() == if flag.is_some() { seats } else { 0 }
            && self.alive.len() == seats
            && self.action_mask.len() == seats * actions
    }
}

impl Gains<'_> {
    pub(crate) fn reborrow(&mut self) -> Gains<'_> {
        Gains {
            rewards: self.rewards,
            team_reward: self.team_reward,
            terminated: self.terminated,
            agent_done: self.agent_done,
        }
    }
}

impl Gains<'_> {
    pub(crate) fn split(self, count: usize, shape: &Shape) -> (Self, Self) {
        let agents = shape.agents;
        split!(Gains, self, count, { rewards: agents, team_reward: 1, terminated: 1, agent_done: agents })
    }

    pub(crate) fn fits(&self, shape: &Shape) -> bool {
        let seats = shape.environments * shape.agents;
        [self.rewards.len(), self.agent_done.len()] == [seats; 2]
            && [self.team_reward.len(), self.terminated.len()] == [shape.environments; 2]
    }
}

/// Arrays of the right sizes, for callers without arrays of their own.
#[derive(Clone, Debug, Default, PartialEq)]
#[expect(missing_docs, reason = "the fields are those of Frame and Gains")]
pub struct Arrays {
    pub view: Vec<u8>,
    pub numbers: Vec<i16>,
    pub position: Vec<i32>,
    pub round: Vec<i32>,
    pub score: Vec<f32>,
    pub flag: Vec<u8>,
    pub alive: Vec<bool>,
    pub action_mask: Vec<bool>,
    pub seed: Vec<i64>,
    pub rewards: Vec<f32>,
    pub team_reward: Vec<f32>,
    pub terminated: Vec<bool>,
    pub agent_done: Vec<bool>,
}

impl Arrays {
    /// Arrays of zeros.
    #[must_use]
    pub fn new(shape: &Shape) -> Self {
        let Shape { environments, agents, planes, actions, flag, .. } = *shape;
        let seats = environments * agents;
        let windows = if planes == 0 { 0 } else { seats * shape.cells() };
        Self {
            view: vec![0; windows * planes],
            numbers: vec![0; windows],
            position: vec![0; seats * 2],
            round: vec![0; environments],
            score: vec![0.0; environments],
            flag: vec![0; if flag.is_some() { seats } else { 0 }],
            alive: vec![false; seats],
            action_mask: vec![false; seats * actions],
            seed: vec![0; environments],
            rewards: vec![0.0; seats],
            team_reward: vec![0.0; environments],
            terminated: vec![false; environments],
            agent_done: vec![false; seats],
        }
    }

    /// The observations.
    pub fn frame(&mut self) -> Frame<'_> {
        self.parts().0
    }

    /// The rewards.
    pub fn gains(&mut self) -> Gains<'_> {
        self.parts().1
    }

    /// Observations and rewards.
    pub fn parts(&mut self) -> (Frame<'_>, Gains<'_>) {
        (
            Frame {
                view: &mut self.view,
                numbers: &mut self.numbers,
                position: &mut self.position,
                round: &mut self.round,
                score: &mut self.score,
                flag: &mut self.flag,
                alive: &mut self.alive,
                action_mask: &mut self.action_mask,
                seed: &mut self.seed,
            },
            Gains {
                rewards: &mut self.rewards,
                team_reward: &mut self.team_reward,
                terminated: &mut self.terminated,
                agent_done: &mut self.agent_done,
            },
        )
    }
}
