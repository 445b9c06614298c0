//! The reference's line: how it would play on from a state.

use swarmbench_engine::{Act, Scratch, World};

use crate::Game;
use crate::appraiser::Players;

/// A round of the reference's line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineRound {
    /// The reference's acts, by agent.
    pub acts: Vec<Act>,
    /// The state after the round.
    pub world: World,
}

/// Plays the reference swarm from the state after `round` rounds of the game, for `rounds` rounds at most. The players see all
/// earlier states first, as those of a fork do.
#[must_use]
pub fn line(game: &Game, round: usize, rounds: usize) -> Vec<LineRound> {
    let mut world = World::clone(&game.layout);
    let (mut players, mut scratch) = (Players::new(&world), Scratch::default());
    for decided in game.rounds.iter().take(round) {
        players.decide(&world);
        let acts: Vec<Act> = decided.iter().map(|decided| decided.act.clone()).collect();
        world.step_in(&acts, &mut scratch);
    }
    let mut line = Vec::new();
    while line.len() < rounds && !world.is_over() {
        let acts = players.decide(&world);
        world.step_in(&acts, &mut scratch);
        line.push(LineRound { acts, world: world.clone() });
    }
    line
}
