//! Rollouts of the reference swarm from the states of a game.

use std::sync::Arc;

use swarmbench_engine::{Act, Action, AgentId, Scratch, World};
use swarmbench_players::{BuiltIn, Player, Seat, default_for};

/// A game as it was played.
#[derive(Clone, Debug)]
pub struct Game {
    /// The state before the first round.
    pub layout: Arc<World>,
    /// Decisions by round and agent; as many as agents in every round.
    pub rounds: Vec<Vec<Decided>>,
}

/// A decision as the engine resolved it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Decided {
    /// The act.
    pub act: Act,
    /// True if no action could be read from the answer.
    pub is_invalid: bool,
    /// True if the clock of the seat expired.
    pub is_late: bool,
}

/// Kind of a decision, for sums of losses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The answer had no valid action.
    Invalid,
    /// The clock of the seat expired.
    Late,
    /// The agent pushed and did not move.
    Blocked,
    /// The agent stayed, or did nothing.
    Waited,
    /// The agent moved.
    Moved,
    /// The agent switched its light.
    Switched,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 6] =
        [Self::Invalid, Self::Late, Self::Blocked, Self::Waited, Self::Moved, Self::Switched];

    /// The name, in lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Invalid => "invalid",
            Self::Late => "late",
            Self::Blocked => "blocked",
            Self::Waited => "waited",
            Self::Moved => "moved",
            Self::Switched => "switched",
        }
    }

    /// The kind of an agent's decision that led from one state to the next.
    fn of(decided: &Decided, agent: AgentId, before: &World, after: &World) -> Self {
        let at = |world: &World| world.board().agents()[agent.index()].at();
        let was_blocked = at(before) == at(after) && after.is_alive(agent);
        match decided.act.action {
            _ if decided.is_late => Self::Late,
            _ if decided.is_invalid => Self::Invalid,
            None | Some(Action::Stay) => Self::Waited,
            Some(Action::Switch) => Self::Switched,
            Some(_) if was_blocked => Self::Blocked,
            Some(_) => Self::Moved,
        }
    }
}

/// The worth of all states of a game, and what its decisions lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Worth {
    /// Name of the reference.
    pub reference: &'static str,
    /// Worth by state: before the first round, then after each round. The last one is the score where the game is over.
    pub values: Vec<f64>,
    /// Score by state.
    pub scores: Vec<f64>,
    /// Score of the game.
    pub score: f64,
    /// Losses by round and agent, 0 for agents that had escaped; `None` if they were not asked for.
    pub seats: Option<Vec<Vec<f64>>>,
    /// Kinds of decisions by round and agent; `None` for agents that had escaped.
    pub kinds: Vec<Vec<Option<Kind>>>,
    /// Acts of the reference in the states before each round, by agent.
    pub reference_acts: Vec<Vec<Act>>,
}

impl Worth {
    /// Losses by round. They sum to the first worth minus the last.
    #[must_use]
    pub fn losses(&self) -> Vec<f64> {
        self.values.windows(2).map(|pair| pair[0] - pair[1]).collect()
    }

    /// The first state from which on the reference scores nothing more.
    #[must_use]
    pub fn settled(&self) -> usize {
        let could_score = |state: &usize| self.values[*state] > self.scores[*state];
        (0..self.values.len()).rev().find(could_score).map_or(0, |last| last + 1)
    }
}

/// A value that a rollout has, or another one has as well.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Known {
    /// Another appraiser computes it.
    Elsewhere,
    /// The same as the worth before the round.
    AsBefore,
    /// The same as the worth after the round.
    AsAfter,
    Rolled(f64),
}

