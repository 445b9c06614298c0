//! Whole games in the process, for tests and benchmarks: the same players as over the network, shown the
//! same observations.

use std::sync::Arc;

use swarmbench_engine::{Act, Config, Observation, SettingErrors, Settings, World};

use crate::{BuiltIn, Player, Seat};

/// A game and the players of all its seats.
pub struct LocalGame {
    world: World,
    players: Vec<Box<dyn Player>>,
}

impl LocalGame {
    /// Lays a game out, with the same player on every seat. The players' seeds are independent of the layout's.
    #[must_use]
    pub fn new(config: Arc<Config>, built_in: &BuiltIn, seed: u64) -> Self {
        let world = World::new(config);
        let make = |agent| built_in.make(&Seat::of(world.config(), agent, seed));
        let players = world.agents().map(make).collect();
        Self { world, players }
    }

    /// The current state.
    #[must_use]
    pub const fn world(&self) -> &World {
        &self.world
    }

    /// Asks every player for its act of the current round, in the order of the agents' numbers.
    pub fn decide(&mut self) -> Vec<Act> {
        self.decide_by(|player, observation| player.decide(observation))
    }

    /// [`Self::decide`], with `ask` calling each player so that it can measure the time.
    pub fn decide_by(
        &mut self,
        mut ask: impl FnMut(&mut dyn Player, &Observation) -> Act,
    ) -> Vec<Act> {
        let seats = self.world.agents().zip(&mut self.players);
        seats.map(|(agent, player)| ask(&mut **player, &self.world.observe(agent))).collect()
    }

    /// Resolves the current round with these acts.
    pub fn step(&mut self, acts: &[Act]) {
        self.world.step(acts);
    }
}

/// Plays a game to its end. Returns the score and all acts, by round and agent.
///
/// # Errors
/// [`SettingErrors`] if the settings cannot be played.
pub fn play(
    built_in: &BuiltIn,
    settings: &Settings,
    seed: u64,
) -> Result<(f64, Vec<Vec<Act>>), SettingErrors> {
    let mut game = LocalGame::new(Arc::new(Config::check(settings)?), built_in, seed);
    let mut record = Vec::new();
    while !game.world.is_over() {
        let acts = game.decide();
        game.step(&acts);
        record.push(acts);
    }
    Ok((game.world.score(), record))
}
