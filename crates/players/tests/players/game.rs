//! A whole game in the process.

use std::sync::Arc;

use swarmbench_engine::{Act, Config, Settings, World};
use swarmbench_players::{BuiltIn, Player, Seat};

/// The players of all seats of a game. Their seeds have nothing to do with the episode's.
pub(crate) fn players(built_in: &BuiltIn, world: &World, seed: u64) -> Vec<Box<dyn Player>> {
    let settings = world.config().settings();
    let size = |cells: i64| u16::try_from(cells).expect("a map is small");
    let seat = |agent| Seat {
        agent,
        num_agents: world.config().num_agents(),
        width: size(settings.width),
        height: size(settings.height),
        task: world.config().task(),
        rules: world.config().rules(),
        seed: seed.wrapping_mul(1 << 16).wrapping_add(agent.index() as u64),
    };
    world.agents().map(|agent| built_in.make(&seat(agent))).collect()
}

/// What all agents decide in the current round.
pub(crate) fn decide(world: &World, players: &mut [Box<dyn Player>]) -> Vec<Act> {
    let seats = world.agents().zip(players);
    seats.map(|(agent, player)| player.decide(&world.observe(agent))).collect()
}

/// Plays a game to its end. Returns the score and everything that was decided, by round and agent.
pub(crate) fn play(built_in: &BuiltIn, settings: &Settings, seed: u64) -> (f64, Vec<Vec<Act>>) {
    let config = Config::check(settings).expect("playable settings");
    let mut world = World::new(Arc::new(config));
    let mut players = players(built_in, &world, seed);
    let mut record = Vec::new();
    while !world.is_over() {
        let acts = decide(&world, &mut players);
        world.step(&acts);
        record.push(acts);
    }
    (world.score(), record)
}