/// Computes the worth of a game in pieces. The result does not depend on the pieces, nor on how many appraisers share the work.
pub struct Appraiser {
    game: Game,
    with_seats: bool,
    /// Number of this appraiser, and of all that share the work.
    share: (usize, usize),
    world: World,
    /// Players of the reference, by seat, which have seen all states before this one.
    players: Players,
    /// The reference's acts in this state, once they are decided; the players have seen it then.
    decided: Option<Vec<Act>>,
    /// The next rollout of this round: 0 for the worth, then seat by seat.
    next: usize,
    scratch: Scratch,
    /// Decisions that were computed so far.
    decisions: u64,
    values: Vec<Known>,
    seats: Vec<Vec<Known>>,
    scores: Vec<f64>,
    kinds: Vec<Vec<Option<Kind>>>,
    reference_acts: Vec<Vec<Act>>,
}

impl Appraiser {
    /// Begins with a game; `with_seats` adds the losses of each seat, which take as many times longer as there are seats.
    #[must_use]
    pub fn new(game: Game, with_seats: bool) -> Self {
        Self::sharing(game, with_seats, (0, 1))
    }

    /// Begins with the part `share.0` of `share.1` of the work; [`Self::join`] puts the parts together.
    #[must_use]
    pub fn sharing(game: Game, with_seats: bool, share: (usize, usize)) -> Self {
        let world = World::clone(&game.layout);
        let players = Players::new(&world);
        Self {
            scores: vec![world.score()],
            game,
            with_seats,
            share,
            world,
            players,
            decided: None,
            next: 0,
            scratch: Scratch::default(),
            decisions: 0,
            values: Vec::new(),
            seats: Vec::new(),
            kinds: Vec::new(),
            reference_acts: Vec::new(),
        }
    }

    /// Number of rounds whose rollouts are done.
    #[must_use]
    pub const fn rounds(&self) -> usize {
        self.values.len()
    }

    /// Works until `decisions` more decisions of players were computed, or a rollout longer. True once all is done.
    pub fn work(&mut self, decisions: u64) -> bool {
        let until = self.decisions.saturating_add(decisions);
        while self.decisions < until {
            if !self.advance() {
                return true;
            }
        }
        self.rounds() == self.game.rounds.len()
    }

    /// Works to the end.
    #[must_use]
    pub fn finish(mut self) -> Worth {
        while !self.work(u64::MAX) {}
        Self::join(vec![self])
    }

    /// Does the next rollout, or resolves the round if it has no more. False at the end of the game.
    fn advance(&mut self) -> bool {
        let round = self.rounds();
        let Some(acts) = self.game.rounds.get(round) else { return false };
        let acts: Vec<Act> = acts.iter().map(|decided| decided.act.clone()).collect();
        let Some(reference) = &self.decided else {
            let reference = self.players.decide(&self.world);
            self.decisions += reference.len() as u64;
            self.decided = Some(reference);
            self.seats.push(Vec::new());
            self.next = 0;
            return true;
        };
        let rollouts = if self.with_seats { acts.len() + 1 } else { 1 };
        if self.next == rollouts {
            self.resolve(round, &acts);
            return true;
        }
        let differs = |agent: AgentId| {
            self.world.is_alive(agent) && acts[agent.index()] != reference[agent.index()]
        };
        let (known, first) = match self.next.checked_sub(1) {
            None => {
                let is_same = !self.world.agents().any(differs);
                (is_same.then_some(Known::AsAfter), reference.clone())
            }
            Some(seat) => {
                let mut changed = acts.clone();
                changed[seat].clone_from(&reference[seat]);
                let mut others = self.world.agents().filter(|agent| differs(*agent));
                let known = match (others.next(), others.next()) {
                    (Some(only), None) if only.index() == seat => Some(Known::AsBefore),
                    _ if !differs(AgentId(u16::try_from(seat).unwrap_or(u16::MAX))) => {
                        Some(Known::AsAfter)
                    }
                    _ => None,
                };
                (known, changed)
            }
        };
        let is_mine = round % self.share.1 == self.share.0;
        let known = match known {
            Some(known) => known,
            None if !is_mine => Known::Elsewhere,
            None => {
                let mut world = self.world.clone();
                world.step_in(&first, &mut self.scratch);
                let mut players = self.players.clone();
                self.decisions += players.play_on(&mut world, &mut self.scratch);
                Known::Rolled(world.score())
            }
        };
        self.seats[round].push(known);
        self.next += 1;
        true
    }

