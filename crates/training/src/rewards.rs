//! Rewards of agents for a round.

use swarmbench_engine::{AgentId, Pos, TaskName, World};

use crate::options::Rewards;

/// The part of the previous state on which the rewards of a round depend.
#[derive(Debug, Default)]
pub(crate) struct Before {
    score: f64,
    round: u32,
    /// Agents that carried food (Foraging) or were on the map (Transport), by agent.
    had: Vec<bool>,
}

impl Before {
    /// Records the state before a round.
    pub(crate) fn note(&mut self, world: &World) {
        (self.score, self.round) = (world.score(), world.round());
        self.had.clear();
        match world.config().task() {
            TaskName::Foraging => {
                let carrying = world.agent_states().map(|agent| agent.carrying_food == Some(true));
                self.had.extend(carrying);
            }
            TaskName::Transport => self.had.extend(world.agent_states().map(|agent| agent.alive)),
            TaskName::Pursuit | TaskName::Synchronization | TaskName::Flocking => {}
        }
    }

    /// Writes the reward of every agent; returns the change of the score.
    ///
    /// Individual rewards: in Foraging 1 for each load that the agent delivered, in Transport the score of its own
    /// escape, in Pursuit the point of a caught prey in equal shares to the agents beside it. They add up to the change
    /// of the score. In the other tasks every agent gets the change of the score.
    pub(crate) fn write(&self, world: &World, rewards: Rewards, row: &mut [f32]) -> f32 {
        let gained = narrow(world.score() - self.score);
        match (rewards, world.config().task()) {
            (Rewards::Individual, TaskName::Foraging) => {
                for ((reward, had), agent) in
                    row.iter_mut().zip(&self.had).zip(world.agent_states())
                {
                    let delivered = *had && agent.carrying_food == Some(false);
                    *reward = if delivered { 1.0 } else { 0.0 };
                }
            }
            (Rewards::Individual, TaskName::Transport) => {
                let limit = world.config().max_round();
                let share = narrow(f64::from(limit - self.round) / f64::from(limit));
                for ((reward, had), agent) in
                    row.iter_mut().zip(&self.had).zip(world.agent_states())
                {
                    *reward = if *had && !agent.alive { share } else { 0.0 };
                }
            }
            (Rewards::Individual, TaskName::Pursuit) => share_catch(world, row),
            _ => row.fill(gained),
        }
        gained
    }
}

/// Writes the point of a caught prey in equal shares to the agents beside it; to all agents if only walls are beside
/// it.
fn share_catch(world: &World, row: &mut [f32]) {
    row.fill(0.0);
    let Some(prey) = world.caught() else { return };
    let is_beside = |at: Pos| (at.i - prey.i).abs() + (at.j - prey.j).abs() == 1;
    let hunters = world.agent_states().filter(|agent| is_beside(agent.at)).count();
    let all = hunters == 0;
    let count = if all { row.len() } else { hunters };
    let share = narrow(1.0 / f64::from(u32::try_from(count).unwrap_or(u32::MAX)));
    for agent in world.agent_states().filter(|agent| all || is_beside(agent.at)) {
        row[AgentId::index(agent.agent)] = share;
    }
}

#[expect(clippy::cast_possible_truncation, reason = "arrays for training have single precision")]
pub(crate) const fn narrow(value: f64) -> f32 {
    value as f32
}
