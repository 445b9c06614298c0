//! The states of a game as they are sent, made one after another.

use swarmbench_analysis::game::{Agent, Decision, Heard, Setup, State};
use swarmbench_analysis::{Meter, Metric, Options};
use swarmbench_engine::{Action, Direction, Pos};
use swarmbench_protocol::replay::{ReplayMark, ReplayMessage, ReplayState};

use super::talk::{Talk, heard};

/// Rounds before a page that its first state depends on: whether agents spoke, and whether their messages agreed.
pub const ROUNDS_BEFORE: u32 = 2;

/// The part of a state that replays show.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Agents and score.
    pub state: State,
    /// Numbers of the agents that carry food.
    pub loaded: Vec<u16>,
    /// The prey (Pursuit).
    pub prey: Option<Pos>,
    /// The block (Transport).
    pub block: Option<Pos>,
    /// The cost of the placement (Flocking).
    pub distance: Option<f64>,
}

/// Decisions and messages between two states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Round {
    /// Decisions in the order of the agents' numbers.
    pub decisions: Vec<Decision>,
    /// True if the decisions have actions; some imported games have messages only.
    pub has_actions: bool,
    /// Sender and receiver of each message that a commander addressed.
    pub to: Vec<(u16, u16)>,
    /// Messages read with the state after the round.
    pub heard: Vec<Heard>,
}

/// A state as sent, with the values of [`Reel::metrics`].
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The state.
    pub state: ReplayState,
    /// The values of its metrics.
    pub values: Vec<Option<f64>>,
}

/// A game shown state by state.
pub struct Reel {
    round: u32,
    scene: Scene,
    talk: Talk,
    metrics: Vec<Metric>,
    meter: Meter,
}

impl Reel {
    /// Starts at the state after `round` rounds.
    #[must_use]
    pub fn new(setup: Setup, scene: Scene, round: u32) -> Self {
        let metrics = Metric::of_rounds(setup.task).collect();
        let meter = Meter::new(setup, scene.state.clone(), Options::default());
        Self { round, scene, talk: Talk::default(), metrics, meter }
    }

    /// Metrics with a value for each state.
    #[must_use]
    pub fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    /// The frame of the first state, without decisions and values.
    #[must_use]
    pub fn first(&self) -> Frame {
        let state = shown(self.round, &self.scene);
        Frame { state, values: vec![None; self.metrics.len()] }
    }

    /// Adds a round and the state after it.
    pub fn step(&mut self, round: &Round, after: Scene) -> Frame {
        let Round { decisions, has_actions, to, heard: read } = round;
        let before = std::mem::replace(&mut self.scene, after);
        let after = &self.scene;
        self.meter.round(decisions, after.state.clone(), None);
        let talk = Talk::of(decisions);
        let state = ReplayState {
            actions: has_actions.then(|| decisions.iter().map(action).collect()),
            blocked: agents_that(&before, after, decisions, is_blocked),
            pushed: agents_that(&before, after, decisions, is_pushed),
            invalid: numbers(decisions, |decision| decision.invalid),
            timeouts: numbers(decisions, |decision| decision.timeout),
            said: said(decisions, to),
            heard: heard(self.round, decisions, read),
            marks: marks(&before, after, decisions, talk.marks(self.talk)),
            ..shown(self.round + 1, after)
        };
        self.round += 1;
        self.talk = talk;
        let (_, values) = self.meter.now();
        let value = |metric: &Metric| values[*metric as usize].filter(|_| *has_actions);
        let values = self.metrics.iter().map(value).collect();
        Frame { state, values }
    }
}

/// The part of a frame that depends on the state alone.
fn shown(round: u32, scene: &Scene) -> ReplayState {
    let agents = &scene.state.agents;
    ReplayState {
        round,
        score: scene.state.score,
        at: agents.iter().flat_map(|agent| [agent.at.i, agent.at.j]).collect(),
        gone: numbers(agents, |agent| !agent.alive),
        lit: numbers(agents, |agent| agent.light_on == Some(true)),
        loaded: scene.loaded.clone(),
        prey: scene.prey.map(cell),
        block: scene.block.map(cell),
        distance: scene.distance,
        ..ReplayState::default()
    }
}

const fn cell(at: Pos) -> [i32; 2] {
    [at.i, at.j]
}

/// Indices of the items with a property.
fn numbers<T>(items: &[T], holds: impl Fn(&T) -> bool) -> Vec<u16> {
    (0..).zip(items).filter(|(_, item)| holds(item)).map(|(number, _)| number).collect()
}

const fn action(decision: &Decision) -> char {
    match decision.action {
        Some(Action::Up) => 'U',
        Some(Action::Down) => 'D',
        Some(Action::Left) => 'L',
        Some(Action::Right) => 'R',
        Some(Action::Stay) => 'S',
        Some(Action::Switch) => 'X',
        None => '-',
    }
}

/// Numbers of the agents whose chosen direction and actual movement satisfy `is`; escaped agents are left out.
fn agents_that(
    before: &Scene,
    after: &Scene,
    decisions: &[Decision],
    is: fn(Option<Direction>, (i32, i32)) -> bool,
) -> Vec<u16> {
    let way = |from: &Agent, to: &Agent| (to.at.i - from.at.i, to.at.j - from.at.j);
    let agents = before.state.agents.iter().zip(&after.state.agents).zip(decisions);
    let found = (0..).zip(agents).filter(|(_, ((from, to), decision))| {
        from.alive && is(decision.action.and_then(Action::direction), way(from, to))
    });
    found.map(|(number, _)| number).collect()
}

pub(super) fn is_blocked(chosen: Option<Direction>, (down, across): (i32, i32)) -> bool {
    chosen.map(Direction::offset).is_some_and(|(di, dj)| di * down + dj * across <= 0)
}

pub(super) fn is_pushed(chosen: Option<Direction>, way: (i32, i32)) -> bool {
    way != (0, 0) && chosen.map(Direction::offset) != Some((way.0.signum(), way.1.signum()))
}

fn said(decisions: &[Decision], to: &[(u16, u16)]) -> Vec<ReplayMessage> {
    let receiver = |from| to.iter().find(|(sender, _)| *sender == from).map(|&(_, to)| to);
    let said = (0..).zip(decisions).filter_map(|(from, decision)| {
        Some(ReplayMessage { from, text: decision.message.clone()?, to: receiver(from) })
    });
    said.collect()
}

fn marks(
    before: &Scene,
    after: &Scene,
    decisions: &[Decision],
    of_talk: Option<ReplayMark>,
) -> Vec<ReplayMark> {
    let (was, is) = (before.state.score, after.state.score);
    let marks = [
        (is > was, ReplayMark::Points),
        (is < was, ReplayMark::Drop),
        (decisions.iter().any(|decision| decision.invalid), ReplayMark::Invalid),
        (decisions.iter().any(|decision| decision.timeout), ReplayMark::Timeout),
    ];
    let marks = marks.into_iter().filter(|(holds, _)| *holds).map(|(_, mark)| mark);
    marks.chain(of_talk).collect()
}
