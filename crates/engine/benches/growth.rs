//! How a round with its digest and all observations grows with the number of agents, at the same
//! number of cells for each agent; and how it grows with the map alone.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::{Dice, world};
use criterion::{BatchSize, BenchmarkId, Criterion, Throughput};
use swarmbench_engine::{Settings, TaskName, World};

const ROUNDS: usize = 16;

/// Agents, and rows and columns of the map: 12.5 cells for each agent, in the end 64.
const SIZES: [(i64, i64); 6] = [(8, 10), (32, 20), (128, 40), (512, 80), (1024, 113), (1024, 256)];

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    for task in TaskName::ALL {
        let mut group = criterion.benchmark_group(format!("growth/{}", task.name()));
        group.sample_size(20);
        for (num_agents, size) in SIZES {
            if task == TaskName::Flocking && num_agents > 256 {
                continue;
            }
            let start = world(&Settings {
                num_agents,
                width: size,
                height: size,
                ..Settings::standard(task, 27)
            });
            let mut dice = Dice(27);
            let rounds: Vec<_> = (0..ROUNDS).map(|_| dice.acts(&start)).collect();
            let play = |world: &mut World| {
                for acts in &rounds {
                    for agent in world.agents() {
                        black_box(world.observe(agent));
                    }
                    world.step(acts);
                    black_box(world.digest());
                }
            };
            let id = BenchmarkId::new(num_agents.to_string(), format!("{size}x{size}"));
            group.throughput(Throughput::Elements(ROUNDS as u64));
            group.bench_function(id, |bencher| {
                bencher.iter_batched_ref(|| start.clone(), play, BatchSize::SmallInput);
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
