//! Worlds of the engine, and repeatable random decisions.

use std::sync::Arc;

use swarmbench_engine::{Act, Action, AgentId, Config, Message, Settings, World};

/// A small generator of random numbers (`SplitMix64`), so that the seed alone identifies a case.
pub struct Dice(pub u64);

impl Dice {
    fn roll(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut value = self.0;
        value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        value ^ (value >> 31)
    }

    /// A number in `0..n`.
    pub fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.roll() % n as u64).expect("less than n")
    }
}

impl Dice {
    /// One decision for each agent: any action of the task or none, and a message from one agent
    /// in eight.
    pub fn acts(&mut self, world: &World) -> Vec<Act> {
        let actions = Action::of_task(world.config().task());
        let agents = usize::from(world.config().num_agents());
        (0..agents)
            .map(|_| {
                let says = self.below(8) == 0;
                let names_one = self.below(2) == 0;
                let to = u16::try_from(self.below(agents)).expect("an agent's number");
                Act {
                    action: actions.get(self.below(actions.len() + 1)).copied(),
                    message: says.then(|| Message::new("the block is to the left")).flatten(),
                    to: names_one.then_some(AgentId(to)),
                }
            })
            .collect()
    }
}

/// Lays out an episode of valid settings.
pub fn world(settings: &Settings) -> World {
    let config = Config::check(settings).expect("settings that can be played");
    World::new(Arc::new(config))
}
