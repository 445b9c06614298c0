//! What several test files and the benchmarks need: worlds, and random decisions that can be
//! repeated.

mod dice;

use std::sync::Arc;

use swarmbench_engine::{Act, Action, AgentId, Config, Message, Settings, World};

pub(crate) use dice::Dice;

impl Dice {
    /// One decision for each agent: any action of the task or none, and a message from one agent
    /// in eight.
    pub(crate) fn acts(&mut self, world: &World) -> Vec<Act> {
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

/// Lays out an episode whose settings are known to be good.
pub(crate) fn world(settings: &Settings) -> World {
    let config = Config::check(settings).expect("settings that can be played");
    World::new(Arc::new(config))
}
