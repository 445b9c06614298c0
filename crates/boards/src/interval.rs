//! Confidence intervals of differences between rows: Student's t over the seeds that both played.
//!
//! `docs/evaluate/boards.md` has the formula and its measured coverage.

use statrs::distribution::{ContinuousCDF, StudentsT};
use swarmbench_engine::TaskName;

use super::result::{RunResult, float};

/// With fewer pairs in a task nothing is said of chance.
pub const PAIRS_MIN: usize = 3;

/// Which quantile of Student's t an interval reaches to. Scores are skewed, so that with five seeds the usual one of
/// 0.975 covers the true difference in 91 to 94 % of all cases instead of 95 %.
const QUANTILE: f64 = 0.9875;

/// By how much one row is above another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// The difference in the games that were compared, in points of the score.
    pub mean: f64,
    /// The lower and the upper end of the interval of 95 %; none if a task has fewer than [`PAIRS_MIN`] pairs.
    pub interval: Option<(f64, f64)>,
    /// How many seeds both have, over all tasks.
    pub pairs: usize,
}

/// By how much `above` is better than `below`, summed over the means of these tasks. None if they have no seed of
/// some task in common.
///
/// Seeds are paired, as a hard layout is hard for both. Each task has a variance of its own; the degrees of freedom of
/// their sum are those of Welch and Satterthwaite.
#[must_use]
pub fn difference(above: &RunResult, below: &RunResult, tasks: &[TaskName]) -> Option<Difference> {
    let (mut mean, mut variance, mut squares, mut pairs) = (0.0, 0.0, 0.0, 0);
    let mut is_known = true;
    for &task in tasks {
        let of = differences(above, below, task);
        let count = float(of.len());
        let task_mean = of.iter().sum::<f64>() / count;
        let deviations: f64 = of.iter().map(|one| (one - task_mean).powi(2)).sum();
        let task_variance = deviations / (count - 1.0) / count;
        mean += task_mean;
        variance += task_variance;
        squares += task_variance.powi(2) / (count - 1.0);
        pairs += of.len();
        is_known &= of.len() >= PAIRS_MIN;
        if of.is_empty() {
            return None;
        }
    }
    let half = half_width(variance, variance.powi(2) / squares);
    let interval = is_known.then_some((mean - half, mean + half));
    (!tasks.is_empty()).then_some(Difference { mean, interval, pairs })
}

/// Half the width of an interval; 0 without any variance.
fn half_width(variance: f64, freedom: f64) -> f64 {
    let t = StudentsT::new(0.0, 1.0, freedom);
    t.map_or(0.0, |t| t.inverse_cdf(QUANTILE) * variance.sqrt())
}

