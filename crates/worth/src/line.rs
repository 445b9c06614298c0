//! The reference's line: how it would play on from a state.

use std::ops::ControlFlow;

use swarmbench_engine::{Act, AgentState, Scratch, World};
use swarmbench_protocol::worth::{LineAgent, LineRound, ReferenceLine};

use crate::appraiser::Players;
use crate::{Game, method};

/// Plays the reference swarm from the state after `round` rounds of a game, for `rounds` rounds at most, in pieces. The players see all
/// earlier states first, as those of a fork do.
pub struct Liner {
    game: Game,
    round: u32,
    rounds: u32,
    world: World,
    players: Players,
    line: Vec<LineRound>,
}

impl Liner {
    /// Begins with a game that has at least `round` rounds.
    #[must_use]
    pub fn new(game: Game, round: u32, rounds: u32) -> Self {
        let world = World::clone(&game.layout);
        Self { players: Players::new(&world), world, game, round, rounds, line: Vec::new() }
    }

    /// Works until the time is up, which it asks after each round. Breaks with the line once all is done.
    pub fn work(
        mut self: Box<Self>,
        is_time_up: &dyn Fn() -> bool,
    ) -> ControlFlow<ReferenceLine, Box<Self>> {
        let mut scratch = Scratch::default();
        while !is_time_up() {
            let round = self.world.round();
            if self.world.is_over() || round >= self.round.saturating_add(self.rounds) {
                let method = method(self.world.config().task());
                let line =
                    ReferenceLine { episode: None, round: self.round, method, rounds: self.line };
                return ControlFlow::Break(line);
            }
            let mut acts = self.players.decide(&self.world);
            if round < self.round {
                let played = &self.game.rounds[round as usize];
                acts = played.iter().map(|decided| decided.act.clone()).collect();
            }
            self.world.step_in(&acts, &mut scratch);
            if round >= self.round {
                let agents = self.world.agent_states().zip(&acts).map(agent).collect();
                self.line.push(LineRound { round, score: self.world.score(), agents });
            }
        }
        ControlFlow::Continue(self)
    }
}

fn agent((state, act): (AgentState, &Act)) -> LineAgent {
    LineAgent {
        agent: state.agent.to_string(),
        action: act.action.map(|action| action.name().to_owned()),
        at: [state.at.i, state.at.j],
        alive: state.alive,
    }
}
