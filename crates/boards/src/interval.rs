//! Confidence intervals of differences between rows: a bootstrap over the seeds that both played.

use std::collections::BTreeMap;

use quick_cache::sync::Cache;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};
use swarmbench_engine::{Seed, TaskName};

use super::result::{RunResult, float};

/// How often the seeds are drawn again.
pub const RESAMPLES: usize = 2000;

/// How many of the resamples lie below the interval, and how many above it: 2.5 % each.
const OUTSIDE: usize = RESAMPLES / 40;

/// By how much one row is above another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The difference in the games that were compared.
    pub mean: f64,
    /// The lower end of the interval that holds 95 % of the resamples.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// How many seeds both have, over all tasks.
    pub pairs: usize,
    /// Whether every task has several seeds: of one seed alone nothing can be said of chance.
    pub is_known: bool,
}

/// The differences of two rows, task by task and seed by seed.
struct Pairs {
    seed: [u8; 32],
    tasks: Vec<Vec<f64>>,
}

/// By how much `above` is better than `below`, summed over the means of these tasks. `None` if they share no
/// seed of some task.
///
/// Each resample draws as many seeds of each task as there are, with replacement; both rows get the same seeds, as
/// a hard layout is hard for both. The same rows get the same numbers every time: the generator is seeded by
/// their names.
#[must_use]
pub fn difference(above: &RunResult, below: &RunResult, tasks: &[TaskName]) -> Option<Difference> {
    Some(Pairs::new(above, below, tasks)?.difference())
}

impl Pairs {
    fn new(above: &RunResult, below: &RunResult, tasks: &[TaskName]) -> Option<Self> {
        let mut seed = Sha256::new();
        seed.update(above.row.0);
        seed.update(below.row.0);
        let mut all = Vec::with_capacity(tasks.len());
        for &task in tasks {
            seed.update(task.name());
            let differences = differences(above, below, task);
            if differences.is_empty() {
                return None;
            }
            all.push(differences);
        }
        (!all.is_empty()).then(|| Self { seed: seed.finalize().into(), tasks: all })
    }

    fn difference(&self) -> Difference {
        let mut random = ChaCha8Rng::from_seed(self.seed);
        let mean = self.sum_of_means(|task, place| task[place]);
        let mut resampled: Vec<f64> = (0..RESAMPLES)
            .map(|_| self.sum_of_means(|task, _| task[below(&mut random, task.len())]))
            .collect();
        resampled.sort_unstable_by(f64::total_cmp);
        Difference {
            mean,
            low: resampled[OUTSIDE],
            high: resampled[RESAMPLES - 1 - OUTSIDE],
            pairs: self.tasks.iter().map(Vec::len).sum(),
            is_known: self.tasks.iter().all(|task| task.len() > 1),
        }
    }

    /// Adds up the means of the tasks, of differences that are drawn place by place.
    fn sum_of_means(&self, mut draw: impl FnMut(&[f64], usize) -> f64) -> f64 {
        let mean = |task: &Vec<f64>| {
            let sum: f64 = (0..task.len()).map(|place| draw(task, place)).sum();
            sum / float(task.len())
        };
        self.tasks.iter().map(mean).sum()
    }

    /// Identifies these pairs.
    fn name(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(self.seed);
        for task in &self.tasks {
            hash.update((task.len() as u64).to_be_bytes());
            for difference in task {
                hash.update(difference.to_bits().to_be_bytes());
            }
        }
        hash.finalize().into()
    }
}

/// The differences on the seeds that both have, in order of the seeds.
fn differences(above: &RunResult, below: &RunResult, task: TaskName) -> Vec<f64> {
    let of_below: BTreeMap<Seed, f64> = scores(below, task).iter().copied().collect();
    let both = scores(above, task).iter();
    both.filter_map(|(seed, above)| Some(above - of_below.get(seed)?)).collect()
}

fn scores(run: &RunResult, task: TaskName) -> &[(Seed, f64)] {
    run.task(task).map_or(&[], |result| &result.scores)
}

/// A number in `0..count`. Written out, so that it stays as it is when a library changes; `count` is far too
/// small for its bias to matter.
fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    let scaled = (u64::from(random.next_u32()) * count as u64) >> 32;
    usize::try_from(scaled).unwrap_or(0)
}

/// Differences that were found lately. What is remembered never grows old: its name is all that it follows from.
#[derive(Debug)]
pub struct Memory(Cache<[u8; 32], Difference>);

impl Memory {
    /// Remembers as many.
    #[must_use]
    pub fn new(differences: usize) -> Self {
        Self(Cache::new(differences))
    }