/// The differences in the seeds that both have; both are in order of their seeds.
fn differences(above: &RunResult, below: &RunResult, task: TaskName) -> Vec<f64> {
    let scores = |run: &'_ RunResult| {
        run.task(task).map_or(Vec::new(), |result| result.scores.clone()).into_iter().peekable()
    };
    let (mut above, mut below) = (scores(above), scores(below));
    let mut found = Vec::new();
    while let (Some(&(first, a)), Some(&(second, b))) = (above.peek(), below.peek()) {
        if first == second {
            found.push(a - b);
        }
        if first <= second {
            above.next();
        }
        if second <= first {
            below.next();
        }
    }
    found
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

    /// Against the quantiles of scipy 1.16, `scipy.stats.t.ppf(0.9875, df)`.
    #[test]
    fn quantiles_are_those_of_other_libraries() {
        for (freedom, expected) in [
            (1.0, 25.451_699_579_357_168),
            (2.0, 6.205_346_816_570_706),
            (4.0, 3.495_405_932_516_441_7),
            (7.3, 2.811_210_399_046_808),
            (20.0, 2.423_116_539_873_409),
            (495.0, 2.248_241_912_005_533),
        ] {
            assert!(
                close(half_width(1.0, freedom), expected),
                "{freedom}: {}",
                half_width(1.0, freedom)
            );
        }
    }

    #[test]
    fn by_hand() {
        // Always by 2 and by 0.5, without any variance.
        let above = scored("a", &[5.0, 9.0, 3.0], &[1.5, 0.5, 0.5]);
        let below = scored("b", &[3.0, 7.0, 1.0], &[1.0, 0.0, 0.0]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        assert_eq!((found.mean, found.interval, found.pairs), (2.5, Some((2.5, 2.5)), 6));

        // Differences 1, 2, 3, 4, 5: their variance is 2.5, that of their mean 0.5.
        let above = scored("a", &[1.0, 2.0, 3.0, 4.0, 5.0], &[]);
        let below = scored("b", &[0.0; 5], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        let (low, high) = found.interval.expect("five pairs");
        let half = 3.495_405_932_516_441_7 * 0.5_f64.sqrt();
        assert!(close(low, 3.0 - half) && close(high, 3.0 + half), "{found:?}");

        // The same and a task with differences 0, 0, 3: variances of the means 0.5 and 1, together 1.5 with
        // 1.5² / (0.5² / 4 + 1² / 2) = 4 degrees of freedom.
        let above = scored("a", &[1.0, 2.0, 3.0, 4.0, 5.0], &[0.0, 0.0, 3.0]);
        let below = scored("b", &[0.0; 5], &[0.0; 3]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        let (low, high) = found.interval.expect("three pairs and more");
        let half = 3.495_405_932_516_441_7 * 1.5_f64.sqrt();
        assert!(close(low, 4.0 - half) && close(high, 4.0 + half), "{found:?}");
    }

    #[test]
    fn seeds_are_paired_and_tasks_have_variances_of_their_own() {
        // Far apart from seed to seed, but always by 1: were they not paired, the interval would be wide.
        let above = scored("a", &[1.0, 41.0, 21.0, 61.0], &[]);
        let below = scored("b", &[0.0, 40.0, 20.0, 60.0], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        assert_eq!(found.interval, Some((1.0, 1.0)));
        // A task in which they always differ by 10 and one in which they never do.
        let above = scored("a", &[10.0, 10.0, 10.0], &[3.0, 1.0, 2.0]);
        let below = scored("b", &[0.0, 0.0, 0.0], &[3.0, 1.0, 2.0]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        assert_eq!(found.interval, Some((10.0, 10.0)));
    }

    #[test]
    fn fewer_than_three_pairs_say_nothing_of_chance() {
        let above = scored("a", &[1.0, 5.0, 3.0], &[4.0, 2.0]);
        let below = scored("b", &[0.0, 0.0, 0.0], &[1.0, 0.0]);
        let of = |tasks| difference(&above, &below, tasks).expect("pairs");
        assert!(of(&BOTH[..1]).interval.is_some());
        assert_eq!((of(&BOTH[1..]).mean, of(&BOTH[1..]).interval), (2.5, None));
        assert_eq!((of(&BOTH).mean, of(&BOTH).interval), (5.5, None), "one task has two");
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
        fn an_interval_has_what_was_observed_in_the_middle(
            scores in proptest::collection::vec((-10.0..60.0_f64, -10.0..60.0_f64), 1..20),
            flocking in proptest::collection::vec((0..4_i32, 0..4_i32), 1..6),
        ) {
            let (a, b): (Vec<f64>, Vec<f64>) = scores.into_iter().unzip();
            let (c, d): (Vec<f64>, Vec<f64>) =
                flocking.into_iter().map(|(c, d)| (f64::from(c), f64::from(d))).unzip();
            let (above, below) = (scored("a", &a, &c), scored("b", &b, &d));
            let found = difference(&above, &below, &BOTH).expect("pairs");
            let known = a.len() >= PAIRS_MIN && c.len() >= PAIRS_MIN;
            prop_assert_eq!(found.interval.is_some(), known);
            let (low, high) = found.interval.unwrap_or((found.mean, found.mean));
            prop_assert!(low <= found.mean && found.mean <= high, "{:?}", found);
            let totals = above.total(&BOTH).expect("a") - below.total(&BOTH).expect("b");
            prop_assert!(close(found.mean, totals));
        }
    }
}
