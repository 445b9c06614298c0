//! One environment of a batch: a sequence of episodes.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench_engine::{Act, Action, Canvas, Config, Scratch, Seed, TaskName, World};

use crate::arrays::{Frame, Gains};
use crate::batch::Said;
use crate::options::{Autoreset, Mask, Options, Shape};
use crate::record::Recording;
use crate::rewards::{Before, narrow};
use crate::window::{hint, write_planes, write_symbols};

/// The code of an act without an action.
pub(crate) const NO_ACTION: u8 = u8::MAX;

/// Maximum number of seeds drawn for one episode: some layouts do not have room for many agents.
const DRAWS_MAX: usize = 1000;

/// The shared data of all environments of a batch.
#[derive(Debug)]
pub(crate) struct Plan {
    pub(crate) config: Config,
    pub(crate) options: Options,
    pub(crate) shape: Shape,
}

/// Memory that a thread reuses for each environment.
#[derive(Debug, Default)]
pub(crate) struct Desk {
    acts: Vec<Act>,
    before: Before,
    scratch: Scratch,
    canvas: Canvas,
    symbols: Vec<u8>,
}

#[derive(Clone, Debug)]
pub(crate) struct Environment {
    pub(crate) world: World,
    pub(crate) recording: Recording,
    /// Messages for the next round.
    pub(crate) said: Vec<Said>,
    seeds: ChaCha8Rng,
}

impl Environment {
    /// Makes the environment with the number `index`, in its first episode.
    pub(crate) fn new(plan: &Plan, index: usize) -> Self {
        let mut seeds = seeds(plan.options.seed, index);
        let world = World::new(Arc::new(draw(&plan.config, &mut seeds)));
        Self { world, recording: Recording::default(), said: Vec::new(), seeds }
    }

    /// Begins the episode of the next drawn seed.
    pub(crate) fn begin_next(&mut self, plan: &Plan) {
        let config = draw(&plan.config, &mut self.seeds);
        self.begin(config);
    }

    /// Begins the episode of a given layout; later seeds are drawn from its seed.
    pub(crate) fn begin_with(&mut self, config: Config, index: usize) {
        self.seeds = seeds(config.seed().get(), index);
        self.begin(config);
    }

    fn begin(&mut self, config: Config) {
        self.world = World::new(Arc::new(config));
        self.recording.clear();
        self.said.clear();
    }

    pub(crate) fn is_over(&self) -> bool {
        self.world.is_over()
    }

    /// Plays a round, or begins another episode if the last one is over. `last` receives the last observation of an
    /// episode if the same step begins the next one.
    pub(crate) fn step(
        &mut self,
        plan: &Plan,
        codes: &[u8],
        desk: &mut Desk,
        frame: &mut Frame<'_>,
        gains: &mut Gains<'_>,
        last: Option<&mut Frame<'_>>,
    ) {
        if self.is_over() {
            self.begin_next(plan);
            gains.rewards.fill(0.0);
            gains.team_reward[0] = 0.0;
            gains.terminated[0] = false;
            gains.agent_done.fill(false);
            self.write(plan, desk, frame);
            return;
        }
        desk.before.note(&self.world);
        self.play(plan, codes, desk);
        let is_over = self.is_over();
        gains.team_reward[0] = desk.before.write(&self.world, plan.options.rewards, gains.rewards);
        gains.terminated[0] = is_over;
        for (done, agent) in gains.agent_done.iter_mut().zip(self.world.agents()) {
            *done = is_over || !self.world.is_alive(agent);
        }
        if is_over && plan.options.autoreset == Autoreset::SameStep {
            if let Some(last) = last {
                self.write(plan, desk, last);
            }
            self.begin_next(plan);
        }
        self.write(plan, desk, frame);
    }

    fn play(&mut self, plan: &Plan, codes: &[u8], desk: &mut Desk) {
        let task = plan.config.task();
        desk.acts.clear();
        let acts =
            codes.iter().map(|&code| Act { action: action(task, code), message: None, to: None });
        desk.acts.extend(acts);
        for said in self.said.drain(..) {
            let act = &mut desk.acts[said.agent.index()];
            (act.message, act.to) = (Some(said.text), said.to);
        }
        if plan.options.record {
            self.recording.add(self.world.round(), codes, &desk.acts);
        }
        self.world.step_in(&desk.acts, &mut desk.scratch);
    }

    /// Writes the observations of all agents.
    pub(crate) fn write(&self, plan: &Plan, desk: &mut Desk, frame: &mut Frame<'_>) {
        let (world, shape) = (&self.world, &plan.shape);
        let is_over = self.is_over();
        frame.round[0] = i32::try_from(world.round()).unwrap_or(i32::MAX);
        frame.score[0] = narrow(world.score());
        frame.seed[0] = world.config().seed().into();
        let states = world.agent_states().zip(frame.position.chunks_exact_mut(2));
        let states = states.zip(frame.alive.iter_mut());
        let masks = frame.action_mask.chunks_exact_mut(shape.actions);
        for ((((state, position), alive), mask), seat) in states.zip(masks).zip(0..) {
            let at = if state.alive { [state.at.i, state.at.j] } else { [-1, -1] };
            position.copy_from_slice(&at);
            *alive = state.alive && !is_over;
            mask.fill(*alive);
            if shape.flag.is_some() {
                let flag = state.light_on.or(state.carrying_food) == Some(true);
                frame.flag[seat] = u8::from(flag);
            }
        }
        if shape.planes > 0 {
            self.write_windows(plan, desk, frame);
        }
    }

    fn write_windows(&self, plan: &Plan, desk: &mut Desk, frame: &mut Frame<'_>) {
        let shape = &plan.shape;
        let cells = shape.cells();
        let Desk { canvas, symbols, .. } = desk;
        canvas.draw(&self.world);
        symbols.resize(cells, 0);
        let views = frame.view.chunks_exact_mut(shape.planes * cells);
        let numbers = frame.numbers.chunks_exact_mut(cells);
        let masks = frame.action_mask.chunks_exact_mut(shape.actions);
        let seats = self.world.agents().zip(views).zip(numbers).zip(masks).zip(&*frame.alive);
        for ((((agent, view), numbers), mask), &is_alive) in seats {
            let symbols = if shape.planes == 1 {
                write_symbols(canvas, agent, view, numbers);
                view
            } else {
                write_symbols(canvas, agent, symbols, numbers);
                write_planes(symbols, view);
                &mut **symbols
            };
            if is_alive
                && plan.options.mask == Mask::Moves
                && let Some(own) = canvas.own_cell(agent)
            {
                hint(symbols, shape.window.1, own, mask);
            }
        }
    }
}

/// The action of a code: its index among the actions of the task.
pub(crate) fn action(task: TaskName, code: u8) -> Option<Action> {
    Action::of_task(task).get(usize::from(code)).copied()
}

/// The generator from which the environment with the number `index` draws its seeds.
fn seeds(seed: u64, index: usize) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&(index as u64).to_le_bytes());
    ChaCha8Rng::from_seed(key)
}

/// Draws seeds until the agents fit on a layout. After [`DRAWS_MAX`] attempts it returns the batch's own settings, on
/// whose layout they fit.
fn draw(config: &Config, seeds: &mut ChaCha8Rng) -> Config {
    let mut draws = std::iter::repeat_with(|| {
        let seed =
            Seed::try_from(seeds.next_u64() >> (u64::BITS - 53)).expect("53 bits are a seed");
        config.with_seed(seed).ok()
    });
    draws.by_ref().take(DRAWS_MAX).flatten().next().unwrap_or_else(|| config.clone())
}
