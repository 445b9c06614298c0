//! Batches of environments that are stepped together.

use std::sync::Arc;

use rayon::{ThreadPool, ThreadPoolBuilder};
use swarmbench_engine::{AgentId, Config, Digest, Message, Seed, SettingErrors, Settings, World};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

use crate::arrays::{Frame, Gains};
use crate::environment::{Desk, Environment, NO_ACTION, Plan, action};
use crate::options::{Autoreset, Options, Shape};
use crate::record::{Recording, StateError};

/// Maximum environments that one thread steps alone: that is faster than waking another thread.
const ALONE_MAX: usize = 32;

/// Number of parts of a batch for each thread, so that a slow part does not keep the other threads waiting.
const PARTS_PER_THREAD: usize = 4;

/// The reason why a batch was not made or a call failed. The environments are unchanged then.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// Settings that cannot be played.
    #[error("{0}")]
    Settings(#[from] SettingErrors),
    /// A number of environments that a batch cannot have.
    #[error("num_envs must be from 1 to {max}, is {0}", max = Options::ENVIRONMENTS_MAX)]
    Environments(usize),
    /// There is no such environment.
    #[error("there is no environment {index}: this batch has the environments 0 to {last}", last = count - 1)]
    NoEnvironment {
        /// The requested number.
        index: usize,
        /// Number of environments.
        count: usize,
    },
    /// There is no such agent.
    #[error("there is no agent {agent}: these games have the agents 0 to {last}", last = count - 1)]
    NoAgent {
        /// The requested number.
        agent: usize,
        /// Number of agents.
        count: usize,
    },
    /// An array of another size.
    #[error("{what} must have {expected} elements, has {is}")]
    Size {
        /// The array with the wrong size.
        what: &'static str,
        /// The right size.
        expected: usize,
        /// The actual size.
        is: usize,
    },
    /// A number that is not an action.
    #[error("environment {environment}, agent {agent}: actions are 0 to {last}, or -1 for none, not {action}", last = count - 1)]
    NoAction {
        /// The environment.
        environment: usize,
        /// The agent.
        agent: usize,
        /// The number.
        action: u8,
        /// The number of actions.
        count: usize,
    },
    /// An episode is over, and automatic resets are disabled.
    #[error(
        "the episode of environment {0} is over: reset it before the next step (autoreset is disabled)"
    )]
    Over(usize),
    /// Acts were not recorded.
    #[error("acts are not recorded: make the environments with record=True")]
    NotRecorded,
    /// Built-in players cannot play in this environment.
    #[error("these partners cannot play here: {0}")]
    Partners(&'static str),
    /// There is no built-in player of that name.
    #[error(transparent)]
    Player(#[from] swarmbench_players::UnknownPlayer),
    /// A state cannot be loaded.
    #[error(transparent)]
    State(#[from] StateError),
    /// The prompt's template failed.
    #[error("the prompt template failed: {0}")]
    Template(#[from] swarmbench_prompt::TemplateError),
    /// No threads could be started.
    #[error("no threads could be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// A message that an agent sends with its next act.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    /// The environment.
    pub environment: usize,
    /// The sender.
    pub agent: AgentId,
    /// The text.
    pub text: Message,
    /// The only receiver of a commander's message.
    pub to: Option<AgentId>,
}

/// The acts of all agents in a step.
#[derive(Debug)]
pub struct Turn<'a> {
    /// Environments × agents: the index of an action among those of the task, or 255 for none. Actions of agents that
    /// may not act have no effect.
    pub actions: &'a [u8],
    /// The messages, at most one of each agent.
    pub messages: Vec<Said>,
}

/// Environments of the same settings, stepped together. Results do not depend on the number of threads.
#[derive(Debug)]
pub struct Batch {
    plan: Plan,
    parts: Vec<Part>,
    pool: Option<ThreadPool>,
}

/// Environments that one thread steps in sequence.
#[derive(Debug)]
struct Part {
    /// The number of the first environment.
    first: usize,
    environments: Vec<Environment>,
    desk: Desk,
}

impl Batch {
    /// Makes a batch whose environments have begun an episode each; the seed of the settings is not used for their
    /// layouts.
    ///
    /// # Errors
    /// If the settings cannot be played, or not that many environments.
    pub fn new(settings: &Settings, options: Options) -> Result<Self, BatchError> {
        if !(1..=Options::ENVIRONMENTS_MAX).contains(&options.environments) {
            return Err(BatchError::Environments(options.environments));
        }
        let config = Config::admit(settings)?;
        let shape = Shape::new(&config, &options);
        let plan = Plan { config, options, shape };
        let threads = match options.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let pool = (threads > 1 && options.environments > ALONE_MAX)
            .then(|| ThreadPoolBuilder::new().num_threads(threads).build())
            .transpose()?;
        let parts = if pool.is_some() { threads * PARTS_PER_THREAD } else { 1 };
        let each = options.environments.div_ceil(parts).max(1);
        let mut made = Vec::new();
        for first in (0..options.environments).step_by(each) {
            let numbers = first..options.environments.min(first + each);
            let environments = numbers.map(|index| Environment::new(&plan, index)).collect();
            made.push(Part { first, environments, desk: Desk::default() });
        }
        Ok(Self { plan, parts: made, pool })
    }

    /// The sizes of all arrays.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        self.plan.shape
    }

    /// The settings, with the seed with which the batch was made.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.plan.config
    }

    /// The options of the batch.
    #[must_use]
    pub const fn options(&self) -> &Options {
        &self.plan.options
    }

    /// Begins other episodes in all environments, or in those that `only` selects. `seeds` are the seeds of the
    /// layouts, one for each environment, or empty to draw them; later seeds of an environment are derived from its
    /// last given one.
    ///
    /// # Errors
    /// If sizes differ, or the agents do not fit on one of the layouts.
    pub fn reset(
        &mut self,
        seeds: &[Seed],
        only: Option<&[bool]>,
        frame: Frame<'_>,
    ) -> Result<(), BatchError> {
        let count = self.plan.shape.environments;
        self.check_frame(&frame)?;
        let right = |what, is| size(what, count, is);
        if !seeds.is_empty() {
            right("seed", seeds.len())?;
        }
        if let Some(only) = only {
            right("mask", only.len())?;
        }
        let is_meant = |index: usize| only.is_none_or(|only| only[index]);
        let config = &self.plan.config;
        let configs = seeds.iter().enumerate().map(|(index, &seed)| {
            if is_meant(index) { config.with_seed(seed).map(Some) } else { Ok(None) }
        });
        let mut configs: Vec<Option<Config>> = configs.collect::<Result<_, _>>()?;
        self.each(frame, |plan, index, environment, desk, frame| {
            if is_meant(index) {
                match configs.get_mut(index).and_then(Option::take) {
                    Some(config) => environment.begin_with(config, index),
                    None => environment.begin_next(plan),
                }
            }
            environment.write(plan, desk, frame);
        });
        Ok(())
    }

    /// Plays a round in every environment.
    ///
    /// # Errors
    /// If sizes differ, a number is not an action, or an episode is over and automatic resets are disabled.
    pub fn step(
        &mut self,
        turn: Turn<'_>,
        mut frame: Frame<'_>,
        mut gains: Gains<'_>,
        mut last: Option<Frame<'_>>,
    ) -> Result<(), BatchError> {
        self.check_frame(&frame)?;
        last.as_ref().map_or(Ok(()), |last| self.check_frame(last))?;
        self.check_turn(&turn)?;
        let Shape { environments, agents, .. } = self.plan.shape;
        if !gains.fits(&self.plan.shape) {
            size("rewards", environments * agents, gains.rewards.len())?;
            size("team_reward", environments, gains.team_reward.len())?;
        }
        for said in turn.messages {
            let place = said.environment;
            self.at_mut(place)?.said.push(said);
        }
        let plan = &self.plan;
        let job = Job {
            plan,
            parts: &mut self.parts,
            codes: turn.actions,
            frame: frame.reborrow(),
            gains: gains.reborrow(),
            last: last.as_mut().map(Frame::reborrow),
        };
        match &self.pool {
            Some(pool) => pool.install(|| job.run()),
            None => job.run_here(),
        }
        Ok(())
    }

    /// Copies the state of one environment into others; writes the observations of those.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn fork(&mut self, from: usize, to: &[usize], frame: Frame<'_>) -> Result<(), BatchError> {
        self.check_frame(&frame)?;
        let source = self.at(from)?.clone();
        for &index in to {
            self.at(index)?;
        }
        for &index in to.iter().filter(|&&index| index != from) {
            let environment = self.at_mut(index)?;
            environment.world.clone_from(&source.world);
            environment.recording.clone_from(&source.recording);
        }
        let chosen: Vec<usize> = to.to_vec();
        self.write_some(&chosen, frame);
        Ok(())
    }

    /// The state of an environment as bytes, for [`Batch::load`] here or elsewhere.
    ///
    /// # Errors
    /// If there is no such environment, or acts are not recorded.
    pub fn state(&self, index: usize) -> Result<Vec<u8>, BatchError> {
        let environment = self.recorded(index)?;
        Ok(environment.recording.to_bytes(environment.world.config()))
    }

    /// Restores an environment from a state of [`Batch::state`] by playing its acts again.
    ///
    /// # Errors
    /// If the bytes are not a state, or are one of a game with other settings.
    pub fn load(&mut self, index: usize, state: &[u8], frame: Frame<'_>) -> Result<(), BatchError> {
        self.check_frame(&frame)?;
        self.at(index)?;
        let (config, recording) = Recording::read(state)?;
        let same = self.plan.config.with_seed(config.seed()).is_ok_and(|own| own == config);
        if !same {
            return Err(StateError::OtherGame(difference(&self.plan.config, &config)).into());
        }
        let world = recording.play(&Arc::new(config))?;
        let record = self.plan.options.record;
        let environment = self.at_mut(index)?;
        environment.world = world;
        environment.recording = if record { recording } else { Recording::default() };
        self.write_some(&[index], frame);
        Ok(())
    }

    /// The digest of an environment's state.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn digest(&self, index: usize) -> Result<Digest, BatchError> {
        Ok(self.at(index)?.world.digest())
    }

    /// The journal of an environment's episode so far, as a file that `swarmbench verify` reads.
    ///
    /// # Errors
    /// If there is no such environment, or acts are not recorded.
    pub fn journal(
        &self,
        index: usize,
        episode: String,
        created_at: jiff::Timestamp,
    ) -> Result<String, BatchError> {
        let environment = self.recorded(index)?;
        let config = environment.world.config();
        Ok(environment.recording.journal(config, episode, created_at, swarmbench_prompt::BUILT_IN))
    }

    /// An agent's observation, in the server's form.
    ///
    /// # Errors
    /// If there is no such environment or agent.
    pub fn sight(&self, index: usize, agent: usize) -> Result<Sight, BatchError> {
        let world = &self.at(index)?.world;
        let agent = self.agent(agent)?;
        let status = if world.is_over() { Status::Finished } else { Status::Running };
        let description = swarmbench_prompt::tasks::description(world.config());
        Ok(Sight::of(&world.observe(agent), String::new(), description, status, None))
    }

    /// An agent's observation, as text for a language model.
    ///
    /// # Errors
    /// If there is no such environment or agent, or the template fails.
    pub fn prompt(&self, index: usize, agent: usize, template: &str) -> Result<String, BatchError> {
        let sight = self.sight(index, agent)?;
        Ok(swarmbench_prompt::render(template, &sight, self.at(index)?.world.config())?)
    }

    /// The whole map, row by row, in the symbols that agents see: a number for each agent, after a `$` if its light is
    /// on or it carries food.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn map(&self, index: usize) -> Result<Vec<Vec<String>>, BatchError> {
        let seen = self.at(index)?.world.spectator_view();
        let mut rows: Vec<Vec<String>> =
            seen.grid.iter().map(|row| row.chars().map(String::from).collect()).collect();
        for state in seen.agents.iter().filter(|state| state.alive) {
            let marked = state.light_on.or(state.carrying_food) == Some(true);
            let place = |at: i32| usize::try_from(at).expect("on the map");
            let mark = if marked { "$" } else { "" };
            rows[place(state.at.i)][place(state.at.j)] = format!("{mark}{}", state.agent.0);
        }
        Ok(rows)
    }

    /// All messages that agents have received with their current observations: environment, agent and text, in this
    /// order.
    pub fn heard(&self) -> impl Iterator<Item = (usize, AgentId, &Message)> {
        let numbered = |part: &Part| part.first..;
        let all = self.parts.iter().flat_map(move |part| numbered(part).zip(&part.environments));
        all.flat_map(|(index, environment)| {
            let world = &environment.world;
            let living = world.heard().filter(|delivery| world.is_alive(delivery.receiver));
            living.map(move |delivery| (index, delivery.receiver, delivery.text))
        })
    }

    /// Calls `act` for each environment with its part of the frame.
    fn each(
        &mut self,
        frame: Frame<'_>,
        mut act: impl FnMut(&Plan, usize, &mut Environment, &mut Desk, &mut Frame<'_>),
    ) {
        let mut rest = frame;
        for part in &mut self.parts {
            for (environment, index) in part.environments.iter_mut().zip(part.first..) {
                let (mut own, after) = rest.split(1, &self.plan.shape);
                act(&self.plan, index, environment, &mut part.desk, &mut own);
                rest = after;
            }
        }
    }

    fn write_some(&mut self, chosen: &[usize], frame: Frame<'_>) {
        self.each(frame, |plan, index, environment, desk, frame| {
            if chosen.contains(&index) {
                environment.write(plan, desk, frame);
            }
        });
    }

    fn check_frame(&self, frame: &Frame<'_>) -> Result<(), BatchError> {
        let Shape { environments, agents, .. } = self.plan.shape;
        if frame.fits(&self.plan.shape) {
            return Ok(());
        }
        size("position", environments * agents * 2, frame.position.len())?;
        size(
            "view",
            environments * agents * self.plan.shape.planes * self.plan.shape.cells(),
            frame.view.len(),
        )?;
        Err(BatchError::Size { what: "an array", expected: environments, is: frame.round.len() })
    }

    /// Checks a whole turn before any environment is stepped.
    fn check_turn(&self, turn: &Turn<'_>) -> Result<(), BatchError> {
        let Shape { environments, agents, actions, .. } = self.plan.shape;
        size("actions", environments * agents, turn.actions.len())?;
        let task = self.plan.config.task();
        let unknown = |&code: &u8| code != NO_ACTION && action(task, code).is_none();
        if let Some(place) = turn.actions.iter().position(unknown) {
            return Err(BatchError::NoAction {
                environment: place / agents,
                agent: place % agents,
                action: turn.actions[place],
                count: actions,
            });
        }
        for said in &turn.messages {
            self.at(said.environment)?;
            self.agent(said.agent.index())?;
            said.to.map_or(Ok(said.agent), |to| self.agent(to.index()))?;
        }
        if self.plan.options.autoreset == Autoreset::Disabled {
            let mut all =
                self.parts.iter().flat_map(|part| part.environments.iter().zip(part.first..));
            if let Some((_, index)) = all.find(|(environment, _)| environment.is_over()) {
                return Err(BatchError::Over(index));
            }
        }
        Ok(())
    }

    pub(crate) fn agent(&self, agent: usize) -> Result<AgentId, BatchError> {
        let count = self.plan.shape.agents;
        let number = u16::try_from(agent).ok().filter(|_| agent < count);
        number.map(AgentId).ok_or(BatchError::NoAgent { agent, count })
    }

    pub(crate) fn world(&self, index: usize) -> Result<&World, BatchError> {
        Ok(&self.at(index)?.world)
    }

    fn recorded(&self, index: usize) -> Result<&Environment, BatchError> {
        let environment = self.at(index)?;
        if self.plan.options.record { Ok(environment) } else { Err(BatchError::NotRecorded) }
    }

    fn at(&self, index: usize) -> Result<&Environment, BatchError> {
        let count = self.plan.shape.environments;
        let each = self.parts[0].environments.len();
        let part = self.parts.get(index / each);
        let found = part.and_then(|part| part.environments.get(index % each));
        found.ok_or(BatchError::NoEnvironment { index, count })
    }

    fn at_mut(&mut self, index: usize) -> Result<&mut Environment, BatchError> {
        let count = self.plan.shape.environments;
        let each = self.parts[0].environments.len();
        let part = self.parts.get_mut(index / each);
        let found = part.and_then(|part| part.environments.get_mut(index % each));
        found.ok_or(BatchError::NoEnvironment { index, count })
    }
}