    /// Resolves a round as it was played.
    fn resolve(&mut self, round: usize, acts: &[Act]) {
        let before = self.world.clone();
        self.world.step_in(acts, &mut self.scratch);
        let kind = |agent: AgentId| {
            let decided = &self.game.rounds[round][agent.index()];
            before.is_alive(agent).then(|| Kind::of(decided, agent, &before, &self.world))
        };
        self.kinds.push(before.agents().map(kind).collect());
        self.values.push(self.seats[round].remove(0));
        self.scores.push(self.world.score());
        self.reference_acts.extend(self.decided.take());
    }

    /// Puts the parts of the work together. All of them are done.
    ///
    /// # Panics
    /// Panics if a part is missing.
    #[must_use]
    pub fn join(parts: Vec<Self>) -> Worth {
        let mut parts = parts.into_iter();
        let mut all = parts.next().expect("there is a part");
        for part in parts {
            let here = all.values.iter_mut().chain(all.seats.iter_mut().flatten());
            for (known, other) in here.zip(part.values.iter().chain(part.seats.iter().flatten())) {
                if *known == Known::Elsewhere {
                    *known = *other;
                }
            }
        }
        // A game that is not over has something to score after its last round.
        let last = all.last_value();
        let mut values = vec![last; all.values.len() + 1];
        for (round, known) in all.values.iter().enumerate().rev() {
            values[round] = known.value(values[round], values[round + 1]);
        }
        let losses = |(round, seats): (usize, &Vec<Known>)| {
            let (before, after) = (values[round], values[round + 1]);
            seats.iter().map(|known| known.value(before, after) - after).collect()
        };
        let seats = all.with_seats.then(|| all.seats.iter().enumerate().map(losses).collect());
        Worth {
            reference: reference(&all.game.layout).name,
            score: all.world.score(),
            values,
            scores: all.scores,
            seats,
            kinds: all.kinds,
            reference_acts: all.reference_acts,
        }
    }

    fn last_value(&mut self) -> f64 {
        let mut world = self.world.clone();
        self.players.play_on(&mut world, &mut self.scratch);
        world.score()
    }
}

impl Known {
    fn value(self, before: f64, after: f64) -> f64 {
        match self {
            Self::Rolled(value) => value,
            Self::AsBefore => before,
            Self::AsAfter => after,
            Self::Elsewhere => unreachable!("a part of the work is missing"),
        }
    }
}

/// The reference of the task.
pub(crate) fn reference(world: &World) -> &'static BuiltIn {
    default_for(world.config().task())
}

/// Players of the reference, by seat.
#[derive(Clone)]
pub(crate) struct Players(Vec<Box<dyn Player>>);

impl Players {
    /// Players before the first round. They are seeded as those that a server hosts in a fork.
    pub(crate) fn new(layout: &World) -> Self {
        let make = |agent| reference(layout).make(&Seat::hosted(layout.config(), agent, b""));
        Self(layout.agents().map(make).collect())
    }

    /// Decides a round as hosted players do: one without a decision stays, and agents that have escaped are not asked.
    pub(crate) fn decide(&mut self, world: &World) -> Vec<Act> {
        let decide = |(agent, player): (AgentId, &mut Box<dyn Player>)| {
            if !world.is_alive(agent) {
                return Act::default();
            }
            let mut act = player.decide(&world.observe(agent));
            act.action.get_or_insert(Action::Stay);
            act
        };
        world.agents().zip(&mut self.0).map(decide).collect()
    }

    /// Plays to the end of the game. Returns the number of decisions.
    fn play_on(&mut self, world: &mut World, scratch: &mut Scratch) -> u64 {
        let mut decisions = 0;
        while !world.is_over() {
            let acts = self.decide(world);
            decisions += acts.len() as u64;
            world.step_in(&acts, scratch);
        }
        decisions
    }
}
