//! Rollouts of the reference swarm from the states of a game.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::{iter, thread};

use swarmbench_engine::{Act, Action, AgentId, Config, Scratch, World};
use swarmbench_players::{Player, Seat, default_for};

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
    /// [`Kind::Invalid`] or [`Kind::Late`], if the agent did not decide itself.
    pub fault: Option<Kind>,
}

swarmbench_engine::named! {
    /// Kind of a decision, for sums of losses.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Kind {
        /// The answer had no valid action.
        Invalid = "invalid",
        /// The clock of the seat expired.
        Late = "late",
        /// The agent pushed and did not move.
        Blocked = "blocked",
        /// The agent stayed, or did nothing.
        Waited = "waited",
        /// The agent moved.
        Moved = "moved",
        /// The agent switched its light.
        Switched = "switched",
    }
}

impl Kind {
    /// The kind of an agent's decision that led from one state to the next.
    fn of(decided: &Decided, agent: AgentId, before: &World, after: &World) -> Self {
        let at = |world: &World| world.board().agents()[agent.index()].at();
        let was_blocked = at(before) == at(after) && after.is_alive(agent);
        decided.fault.unwrap_or(match decided.act.action {
            None | Some(Action::Stay) => Self::Waited,
            Some(Action::Switch) => Self::Switched,
            Some(_) if was_blocked => Self::Blocked,
            Some(_) => Self::Moved,
        })
    }
}

/// The worth of all states of a game, and what its decisions lost.
#[derive(Clone, Debug)]
pub struct Worth {
    /// The game.
    pub game: Game,
    /// Worth by state: before the first round, then after each round. The last one is the score where the game is over.
    pub values: Vec<f64>,
    /// Score by state.
    pub scores: Vec<f64>,
    /// Losses by round and agent, 0 for agents that had escaped; `None` if they were not asked for.
    pub seats: Option<Vec<Vec<f64>>>,
    /// Kinds of decisions by round and agent; `None` for agents that had escaped.
    pub kinds: Vec<Vec<Option<Kind>>>,
    /// Acts of the reference in the states before each round, by agent.
    pub reference_acts: Vec<Vec<Act>>,
}

/// Value of a rollout.
#[derive(Clone, Copy, Debug)]
enum Known {
    /// The worth of a state.
    At(usize),
    Rolled(f64),
}

impl Known {
    fn value(self, worths: &[f64]) -> f64 {
        match self {
            Self::At(state) => worths[state],
            Self::Rolled(value) => value,
        }
    }
}

/// Step of an appraiser.
enum Step {
    /// A round was decided or resolved.
    Prepared,
    Rollout(Box<Rollout>),
    Over,
}

/// A game that the reference plays on.
struct Rollout {
    /// Round, and number of the rollout in it.
    place: (usize, usize),
    world: World,
    players: Players,
    /// Acts of the first round; `None` for those of the reference.
    acts: Option<Vec<Act>>,
}

impl Rollout {
    /// Plays to the end of the game, or until the time is up.
    fn run(&mut self, is_time_up: &dyn Fn() -> bool, scratch: &mut Scratch) {
        while !self.world.is_over() && !is_time_up() {
            let acts = self.acts.take().unwrap_or_else(|| self.players.decide(&self.world));
            self.world.step_in(&acts, scratch);
        }
    }
}

