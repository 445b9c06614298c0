//! Environment steps a second on one thread, by task, in the standard setting without memory: with windows as planes,
//! as symbols, and without any. The last measures the engine and the copying of acts and numbers around it.

use criterion::{Criterion, Throughput};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench_engine::{Settings, TaskName};
use swarmbench_training::{Arrays, Batch, Observations, Options, Turn};

const ENVIRONMENTS: usize = 256;

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let forms = [
        ("planes", Observations::Planes),
        ("symbols", Observations::Symbols),
        ("none", Observations::None),
    ];
    for (name, observations) in forms {
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(ENVIRONMENTS as u64));
        for task in TaskName::ALL {
            let settings = Settings { memory: 0, ..Settings::standard(task, 0) };
            let options =
                Options { environments: ENVIRONMENTS, observations, ..Options::default() };
            let mut batch = Batch::new(&settings, options).expect("the standard setting");
            let shape = batch.shape();
            let mut arrays = Arrays::new(&shape);
            let mut random = ChaCha8Rng::seed_from_u64(27);
            let mut draw = || {
                let count = u32::try_from(shape.actions).expect("few");
                u8::try_from(random.next_u32() % count).expect("few")
            };
            let turns: Vec<Vec<u8>> = (0..16)
                .map(|_| (0..ENVIRONMENTS * shape.agents).map(|_| draw()).collect())
                .collect();
            let mut next = turns.iter().cycle();
            group.bench_function(task.name(), |bencher| {
                bencher.iter(|| {
                    let actions = next.next().expect("a cycle");
                    let (frame, gains) = arrays.parts();
                    let turn = Turn { actions, messages: Vec::new() };
                    batch.step(turn, frame, gains, None).expect("right sizes");
                });
            });
        }
        group.finish();
    }
    criterion.final_summary();
}
