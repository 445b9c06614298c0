//! Built-in players at some seats of an environment.

use swarmbench_engine::answer::{Answer, parse};
use swarmbench_engine::{Act, Action, AgentId, Seed};
use swarmbench_players::{Player, Seat, find};

use crate::batch::{Batch, BatchError};

/// Built-in players of one episode. They decide like the players that a server hosts.
pub struct Partners {
    seats: Vec<(AgentId, Box<dyn Player>)>,
    /// The seed of the layout that they play.
    seed: Seed,
    /// Next round for the players. They need every round, as a player's decisions depend on all earlier observations.
    round: u32,
}

impl std::fmt::Debug for Partners {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let agents: Vec<u16> = self.seats.iter().map(|(agent, _)| agent.0).collect();
        let mut shown = f.debug_struct("Partners");
        shown
            .field("agents", &agents)
            .field("seed", &self.seed)
            .field("round", &self.round)
            .finish()
    }
}

impl Batch {
    /// Makes built-in players, by their names, for agents of an environment whose episode has just begun.
    ///
    /// # Errors
    /// If there is no such environment, agent or player, or rounds of the episode are played already.
    pub fn partners(
        &self,
        index: usize,
        names: &[(usize, String)],
    ) -> Result<Partners, BatchError> {
        let world = self.world(index)?;
        if world.round() > 0 {
            return Err(BatchError::Partners("they can only join before the first round"));
        }
        let config = world.config();
        let make = |(agent, name): &(usize, String)| {
            let agent = self.agent(*agent)?;
            let player = find(name, config.task())?;
            Ok((agent, player.make(&Seat::hosted(config, agent, &[]))))
        };
        let seats = names.iter().map(make).collect::<Result<_, BatchError>>()?;
        Ok(Partners { seats, seed: config.seed(), round: 0 })
    }

    /// The acts of the partners' agents on the map in this round. Partners must be asked once in every round.
    ///
    /// # Errors
    /// If there is no such environment, or it is not in the round that the partners expect.
    pub fn decide(
        &self,
        index: usize,
        partners: &mut Partners,
    ) -> Result<Vec<(AgentId, Act)>, BatchError> {
        let world = self.world(index)?;
        if world.config().seed() != partners.seed || world.round() != partners.round {
            return Err(BatchError::Partners(
                "they were made for another episode, or were not asked in every round",
            ));
        }
        partners.round += 1;
        let living = partners.seats.iter_mut().filter(|(agent, _)| world.is_alive(*agent));
        let decide = |(agent, player): &mut (AgentId, Box<dyn Player>)| {
            let mut act = player.decide(&world.observe(*agent));
            // A player without a decision stays, as on a server.
            act.action.get_or_insert(Action::Stay);
            (*agent, act)
        };
        Ok(living.map(decide).collect())
    }

    /// Parses an answer of a language model, by the rules.
    ///
    /// # Errors
    /// If there is no such agent.
    pub fn read_answer(&self, agent: usize, text: &str) -> Result<Answer, BatchError> {
        Ok(parse(text, self.config(), self.agent(agent)?))
    }
}
