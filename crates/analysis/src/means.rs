//! Means and deviations of scores.

/// The mean and the population standard deviation (the sum of squares divided by n); `None` without numbers.
#[must_use]
pub fn mean_and_deviation(numbers: &[f64]) -> Option<(f64, f64)> {
    let mean = mean(numbers)?;
    let squares: f64 = numbers.iter().map(|number| (number - mean).powi(2)).sum();
    Some((mean, (squares / float(numbers.len())).sqrt()))
}

/// The mean; `None` without numbers.
#[must_use]
pub fn mean(numbers: &[f64]) -> Option<f64> {
    (!numbers.is_empty()).then(|| numbers.iter().sum::<f64>() / float(numbers.len()))
}

/// A count of games as a float.
#[expect(clippy::cast_precision_loss, reason = "nobody plays 2⁵³ games")]
#[must_use]
pub const fn float(count: usize) -> f64 {
    count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table S.1 of the paper: for each model the means and deviations of Pursuit, Synchronization, Foraging,
    /// Flocking and Transport, and the total.
    const DETAILED: [([(f64, f64); 5], f64); 13] = [
        ([(8.80, 1.60), (3.40, 2.94), (5.80, 4.35), (9.40, 0.80), (0.00, 0.00)], 27.40),
        ([(9.60, 0.49), (2.80, 1.17), (4.80, 2.64), (8.90, 1.83), (0.52, 1.04)], 26.62),
        ([(4.40, 1.20), (12.60, 9.62), (1.20, 1.47), (7.50, 1.93), (0.00, 0.00)], 25.70),
        ([(8.40, 1.85), (2.80, 0.75), (3.20, 1.94), (5.70, 0.68), (0.00, 0.00)], 20.10),
        ([(4.20, 2.48), (4.00, 1.41), (2.60, 2.06), (6.40, 1.40), (0.00, 0.00)], 17.20),
        ([(3.40, 1.50), (1.80, 1.33), (1.60, 1.85), (5.00, 3.18), (0.00, 0.00)], 11.80),
        ([(3.60, 2.06), (2.20, 1.17), (2.60, 3.88), (2.70, 0.93), (0.00, 0.00)], 11.10),
        ([(2.20, 1.94), (1.20, 0.98), (0.80, 0.75), (5.90, 0.20), (0.00, 0.00)], 10.10),
        ([(1.00, 0.63), (1.20, 1.17), (1.00, 1.10), (6.10, 0.38), (0.71, 1.42)], 10.01),
        ([(1.80, 0.40), (1.00, 1.10), (0.00, 0.00), (7.10, 0.74), (0.00, 0.00)], 9.90),
        ([(1.20, 0.75), (0.20, 0.40), (1.00, 1.55), (7.10, 2.44), (0.00, 0.00)], 9.50),
        ([(1.40, 0.80), (0.60, 0.49), (1.40, 1.02), (5.00, 2.76), (0.00, 0.00)], 8.40),
        ([(0.60, 0.49), (1.00, 0.00), (0.00, 0.00), (5.60, 0.74), (0.00, 0.00)], 7.20),
    ];

    /// Half a unit of the last printed digit.
    const HALF_DIGIT: f64 = 0.005 + 1e-9;

    #[test]
    fn totals_of_the_paper_are_sums_of_means() {
        for (tasks, total) in DETAILED {
            let sum: f64 = tasks.iter().map(|(mean, _)| mean).sum();
            assert!((sum - total).abs() < 1e-9, "{sum} is not {total}");
        }
    }

    /// All ascending lists of `left` whole numbers with this sum and no number below the last of `chosen`.
    fn lists(chosen: &mut Vec<f64>, left: u32, sum: f64, found: &mut dyn FnMut(&[f64])) {
        if left == 0 {
            if sum == 0.0 {
                found(chosen);
            }
            return;
        }
        let mut next = chosen.last().copied().unwrap_or(0.0);
        while next * f64::from(left) <= sum {
            chosen.push(next);
            lists(chosen, left - 1, sum - next, found);
            chosen.pop();
            next += 1.0;
        }
    }

    /// Scores of Pursuit, Synchronization and Foraging are whole. Five whole scores can have the population deviation
    /// in each of these 39 cells; the deviation that divides by n − 1 is impossible in most.
    #[test]
    fn deviations_of_the_paper_divide_by_n() {
        let (mut of_population, mut of_sample) = (0, 0);
        for (tasks, _) in DETAILED {
            for (mean, deviation) in &tasks[..3] {
                let (mut is_population, mut is_sample) = (false, false);
                lists(&mut Vec::new(), 5, (mean * 5.0).round(), &mut |scores| {
                    let (_, of_scores) = mean_and_deviation(scores).expect("five scores");
                    is_population |= (of_scores - deviation).abs() < HALF_DIGIT;
                    is_sample |= (of_scores * 1.25_f64.sqrt() - deviation).abs() < HALF_DIGIT;
                });
                of_population += u32::from(is_population);
                of_sample += u32::from(is_sample);
            }
        }
        assert_eq!(of_population, 39);
        assert!(of_sample < 13, "{of_sample}");
    }
}
