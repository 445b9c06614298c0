//! Rounds a second in the standard setting, by task: every agent acts at random, and one in eight sends a message.
//! `play` is a round and its digest, `play_and_observe` also all observations with the agents' memory, `play_and_write`
//! also all current windows, written into reused buffers.

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput};
use swarmbench_engine::{Act, Canvas, Scratch, Settings, TaskName, World};
use swarmbench_testkit::worlds::{Dice, world};

/// Number of rounds of the standard setting.
const ROUNDS: u64 = 100;

type PlayFn = fn(&mut World, &[Vec<Act>], &mut Desk);

fn play(world: &mut World, rounds: &[Vec<Act>], _: &mut Desk) {
    for acts in rounds {
        world.step(acts);
        black_box(world.digest());
    }
}

fn play_and_observe(world: &mut World, rounds: &[Vec<Act>], _: &mut Desk) {
    for acts in rounds {
        for agent in world.agents() {
            black_box(world.observe(agent));
        }
        world.step(acts);
        black_box(world.digest());
    }
}

fn play_and_write(world: &mut World, rounds: &[Vec<Act>], desk: &mut Desk) {
    for acts in rounds {
        desk.write(world);
        world.step_in(acts, &mut desk.scratch);
        black_box(world.digest());
    }
}

/// Reused memory: the windows of all agents, and the scratch memory of rounds.
#[derive(Default)]
struct Desk {
    canvas: Canvas,
    codes: Vec<u8>,
    numbers: Vec<i16>,
    scratch: Scratch,
}

impl Desk {
    fn write(&mut self, world: &World) {
        let cells = world.config().window();
        let all = cells * usize::from(world.config().num_agents());
        self.codes.resize(all, 0);
        self.numbers.resize(all, 0);
        self.canvas.draw(world);
        let windows = self.codes.chunks_exact_mut(cells).zip(self.numbers.chunks_exact_mut(cells));
        for (agent, (codes, numbers)) in world.agents().zip(windows) {
            black_box(self.canvas.write_window(agent, codes, numbers));
        }
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let games: [(&str, PlayFn); 3] = [
        ("play", play),
        ("play_and_observe", play_and_observe),
        ("play_and_write", play_and_write),
    ];
    let mut desk = Desk::default();
    for (name, game) in games {
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(ROUNDS));
        for task in TaskName::ALL {
            let start = world(&Settings::standard(task, 27));
            let mut dice = Dice(27);
            let rounds: Vec<_> = (0..ROUNDS).map(|_| dice.acts(&start)).collect();
            group.bench_function(task.name(), |bencher| {
                let start = || start.clone();
                let rounds = |world: &mut World| game(world, &rounds, &mut desk);
                bencher.iter_batched_ref(start, rounds, BatchSize::SmallInput);
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
