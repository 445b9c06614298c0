//! Rounds a second in the standard setting, by task: every agent acts at random, and one in eight
//! says something. `play` is a round and its digest, `play_and_observe` also all observations.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::{Dice, world};
use criterion::{BatchSize, Criterion, Throughput};
use swarmbench_engine::{Act, Settings, TaskName, World};

/// As many rounds as the standard setting has.
const ROUNDS: u64 = 100;

type Game = fn(&mut World, &[Vec<Act>]);

fn play(world: &mut World, rounds: &[Vec<Act>]) {
    for acts in rounds {
        world.step(acts);
        black_box(world.digest());
    }
}

fn play_and_observe(world: &mut World, rounds: &[Vec<Act>]) {
    for acts in rounds {
        for agent in world.agents() {
            black_box(world.observe(agent));
        }
        world.step(acts);
        black_box(world.digest());
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let games: [(&str, Game); 2] = [("play", play), ("play_and_observe", play_and_observe)];
    for (name, game) in games {
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(ROUNDS));
        for task in TaskName::ALL {
            let start = world(&Settings::standard(task, 27));
            let mut dice = Dice(27);
            let rounds: Vec<_> = (0..ROUNDS).map(|_| dice.acts(&start)).collect();
            group.bench_function(task.name(), |bencher| {
                let start = || start.clone();
                let rounds = |world: &mut World| game(world, &rounds);
                bencher.iter_batched_ref(start, rounds, BatchSize::SmallInput);
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
