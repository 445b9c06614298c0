//! Growth of the time of a round with its digest and all observations with the number of agents, at the same number of
//! cells for each agent; and with the map alone. In `growth_windows` current windows are written into buffers instead.

use std::hint::black_box;

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput};
use swarmbench_engine::{Canvas, Scratch, Settings, TaskName, World};
use swarmbench_testkit::worlds::{Dice, world};

const ROUNDS: usize = 16;

/// Agents, and rows and columns of the map: 12.5 cells for each agent, in the end 64.
const SIZES: [(i64, i64); 6] = [(8, 10), (32, 20), (128, 40), (512, 80), (1024, 113), (1024, 256)];

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let ways = [("growth", false), ("growth_windows", true)];
    for ((name, windows), task) in
        ways.iter().flat_map(|&way| TaskName::ALL.map(|task| (way, task)))
    {
        let mut group = criterion.benchmark_group(format!("{name}/{}", task.name()));
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
            let cells = start.config().window();
            let all = cells * usize::from(start.config().num_agents());
            let (mut codes, mut numbers) = (vec![0; all], vec![0; all]);
            let (mut canvas, mut scratch) = (Canvas::default(), Scratch::default());
            let mut play = |world: &mut World| {
                for acts in &rounds {
                    if windows {
                        canvas.draw(world);
                        let out =
                            codes.chunks_exact_mut(cells).zip(numbers.chunks_exact_mut(cells));
                        for (agent, (codes, numbers)) in world.agents().zip(out) {
                            black_box(canvas.write_window(agent, codes, numbers));
                        }
                    } else {
                        for agent in world.agents() {
                            black_box(world.observe(agent));
                        }
                    }
                    world.step_in(acts, &mut scratch);
                    black_box(world.digest());
                }
            };
            let id = BenchmarkId::new(num_agents.to_string(), format!("{size}x{size}"));
            group.throughput(Throughput::Elements(ROUNDS as u64));
            group.bench_function(id, |bencher| {
                bencher.iter_batched_ref(|| start.clone(), &mut play, BatchSize::SmallInput);
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