/// Computes the worth of a game in pieces. The result depends neither on the pieces nor on the number of threads.
pub struct Appraiser {
    game: Game,
    with_seats: bool,
    world: World,
    /// Players of the reference, by seat, which have seen all states before this one.
    players: Players,
    /// The reference's acts in this state, once they are decided, and the seats whose acts differ. The players have seen the state then.
    decided: Option<(Vec<Act>, Vec<usize>)>,
    scratch: Scratch,
    /// A rollout that has begun.
    begun: Option<Box<Rollout>>,
    /// Values of rollouts by round: the worth before it, then the worth after it with the reference's act of each seat. A last one is of
    /// the state after all rounds.
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
            begun: None,
            known: Vec::new(),
            kinds: Vec::new(),
            reference_acts: Vec::new(),
        }
    }

    /// Works until the time is up, which it asks after each round that it plays. Breaks with the worth once all is done.
    pub fn work(
        mut self: Box<Self>,
        is_time_up: &dyn Fn() -> bool,
    ) -> ControlFlow<Worth, Box<Self>> {
        while !is_time_up() {
            match self.begun.take().map_or_else(|| self.advance(), Step::Rollout) {
                Step::Prepared => {}
                Step::Rollout(mut rollout) => {
                    rollout.run(is_time_up, &mut self.scratch);
                    if rollout.world.is_over() {
                        self.note(&rollout);
                    } else {
                        self.begun = Some(rollout);
                    }
                }
                Step::Over => return ControlFlow::Break(self.finish()),
            }
        }
        ControlFlow::Continue(self)
    }

    /// Works to the end on some threads; their number changes nothing but the time. Calls `progress` with the rounds that are done.
    pub fn finish_on(mut self, threads: usize, progress: impl Fn(usize)) -> Worth {
        let at_once = threads.max(1) * ROLLOUTS_OF_A_THREAD;
        loop {
            let next = || loop {
                match self.advance() {
                    Step::Prepared => {}
                    Step::Rollout(rollout) => return Some(rollout),
                    Step::Over => return None,
                }
            };
            let mut rollouts: Vec<Box<Rollout>> = iter::from_fn(next).take(at_once).collect();
            if rollouts.is_empty() {
                return self.finish();
            }
            thread::scope(|scope| {
                for some in rollouts.chunks_mut(ROLLOUTS_OF_A_THREAD) {
                    scope.spawn(|| {
                        let mut scratch = Scratch::default();
                        for rollout in some {
                            rollout.run(&|| false, &mut scratch);
                        }
                    });
                }
            });
            for rollout in &rollouts {
                self.note(rollout);
            }
            progress(self.kinds.len());
        }
    }

    /// The worth, once all rollouts have run.
    fn finish(self) -> Worth {
        let rounds = self.game.rounds.len();
        // A game that is over has nothing to score after its last round.
        let mut values = vec![self.world.score(); rounds + 1];
        for (state, known) in self.known.iter().enumerate().rev() {
            values[state] = known[0].value(&values);
        }
        let losses = |(round, known): (usize, &Vec<Known>)| {
            known[1..].iter().map(|known| known.value(&values) - values[round + 1]).collect()
        };
        let seats = self.known.iter().take(rounds).enumerate();
        let seats = self.with_seats.then(|| seats.map(losses).collect());
        Worth {
            game: self.game,
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
        let Some(decided) = self.game.rounds.get(round) else {
            if self.world.is_over() || self.known.len() > round {
                return Step::Over;
            }
            self.known.push(Vec::new());
            return self.rollout(None);
        };
        let mut acts: Vec<Act> = decided.iter().map(|decided| decided.act.clone()).collect();
        let Some((reference, differing)) = &self.decided else {
            let reference = self.players.decide(&self.world);
            let differs = |seat: &usize| acts[*seat] != reference[*seat];
            let alive = self.world.agents().filter(|agent| self.world.is_alive(*agent));
            let differing = alive.map(AgentId::index).filter(differs).collect();
            self.decided = Some((reference, differing));
            self.known.push(Vec::new());
            return Step::Prepared;
        };
        let next = self.known[round].len();
        if next == if self.with_seats { acts.len() + 1 } else { 1 } {
            self.resolve(round, &acts);
            return Step::Prepared;
        }
        let known = match next.checked_sub(1) {
            None if differing.is_empty() => Some(Known::At(round + 1)),
            Some(seat) if *differing == [seat] => Some(Known::At(round)),
            Some(seat) if !differing.contains(&seat) => Some(Known::At(round + 1)),
            _ => None,
        };
        if let Some(known) = known {
            self.known[round].push(known);
            return Step::Prepared;
        }
        match next.checked_sub(1) {
            None => acts.clone_from(reference),
            Some(seat) => acts[seat].clone_from(&reference[seat]),
        }
        self.rollout(Some(acts))
    }

    /// The next rollout of a round. It notes its value when it has run.
    fn rollout(&mut self, acts: Option<Vec<Act>>) -> Step {
        let round = self.known.len() - 1;
        let place = (round, self.known[round].len());
        self.known[round].push(Known::Rolled(f64::NAN));
        let (world, players) = (self.world.clone(), self.players.clone());
        Step::Rollout(Box::new(Rollout { place, world, players, acts }))
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
        self.reference_acts.extend(self.decided.take().map(|(acts, _)| acts));
    }
}

/// Players of the reference, by seat.
#[derive(Clone)]
pub(crate) struct Players(Vec<Box<dyn Player>>);

impl Players {
    /// Players before the first round. They are seeded as those that a server hosts in a fork.
    pub(crate) fn new(layout: &World) -> Self {
        let reference = default_for(layout.config().task());
        let make = |agent| reference.make(&Seat::hosted(layout.config(), agent, b""));
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
}

/// Rounds that all rollouts of a game of `rounds` resolved rounds have at most: they last to the last round that the settings allow.
#[must_use]
pub fn rounds_of(config: &Config, rounds: u32, with_seats: bool) -> u64 {
    let (agents, last) = (u64::from(config.num_agents()), u64::from(config.max_round()));
    let rounds = u64::from(rounds).min(last);
    // The sum of `last - t` for the states t from 0 to `rounds`.
    let rolled = (rounds + 1) * last - rounds * (rounds + 1) / 2;
    rolled.saturating_mul(if with_seats { agents + 1 } else { 1 })
}