    /// See [`difference`].
    #[must_use]
    pub fn difference(
        &self,
        above: &RunResult,
        below: &RunResult,
        tasks: &[TaskName],
    ) -> Option<Difference> {
        let pairs = Pairs::new(above, below, tasks)?;
        let name = pairs.name();
        if let Some(known) = self.0.get(&name) {
            return Some(known);
        }
        let found = pairs.difference();
        self.0.insert(name, found);
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Run;
    use super::super::rank::tests::{game, player, run};
    use super::*;

    const BOTH: [TaskName; 2] = [TaskName::Pursuit, TaskName::Flocking];

    /// A run with these scores of both tasks.
    fn scored(model: &str, pursuit: &[f64], flocking: &[f64]) -> RunResult {
        let seeds: Vec<u32> = (1..).take(pursuit.len().max(flocking.len())).collect();
        let of = |task, scores: &[f64]| {
            let played = seeds.iter().zip(scores).map(|(&seed, &score)| game(task, seed, score));
            played.collect::<Vec<_>>()
        };
        let games = [of(BOTH[0], pursuit), of(BOTH[1], flocking)].concat();
        let plan: Vec<_> = games.iter().map(|game| game.slot).collect();
        let run = Run { player: player(model), ..run(model, "finished", 0) };
        RunResult::new(run, &plan, &games, true)
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn by_hand() {
        // Always by 2 and by 0.5: whichever seeds are drawn, the sum of the means is 2.5.
        let above = scored("a", &[5.0, 9.0, 3.0], &[1.5, 0.5]);
        let below = scored("b", &[3.0, 7.0, 1.0], &[1.0, 0.0]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        assert_eq!((found.mean, found.low, found.high, found.pairs), (2.5, 2.5, 2.5, 5));

        // One pair of seeds, 0 and 10: the mean of two draws is 0, 5, 5 or 10, each with a quarter of the chances.
        let above = scored("a", &[0.0, 10.0], &[]);
        let below = scored("b", &[0.0, 0.0], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        assert_eq!((found.mean, found.low, found.high), (5.0, 0.0, 10.0));

        // Ten seeds, one of which makes the difference: drawn 0 times with a chance of 0.9¹⁰ = 35 %, and more
        // than 3 times with one of 1.3 %. So the interval is from 0 to three tenths of it.
        let mut scores = [0.0; 10];
        scores[4] = 10.0;
        let found =
            difference(&scored("a", &scores, &[]), &scored("b", &[0.0; 10], &[]), &BOTH[..1]);
        let found = found.expect("pairs");
        assert!(close(found.low, 0.0) && close(found.high, 3.0), "{found:?}");
    }

    #[test]
    fn seeds_are_paired_within_their_task() {
        // Far apart from seed to seed, but always by 1: were they not paired, the interval would be wide.
        let above = scored("a", &[1.0, 41.0, 21.0, 61.0], &[]);
        let below = scored("b", &[0.0, 40.0, 20.0, 60.0], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        assert_eq!((found.low, found.high), (1.0, 1.0));
        // A task in which they always differ by 10 and one in which they never do: were seeds drawn from both
        // together, the sum would vary.
        let above = scored("a", &[10.0, 10.0, 10.0], &[3.0, 1.0, 2.0]);
        let below = scored("b", &[0.0, 0.0, 0.0], &[3.0, 1.0, 2.0]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        assert_eq!((found.low, found.high), (10.0, 10.0));
    }

    #[test]
    fn only_seeds_that_both_have_are_compared() {
        let above = scored("a", &[1.0, 2.0, 3.0], &[]);
        let below = scored("b", &[0.0, 0.0], &[1.0]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        assert_eq!((found.mean, found.pairs), (1.5, 2));
        assert_eq!(difference(&above, &below, &BOTH), None, "no seed of Flocking");
        assert_eq!(difference(&above, &below, &[]), None);
    }

    proptest! {
        #[test]
        fn an_interval_holds_what_was_observed_and_is_always_the_same(
            scores in proptest::collection::vec((-10.0..60.0_f64, -10.0..60.0_f64), 1..20),
            flocking in proptest::collection::vec((0..4_i32, 0..4_i32), 1..6),
        ) {
            let (a, b): (Vec<f64>, Vec<f64>) = scores.into_iter().unzip();
            let (c, d): (Vec<f64>, Vec<f64>) =
                flocking.into_iter().map(|(c, d)| (f64::from(c), f64::from(d))).unzip();
            let (above, below) = (scored("a", &a, &c), scored("b", &b, &d));
            let found = difference(&above, &below, &BOTH).expect("pairs");
            prop_assert!(found.low <= found.mean + 1e-9 && found.mean <= found.high + 1e-9, "{:?}", found);
            let totals = above.total(&BOTH).expect("a") - below.total(&BOTH).expect("b");
            prop_assert!(close(found.mean, totals));
            let memory = Memory::new(10);
            for _ in 0..2 {
                prop_assert_eq!(memory.difference(&above, &below, &BOTH), Some(found));
            }
        }
    }
}
