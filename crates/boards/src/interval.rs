//! Confidence intervals of differences between rows: Student's t over common seeds.
//!
//! The formula and its measured coverage are in `docs/evaluate/boards.md`.

use statrs::distribution::{ContinuousCDF, StudentsT};
use swarmbench_engine::{Seed, TaskName};

use super::result::{RunResult, float, mean as mean_of};

/// Minimum pairs or scores of each task for an interval.
pub const SCORES_MIN: usize = 3;

/// Quantile of Student's t for the ends of an interval. Scores are skewed: with five seeds the usual 0.975 covers the true
/// difference in only 91 to 94 % of all cases instead of 95 %.
const QUANTILE: f64 = 0.9875;

/// Lead of one row over another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Difference in the compared games, in points of the score.
    pub mean: f64,
    /// Ends of the 95 % interval; none if a task has fewer than [`SCORES_MIN`] pairs.
    pub interval: Option<(f64, f64)>,
    /// Number of common seeds over all tasks.
    pub pairs: usize,
}

/// Lead of `above` over `below`, summed over the means of these tasks. None if one of them has no score in some task.
///
/// Seeds are paired, as a hard layout is hard for both. In a task without a common seed, as in different attempts of a competition,
/// the scores are two independent samples. Each sample has its own variance; the degrees of freedom of their sum are those of Welch
/// and Satterthwaite.
#[must_use]
pub fn difference(above: &RunResult, below: &RunResult, tasks: &[TaskName]) -> Option<Difference> {
    let (mut mean, mut variance, mut squares, mut pairs) = (0.0, 0.0, 0.0, 0);
    let mut is_known = true;
    for &task in tasks {
        let (first, second) = (above.task(task)?, below.task(task)?);
        let paired = differences(&first.scores, &second.scores);
        pairs += paired.len();
        mean += match mean_of(&paired) {
            Some(mean) => mean,
            None => first.mean()? - second.mean()?,
        };
        let samples = if paired.is_empty() {
            vec![first.of_seeds(), second.of_seeds()]
        } else {
            vec![paired]
        };
        for sample in &samples {
            let freedom = float(sample.len()) - 1.0;
            let of_mean = deviations(sample) / freedom / float(sample.len());
            variance += of_mean;
            squares += of_mean.powi(2) / freedom;
            is_known &= sample.len() >= SCORES_MIN;
        }
    }
    let half = half_width(variance, variance.powi(2) / squares);
    let interval = is_known.then_some((mean - half, mean + half));
    (!tasks.is_empty()).then_some(Difference { mean, interval, pairs })
}

/// Sum of the squared deviations from the mean.
fn deviations(sample: &[f64]) -> f64 {
    let mean = mean_of(sample).unwrap_or(0.0);
    sample.iter().map(|one| (one - mean).powi(2)).sum()
}

/// Half the width of an interval; 0 if the variance is 0.
fn half_width(variance: f64, freedom: f64) -> f64 {
    let t = StudentsT::new(0.0, 1.0, freedom);
    t.map_or(0.0, |t| t.inverse_cdf(QUANTILE) * variance.sqrt())
}

