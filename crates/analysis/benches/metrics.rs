//! The time that it takes to measure a game, without its replay.
//!
//! ```sh
//! cargo bench -p swarmbench-analysis --bench metrics
//! ```
//!
//! `standard` is a game of 12 agents and 100 rounds in which every agent says about 80 characters in each round, half
//! of the texts new; `large` is one of 1,024 agents, 1,000 rounds and 256 × 256 cells.

use std::sync::Arc;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use swarmbench_analysis::game::{Decision, Heard, Setup, State};
use swarmbench_analysis::{Meter, Metrics, Options};
use swarmbench_engine::{Act, Action, Config, Message, Settings, TaskName, World};

const PLAIN: Options = Options { series: false, vectors: false, edits: false };

/// The arguments of [`Meter::round`].
struct Round {
    acts: Vec<Act>,
    decisions: Vec<Decision>,
    after: State,
    heard: Vec<Heard>,
}

struct Game {
    layout: World,
    rounds: Vec<Round>,
}

impl Game {
    fn play(settings: &Settings) -> Self {
        let config = Config::check(settings).expect("settings of a benchmark are allowed");
        let layout = World::new(Arc::new(config));
        let mut world = layout.clone();
        let mut rounds = Vec::new();
        while !world.is_over() {
            let acts: Vec<Act> =
                world.agents().map(|agent| act(world.round(), usize::from(agent.0))).collect();
            world.step(&acts);
            let decision = |act: &Act| Decision {
                action: act.action,
                message: act.message.as_ref().map(Message::to_string),
                ..Decision::default()
            };
            let decisions = acts.iter().map(decision).collect();
            rounds.push(Round {
                decisions,
                after: State::of(&world),
                heard: Heard::all(&world),
                acts,
            });
        }
        Self { layout, rounds }
    }

    fn standard() -> Self {
        Self::play(&Settings::standard(TaskName::Synchronization, 27))
    }

    fn large() -> Self {
        Self::play(&Settings {
            num_agents: 1024,
            width: 256,
            height: 256,
            max_round: 1000,
            memory: 0,
            ..Settings::standard(TaskName::Pursuit, 27)
        })
    }

    fn replay(&self) -> World {
        let mut world = self.layout.clone();
        self.rounds.iter().for_each(|round| world.step(&round.acts));
        world
    }

    fn states(&self) -> Vec<State> {
        self.rounds.iter().map(|round| round.after.clone()).collect()
    }

    fn measure(&self, states: Vec<State>, options: Options) -> Metrics {
        let (setup, layout) = (Setup::of(&self.layout), State::of(&self.layout));
        let mut meter = Meter::new(setup, layout, options);
        for (round, after) in self.rounds.iter().zip(states) {
            meter.round(&round.decisions, after, Some(&round.heard));
        }
        meter.metrics()
    }
}

/// An arbitrary act with about 80 characters of text.
fn act(round: u32, agent: usize) -> Act {
    let place = round as usize * 7 + agent * 13;
    let number = place % 1000 * usize::from(place.is_multiple_of(2));
    let text = format!(
        "Agent {agent}: I see the target at ({number}, {agent}); form a ring, hold until round 90."
    );
    Act { action: Some(Action::ALL[place % 5]), message: Message::new(&text), to: None }
}

fn metrics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("standard");
    let game = Game::standard();
    group.bench_function("replay", |b| b.iter(|| game.replay()));
    for (name, options) in [
        ("plain", PLAIN),
        ("series", Options { series: true, ..PLAIN }),
        ("vectors", Options { vectors: true, ..PLAIN }),
        ("edits", Options { edits: true, ..PLAIN }),
    ] {
        let measure = |states| game.measure(states, options);
        group.bench_function(name, |b| {
            b.iter_batched(|| game.states(), measure, BatchSize::LargeInput);
        });
    }
    group.finish();
    let mut group = criterion.benchmark_group("large");
    group.sample_size(10);
    let game = Game::large();
    group.bench_function("replay", |b| b.iter(|| game.replay()));
    let measure = |states| game.measure(states, PLAIN);
    group.bench_function("plain", |b| {
        b.iter_batched(|| game.states(), measure, BatchSize::LargeInput);
    });
    group.finish();
}

criterion_group!(benches, metrics);
criterion_main!(benches);
