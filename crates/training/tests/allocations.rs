//! A batch allocates memory only to lay out an episode, once its first episodes are played.

use allocation_counter::measure;
use swarmbench_engine::{Settings, TaskName};
use swarmbench_training::{Arrays, Autoreset, Batch, Options, Rewards, Turn};

const ENVIRONMENTS: usize = 8;

#[test]
fn steps_allocate_nothing() {
    for (task, memory) in TaskName::ALL.into_iter().flat_map(|task| [(task, 0), (task, 5)]) {
        let settings = Settings { memory, max_round: 1000, ..Settings::standard(task, 0) };
        let options = Options {
            environments: ENVIRONMENTS,
            seed: 1,
            rewards: Rewards::Individual,
            autoreset: Autoreset::Disabled,
            ..Options::default()
        };
        let mut batch = Batch::new(&settings, options).expect("a batch");
        let shape = batch.shape();
        let mut arrays = Arrays::new(&shape);
        // Agents walk to and fro. They never escape (Transport), and never form a square (Flocking).
        let walks: Vec<Vec<u8>> = (0..4_u8)
            .map(|step| {
                (0..ENVIRONMENTS * shape.agents)
                    .map(|seat| [0, 1, 2, 3][(seat + usize::from(step)) % 4])
                    .collect()
            })
            .collect();
        let mut play = |rounds: usize| {
            for round in 0..rounds {
                let (frame, gains) = arrays.parts();
                let turn = Turn { actions: &walks[round % 4], messages: Vec::new() };
                batch.step(turn, frame, gains, None).expect("a step");
            }
        };
        play(700);
        let counted = measure(|| play(200));
        assert_eq!(counted.count_total, 0, "{task:?}, memory {memory}: {counted:?}");
    }
}