/// Differences in common seeds. Both inputs are sorted by seed.
fn differences(above: &[(Seed, f64)], below: &[(Seed, f64)]) -> Vec<f64> {
    let of = |seed| {
        let place = below.binary_search_by_key(&seed, |&(seed, _)| seed).ok()?;
        Some(below[place].1)
    };
    above.iter().filter_map(|&(seed, score)| Some(score - of(seed)?)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::PlayedRun;
    use super::super::rank::tests::{game, player, run};
    use super::*;

    const BOTH: [TaskName; 2] = [TaskName::Pursuit, TaskName::Flocking];

    /// A run with these scores in both tasks.
    fn scored(model: &str, pursuit: &[f64], flocking: &[f64]) -> RunResult {
        let seeds: Vec<u32> = (1..).take(pursuit.len().max(flocking.len())).collect();
        let of = |task, scores: &[f64]| {
            let played = seeds.iter().zip(scores).map(|(&seed, &score)| game(task, seed, score));
            played.collect::<Vec<_>>()
        };
        let games = [of(BOTH[0], pursuit), of(BOTH[1], flocking)].concat();
        let plan: Vec<_> = games.iter().map(|game| game.slot).collect();
        let run = PlayedRun { player: player(model), ..run(model, "finished", 0) };
        RunResult::new(run, &plan, &games, true)
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    /// Reference quantiles are from scipy 1.16, `scipy.stats.t.ppf(0.9875, df)`.
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
        // Constant differences of 2 and of 0.5, without variance.
        let above = scored("a", &[5.0, 9.0, 3.0], &[1.5, 0.5, 0.5]);
        let below = scored("b", &[3.0, 7.0, 1.0], &[1.0, 0.0, 0.0]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        assert_eq!((found.mean, found.interval, found.pairs), (2.5, Some((2.5, 2.5)), 6));

        // Differences 1, 2, 3, 4, 5: variance 2.5, variance of the mean 0.5.
        let above = scored("a", &[1.0, 2.0, 3.0, 4.0, 5.0], &[]);
        let below = scored("b", &[0.0; 5], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        let (low, high) = found.interval.expect("five pairs");
        let half = 3.495_405_932_516_441_7 * 0.5_f64.sqrt();
        assert!(close(low, 3.0 - half) && close(high, 3.0 + half), "{found:?}");

        // A second task with differences 0, 0, 3: variances of the means 0.5 and 1, together 1.5 with 1.5² / (0.5² / 4 + 1² / 2) =
        // 4 degrees of freedom.
        let above = scored("a", &[1.0, 2.0, 3.0, 4.0, 5.0], &[0.0, 0.0, 3.0]);
        let below = scored("b", &[0.0; 5], &[0.0; 3]);
        let found = difference(&above, &below, &BOTH).expect("pairs");
        let (low, high) = found.interval.expect("three pairs and more");
        let half = 3.495_405_932_516_441_7 * 1.5_f64.sqrt();
        assert!(close(low, 4.0 - half) && close(high, 4.0 + half), "{found:?}");
    }

    #[test]
    fn seeds_are_paired_and_tasks_have_variances_of_their_own() {
        // Scores vary widely between seeds, but the difference is always 1: unpaired, the interval would be wide.
        let above = scored("a", &[1.0, 41.0, 21.0, 61.0], &[]);
        let below = scored("b", &[0.0, 40.0, 20.0, 60.0], &[]);
        let found = difference(&above, &below, &BOTH[..1]).expect("pairs");
        assert_eq!(found.interval, Some((1.0, 1.0)));
        // One task with a constant difference of 10, and one without a difference.
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
    fn different_seeds_are_independent_samples() {
        let above = scored("a", &[1.0, 2.0, 3.0, 4.0, 5.0], &[]);
        let plan: Vec<_> = (11..16).map(|seed: u32| game(BOTH[0], seed, 0.0)).collect();
        let games = [(11, 0.0), (12, 1.0), (13, 2.0), (14, 3.0), (15, 4.0)];
        let games = games.map(|(seed, score): (u32, f64)| game(BOTH[0], seed, score));
        let slots: Vec<_> = plan.iter().map(|game| game.slot).collect();
        let below = RunResult::new(run("b", "finished", 0), &slots, &games, true);
        let found = difference(&above, &below, &BOTH[..1]).expect("scores");
        // Each mean has variance 0.5: together 1, with 1² / (0.5² / 4 + 0.5² / 4) = 8 degrees of freedom.
        let (low, high) = found.interval.expect("five scores each");
        let half = half_width(1.0, 8.0);
        assert_eq!((found.mean, found.pairs), (1.0, 0));
        assert!(close(low, 1.0 - half) && close(high, 1.0 + half), "{found:?}");
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
            let known = a.len() >= SCORES_MIN && c.len() >= SCORES_MIN;
            prop_assert_eq!(found.interval.is_some(), known);
            let (low, high) = found.interval.unwrap_or((found.mean, found.mean));
            prop_assert!(low <= found.mean && found.mean <= high, "{:?}", found);
            let totals = above.total(&BOTH).expect("a") - below.total(&BOTH).expect("b");
            prop_assert!(close(found.mean, totals));
        }
    }
}
