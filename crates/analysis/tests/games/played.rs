//! Games for tests: written by hand, or played by the engine.

use std::sync::Arc;

use swarmbench_analysis::game::{Agent, Decision, Heard, Setup, State};
use swarmbench_analysis::{Definition, Meter, Metric, Metrics, Options, RunValue};
use swarmbench_engine::{
    Act, Action, AgentId, Config, Control, Message, Pos, Settings, TaskName, World,
};

/// The arguments of a meter for a whole game.
#[derive(Clone, Debug)]
pub(crate) struct Played {
    pub(crate) setup: Setup,
    pub(crate) layout: State,
    pub(crate) rounds: Vec<PlayedRound>,
}

#[derive(Clone, Debug)]
pub(crate) struct PlayedRound {
    pub(crate) decisions: Vec<Decision>,
    pub(crate) after: State,
    pub(crate) heard: Option<Vec<Heard>>,
}

impl Played {
    /// A game on an open map of 10 × 10 cells with agents on these cells and windows of 5 × 5.
    pub(crate) fn at(cells: &[(i32, i32)]) -> Self {
        let setup = Setup {
            task: TaskName::Pursuit,
            control: Control::Decentralized,
            height: 10,
            width: 10,
            view_size: 5,
            memory: Some(5),
            open_cells: 100,
        };
        Self { setup, layout: state(cells), rounds: Vec::new() }
    }

    /// Adds a round: the decisions, and the cells of the agents after it.
    pub(crate) fn then(mut self, decisions: &[Decision], cells: &[(i32, i32)]) -> Self {
        self.rounds.push(PlayedRound {
            decisions: decisions.to_vec(),
            after: state(cells),
            heard: Some(Vec::new()),
        });
        self
    }

    /// Adds a round in which nobody moves.
    pub(crate) fn chose(mut self, decisions: &[Decision]) -> Self {
        let after = self.rounds.last().map_or(&self.layout, |round| &round.after).clone();
        self.rounds.push(PlayedRound {
            decisions: decisions.to_vec(),
            after,
            heard: Some(Vec::new()),
        });
        self
    }

    pub(crate) fn last(&mut self) -> &mut State {
        self.rounds.last_mut().map_or(&mut self.layout, |round| &mut round.after)
    }

    /// Sets the messages delivered after the last round.
    pub(crate) fn delivering(mut self, heard: &[(u16, u16, u32, &str)]) -> Self {
        let heard = heard.iter().map(|&(receiver, sender, sent, text)| Heard {
            receiver: AgentId(receiver),
            sender: AgentId(sender),
            sent,
            text: text.to_owned(),
        });
        self.rounds.last_mut().expect("a round").heard = Some(heard.collect());
        self
    }

    /// All metrics of the game.
    pub(crate) fn metrics(&self) -> Metrics {
        let mut meter = Meter::new(self.setup.clone(), self.layout.clone(), Options::all(true));
        for round in &self.rounds {
            meter.round(&round.decisions, round.after.clone(), round.heard.as_deref());
        }
        meter.metrics()
    }

    /// The value of the game, by the definition `paper`.
    pub(crate) fn value(&self, metric: Metric) -> Option<f64> {
        self.run_value(metric).value
    }

    pub(crate) fn run_value(&self, metric: Metric) -> RunValue {
        self.metrics().values[&(Definition::Paper, metric)]
    }

    /// The value of the game, by the definition `toolkit`.
    pub(crate) fn toolkit(&self, metric: Metric) -> Option<f64> {
        self.metrics().values[&(Definition::Toolkit, metric)].value
    }

    /// A game that the engine played.
    pub(crate) fn by_engine(settings: &Settings, rounds: &[Vec<Act>]) -> Self {
        let config = Config::check(settings).expect("settings of a test are allowed");
        let mut world = World::new(Arc::new(config));
        let (setup, layout) = (Setup::of(&world), State::of(&world));
        let mut played = Self { setup, layout, rounds: Vec::new() };
        for acts in rounds {
            if world.is_over() {
                break;
            }
            let decided = world.agents().zip(acts).map(|(agent, act)| {
                let living = world.is_alive(agent);
                if living { decision(act) } else { Decision::default() }
            });
            let decisions = decided.collect();
            world.step(acts);
            let (after, heard) = (State::of(&world), Some(Heard::all(&world)));
            played.rounds.push(PlayedRound { decisions, after, heard });
        }
        played
    }
}

pub(crate) fn state(cells: &[(i32, i32)]) -> State {
    let agent = |&(i, j): &(i32, i32)| Agent { at: Pos::new(i, j), alive: true, light_on: None };
    State {
        score: 0.0,
        agents: cells.iter().map(agent).collect(),
        block: Vec::new(),
        prey_freedom: None,
    }
}

fn decision(act: &Act) -> Decision {
    let message = act.message.as_ref().map(Message::to_string);
    Decision { action: act.action, message, ..Decision::default() }
}

/// A decision without a message.
pub(crate) fn does(action: Action) -> Decision {
    Decision { action: Some(action), ..Decision::default() }
}

/// A decision to stay, with a message.
pub(crate) fn says(text: &str) -> Decision {
    Decision { message: Some(text.to_owned()), ..does(Action::Stay) }
}
