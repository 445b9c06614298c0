//! The uncertainty of a correlation if games of one model are not independent: a bootstrap that draws models, not
//! games.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{float, mean_and_deviation};

/// The minimum number of models for an interval; with fewer than ten it is rough.
pub const MODELS_MIN: usize = 3;

/// The number of draws.
pub const DRAWS: usize = 2000;

/// The seed of the draws, fixed so that the same games have the same interval.
pub const SEED: u64 = 1;

/// The share of all pairs' variance below which a draw's variance is a rounding error: the draw is constant.
const CONSTANT: f64 = 1e-12;

/// The sums over pairs that determine Pearson's coefficient.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.x += other.x;
        self.y += other.y;
        self.xx += other.xx;
        self.xy += other.xy;
        self.yy += other.yy;
    }

    /// `None` if a number is constant.
    fn pearson(&self) -> Option<f64> {
        let of = |product: f64, a: f64, b: f64| product / self.n - a * b / self.n.powi(2);
        let (xx, yy) = (of(self.xx, self.x, self.x), of(self.yy, self.y, self.y));
        (xx > CONSTANT && yy > CONSTANT)
            .then(|| (of(self.xy, self.x, self.y) / (xx * yy).sqrt()).clamp(-1.0, 1.0))
    }
}

/// The 95 % interval of Pearson's coefficient, from the pairs of each model: the quantiles 0.025 and 0.975 of the
/// coefficients of [`DRAWS`] draws of as many models as there are, with replacement. A draw in which a number is
/// constant has no coefficient; `None` if half of the draws or more have none, or with fewer than [`MODELS_MIN`]
/// models.
#[must_use]
pub fn by_models(models: &[Vec<(f64, f64)>]) -> Option<(f64, f64)> {
    let models: Vec<&Vec<(f64, f64)>> = models.iter().filter(|pairs| !pairs.is_empty()).collect();
    if models.len() < MODELS_MIN {
        return None;
    }
    // Sums of standardised numbers are small, so their differences lose little precision.
    let (x, y): (Vec<f64>, Vec<f64>) = models.iter().copied().flatten().copied().unzip();
    let ((at_x, by_x), (at_y, by_y)) = (mean_and_deviation(&x)?, mean_and_deviation(&y)?);
    if by_x == 0.0 || by_y == 0.0 {
        return None;
    }
    let sums: Vec<Sums> = (models.iter())
        .map(|pairs| {
            let mut sums = Sums::default();
            for (x, y) in *pairs {
                let (x, y) = ((x - at_x) / by_x, (y - at_y) / by_y);
                sums.add(&Sums { n: 1.0, x, y, xx: x * x, xy: x * y, yy: y * y });
            }
            sums
        })
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut found: Vec<f64> = (0..DRAWS)
        .filter_map(|_| {
            let mut drawn = Sums::default();
            for _ in &sums {
                drawn.add(&sums[rng.random_range(0..sums.len())]);
            }
            drawn.pearson()
        })
        .collect();
    found.sort_by(f64::total_cmp);
    (2 * found.len() > DRAWS).then(|| (quantile(&found, 0.025), quantile(&found, 0.975)))
}

/// A quantile of sorted numbers, interpolated between the two nearest.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * float(sorted.len() - 1);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a place in a list"
    )]
    let below = place.floor() as usize;
    let above = sorted[(below + 1).min(sorted.len() - 1)];
    sorted[below] + (above - sorted[below]) * place.fract()
}

#[cfg(test)]
mod tests {
    use super::super::correlation;
    use super::*;

    /// Five games of each of 13 models. The numbers of one model are nearly equal, and models are unrelated.
    fn alike() -> Vec<Vec<(f64, f64)>> {
        let model = |model: u32| {
            let (x, y) = (f64::from(model * 5 % 13), f64::from(model * 8 % 13));
            (0..5).map(|game| (x + 0.01 * f64::from(game), y - 0.02 * f64::from(game))).collect()
        };
        (0..13).map(model).collect()
    }

    #[test]
    fn games_that_are_alike_are_no_evidence() {
        let models = alike();
        let all = correlation(&models.concat()).expect("both vary");
        let (low, high) = by_models(&models).expect("13 models");
        assert!(low < all.r && all.r < high);
        // Fisher's interval treats 65 games as independent, so it is about √5 times too narrow.
        let (narrow_low, narrow_high) = all.interval.expect("65 games");
        assert!(high - low > 1.5 * (narrow_high - narrow_low), "{low} {high}");
        assert_eq!(by_models(&models), Some((low, high)));
    }

    #[test]
    fn without_enough_models_there_is_no_interval() {
        let models = alike();
        assert_eq!(by_models(&models[..2]), None);
        let mut padded = models[..2].to_vec();
        padded.push(Vec::new());
        assert_eq!(by_models(&padded), None);
        let constant = vec![vec![(1.0, 1.0), (1.0, 2.0)]; 3];
        assert_eq!(by_models(&constant), None);
        // x varies in the draws that contain the last model and another: 2/3 of all.
        let one_differs = [vec![(0.0, 1.0), (0.0, 2.0)], vec![(0.0, 1.0)], vec![(1.0, 3.0)]];
        assert!(by_models(&one_differs).is_some());
    }

    #[test]
    fn quantiles_are_interpolated() {
        let found = [0.0, 0.75, 1.0].map(|share| quantile(&[1.0, 2.0, 4.0], share)).to_vec();
        assert_eq!(found, [1.0, 3.0, 4.0]);
    }
}