/// A step of some parts of a batch.
struct Job<'a> {
    plan: &'a Plan,
    parts: &'a mut [Part],
    codes: &'a [u8],
    frame: Frame<'a>,
    gains: Gains<'a>,
    last: Option<Frame<'a>>,
}

impl Job<'_> {
    /// Splits the parts in halves until each job has one, and runs the jobs on the threads of the pool.
    fn run(self) {
        if self.parts.len() <= 1 {
            return self.run_here();
        }
        let Self { plan, parts, codes, frame, gains, last } = self;
        let (left, right) = parts.split_at_mut(parts.len() / 2);
        let count = left.iter().map(|part| part.environments.len()).sum();
        let shape = &plan.shape;
        let codes = codes.split_at(count * shape.agents);
        let (frame, gains) = (frame.split(count, shape), gains.split(count, shape));
        let last = match last {
            Some(last) => {
                let (before, after) = last.split(count, shape);
                (Some(before), Some(after))
            }
            None => (None, None),
        };
        let left =
            Job { plan, parts: left, codes: codes.0, frame: frame.0, gains: gains.0, last: last.0 };
        let right = Job {
            plan,
            parts: right,
            codes: codes.1,
            frame: frame.1,
            gains: gains.1,
            last: last.1,
        };
        rayon::join(|| left.run(), || right.run());
    }

    fn run_here(self) {
        let Self { plan, parts, codes, mut frame, mut gains, mut last } = self;
        let shape = &plan.shape;
        let mut codes = codes.chunks_exact(shape.agents);
        for part in parts {
            for environment in &mut part.environments {
                let codes = codes.next().expect("an act for each agent");
                let (mut own, rest) = frame.split(1, shape);
                let (mut earned, unearned) = gains.split(1, shape);
                let (mut own_last, rest_last) = match last {
                    Some(last) => {
                        let (own, rest) = last.split(1, shape);
                        (Some(own), Some(rest))
                    }
                    None => (None, None),
                };
                let own_last = own_last.as_mut();
                environment.step(plan, codes, &mut part.desk, &mut own, &mut earned, own_last);
                (frame, gains, last) = (rest, unearned, rest_last);
            }
        }
    }
}

fn size(what: &'static str, expected: usize, is: usize) -> Result<(), BatchError> {
    if expected == is { Ok(()) } else { Err(BatchError::Size { what, expected, is }) }
}

/// The settings in which two games differ.
fn difference(own: &Config, other: &Config) -> String {
    let (own, other) = (own.settings(), other.settings());
    let mut differ: Vec<String> = Settings::NAMES
        .iter()
        .filter_map(|name| {
            let (own, other) = (own.get(name)?, other.get(name)?);
            (own != other).then(|| format!("{name} is {other} there and {own} here"))
        })
        .collect();
    for (name, own, other) in [("task", own.task, other.task), ("rules", own.rules, other.rules)] {
        if own != other {
            differ.push(format!("{name} is {other} there and {own} here"));
        }
    }
    differ.join(", ")
}
