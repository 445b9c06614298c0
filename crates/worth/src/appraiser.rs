//! Rollouts of the reference swarm from the states of a game.

use std::sync::Arc;
use std::thread;

use swarmbench_engine::{Act, Action, AgentId, Scratch, World};
use swarmbench_players::{BuiltIn, Player, Seat, default_for};

/// Rollouts of a thread before their values are noted.
const ROLLOUTS_OF_A_THREAD: usize = 4;

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
    /// The same as the worth before the round.
    AsBefore,
    /// The same as the worth after the round.
    AsAfter,
    Rolled(f64),
}

/// What an appraiser did.
enum Step {
    /// It decided or resolved a round.
    Prepared,
    Rollout(Box<Rollout>),
    /// Nothing is left.
    Over,
}

/// A round with these acts, from which the reference plays on.
struct Rollout {
    /// Round, and number of the rollout in it.
    place: (usize, usize),
    world: World,
    players: Players,
    acts: Vec<Act>,
}

impl Rollout {
    /// Plays to the end of the game. Returns the number of decisions.
    fn run(&mut self, scratch: &mut Scratch) -> u64 {
        self.world.step_in(&self.acts, scratch);
        self.players.play_on(&mut self.world, scratch)
    }
}

/// Computes the worth of a game in pieces. The result depends neither on the pieces nor on the number of threads.
pub struct Appraiser {
    game: Game,
    with_seats: bool,
    world: World,
    /// Players of the reference, by seat, which have seen all states before this one.
    players: Players,
    /// The reference's acts in this state, once they are decided; the players have seen it then.
    decided: Option<Vec<Act>>,
    scratch: Scratch,
    /// Decisions that were computed so far.
    decisions: u64,
    /// By round: the worth before it, then the worth after it with the reference's act of each seat.
    known: Vec<Vec<Known>>,
    scores: Vec<f64>,
    kinds: Vec<Vec<Option<Kind>>>,
    reference_acts: Vec<Vec<Act>>,
}

impl Appraiser {
    /// Begins with a game; `with_seats` adds the losses of each seat, which take as many times longer as there are seats.
    #[must_use]
    pub fn new(game: Game, with_seats: bool) -> Self {
        let world = World::clone(&game.layout);
        Self {
            players: Players::new(&world),
            scores: vec![world.score()],
            game,
            with_seats,
            world,
            decided: None,
            scratch: Scratch::default(),
            decisions: 0,
            known: Vec::new(),
            kinds: Vec::new(),
            reference_acts: Vec::new(),
        }
    }

    /// Works until `decisions` more decisions of players were computed, or a rollout longer. True once all is done.
    pub fn work(&mut self, decisions: u64) -> bool {
        let until = self.decisions.saturating_add(decisions);
        while self.decisions < until {
            match self.advance() {
                Step::Prepared => {}
                Step::Rollout(mut rollout) => {
                    self.decisions += rollout.run(&mut self.scratch);
                    self.note(&rollout);
                }
                Step::Over => return true,
            }
        }
        false
    }

    /// Works to the end on some threads; their number changes nothing but the time. Calls `progress` with the rounds that are done.
    pub fn finish_on(mut self, threads: usize, progress: impl Fn(usize)) -> Worth {
        let (at_once, mut is_over) = (threads.max(1) * ROLLOUTS_OF_A_THREAD, false);
        while !is_over {
            let mut rollouts = Vec::new();
            while rollouts.len() < at_once && !is_over {
                match self.advance() {
                    Step::Prepared => {}
                    Step::Rollout(rollout) => rollouts.push(rollout),
                    Step::Over => is_over = true,
                }
            }
            thread::scope(|scope| {
                for some in rollouts.chunks_mut(ROLLOUTS_OF_A_THREAD) {
                    scope.spawn(|| {
                        let mut scratch = Scratch::default();
                        for rollout in some {
                            rollout.run(&mut scratch);
                        }
                    });
                }
            });
            for rollout in &rollouts {
                self.note(rollout);
            }
            progress(self.kinds.len());
        }
        self.finish()
    }

    /// Works to the end.
    #[must_use]
    pub fn finish(mut self) -> Worth {
        while !self.work(u64::MAX) {}
        // A game that is not over has something to score after its last round.
        let mut world = self.world.clone();
        self.players.play_on(&mut world, &mut self.scratch);
        let mut values = vec![world.score(); self.known.len() + 1];
        for (round, known) in self.known.iter().enumerate().rev() {
            values[round] = known[0].value(values[round], values[round + 1]);
        }
        let losses = |(round, known): (usize, &Vec<Known>)| {
            let (before, after) = (values[round], values[round + 1]);
            known[1..].iter().map(|known| known.value(before, after) - after).collect()
        };
        let seats = self.with_seats.then(|| self.known.iter().enumerate().map(losses).collect());
        Worth {
            reference: reference(&self.game.layout).name,
            score: self.world.score(),
            values,
            scores: self.scores,
            seats,
            kinds: self.kinds,
            reference_acts: self.reference_acts,
        }
    }

    /// Decides a round, prepares its next rollout, or resolves it if it has no more.
    fn advance(&mut self) -> Step {
        let round = self.kinds.len();
        let Some(acts) = self.game.rounds.get(round) else { return Step::Over };
        let acts: Vec<Act> = acts.iter().map(|decided| decided.act.clone()).collect();
        let Some(reference) = &self.decided else {
            let reference = self.players.decide(&self.world);
            self.decisions += reference.len() as u64;
            self.decided = Some(reference);
            self.known.push(Vec::new());
            return Step::Prepared;
        };
        let next = self.known[round].len();
        if next == if self.with_seats { acts.len() + 1 } else { 1 } {
            self.resolve(round, &acts);
            return Step::Prepared;
        }
        let differing: Vec<usize> = self
            .world
            .agents()
            .filter(|agent| self.world.is_alive(*agent))
            .map(AgentId::index)
            .filter(|agent| acts[*agent] != reference[*agent])
            .collect();
        let known = match next.checked_sub(1) {
            None if differing.is_empty() => Some(Known::AsAfter),
            Some(seat) if differing == [seat] => Some(Known::AsBefore),
            Some(seat) if !differing.contains(&seat) => Some(Known::AsAfter),
            _ => None,
        };
        // A rollout notes its value when it has run.
        self.known[round].push(known.unwrap_or(Known::Rolled(f64::NAN)));
        if known.is_some() {
            return Step::Prepared;
        }
        let acts = match next.checked_sub(1) {
            None => reference.clone(),
            Some(seat) => {
                let mut changed = acts;
                changed[seat].clone_from(&reference[seat]);
                changed
            }
        };
        let (world, players) = (self.world.clone(), self.players.clone());
        Step::Rollout(Box::new(Rollout { place: (round, next), world, players, acts }))
    }

    /// Notes the value of a rollout that has run.
    fn note(&mut self, rollout: &Rollout) {
        let (round, number) = rollout.place;
        self.known[round][number] = Known::Rolled(rollout.world.score());
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
        self.scores.push(self.world.score());
        self.reference_acts.extend(self.decided.take());
    }
}

impl Known {
    const fn value(self, before: f64, after: f64) -> f64 {
        match self {
            Self::Rolled(value) => value,
            Self::AsBefore => before,
            Self::AsAfter => after,
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
