//! Correlations between two numbers of each game.

use statrs::function::beta::beta_reg;

use super::{float, is_constant, mean};

/// The minimum number of pairs.
pub const PAIRS_MIN: usize = 3;

/// The quantile 0.975 of the normal distribution.
const NORMAL_975: f64 = 1.959_963_984_540_054;

/// The relation between two numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correlation {
    /// The number of pairs.
    pub n: usize,
    /// Pearson's coefficient, −1 to 1.
    pub r: f64,
    /// The probability, without any relation, of an r at least as far from 0 ([`p_value`]).
    pub p: f64,
    /// The 95 % interval of r by Fisher's z; `None` for three pairs, which say nothing about it.
    pub interval: Option<(f64, f64)>,
    /// Spearman's coefficient: Pearson's coefficient of the ranks, with tied numbers at the mean of their ranks.
    pub rho: f64,
}

/// A reason why a correlation is undefined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoCorrelation {
    /// There are fewer than [`PAIRS_MIN`] pairs.
    #[error("{0} games have both values, and a correlation needs {PAIRS_MIN}")]
    TooFew(usize),
    /// The first number is the same in all pairs.
    #[error("it is the same in all {0} games")]
    FirstConstant(usize),
    /// The second number is the same in all pairs.
    #[error("what it is compared with is the same in all {0} games")]
    SecondConstant(usize),
}

/// The correlation of pairs of finite numbers.
///
/// # Errors
/// If there are too few pairs, or a number is constant.
pub fn correlation(pairs: &[(f64, f64)]) -> Result<Correlation, NoCorrelation> {
    let (x, y): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let n = pairs.len();
    if n < PAIRS_MIN {
        return Err(NoCorrelation::TooFew(n));
    }
    if is_constant(&x) {
        return Err(NoCorrelation::FirstConstant(n));
    }
    if is_constant(&y) {
        return Err(NoCorrelation::SecondConstant(n));
    }
    let (r, rho) = (pearson(&x, &y), pearson(&ranks(&x), &ranks(&y)));
    Ok(Correlation { n, r, p: p_value(r, n), interval: interval(r, n), rho })
}

/// The two-sided p of an r of `n` ≥ 3 pairs: t = r·√((n − 2) / (1 − r²)) has Student's t-distribution with n − 2
/// degrees of freedom if there is no relation. It is 0 if |r| is 1.
#[must_use]
pub fn p_value(r: f64, n: usize) -> f64 {
    // (n − 2) / (n − 2 + t²) is 1 − r².
    beta_reg((float(n) - 2.0) / 2.0, 0.5, (1.0 - r) * (1.0 + r))
}

fn pearson(x: &[f64], y: &[f64]) -> f64 {
    let centred = |numbers: &[f64]| -> Vec<f64> {
        let mean = mean(numbers).unwrap_or_default();
        numbers.iter().map(|number| number - mean).collect()
    };
    let (x, y) = (centred(x), centred(y));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    // Two roots, as the product of small squares could underflow to 0.
    let r = product(&x, &y) / product(&x, &x).sqrt() / product(&y, &y).sqrt();
    r.clamp(-1.0, 1.0)
}

/// The rank of each number from 1; tied numbers share the mean of their ranks.
fn ranks(numbers: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    let mut ranks = vec![0.0; numbers.len()];
    let mut before = 0;
    #[expect(clippy::float_cmp, reason = "ranks are shared by equal numbers")]
    for equal in order.chunk_by(|&a, &b| numbers[a] == numbers[b]) {
        for &place in equal {
            ranks[place] = float(2 * before + equal.len() + 1) / 2.0;
        }
        before += equal.len();
    }
    ranks
}

fn interval(r: f64, n: usize) -> Option<(f64, f64)> {
    (n > PAIRS_MIN).then(|| {
        let half = NORMAL_975 / (float(n) - 3.0).sqrt();
        ((r.atanh() - half).tanh(), (r.atanh() + half).tanh())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, expected: f64) -> bool {
        (found - expected).abs() < 1e-9
    }

    /// Tables S.7 and S.8 of the paper: 13 models, five games each.
    const OF_65: [(f64, f64); 13] = [
        (-0.668, 0.000),
        (-0.185, 0.140),
        (-0.309, 0.012),
        (0.382, 0.002),
        (0.458, 0.000),
        (-0.102, 0.419),
        (-0.027, 0.832),
        (-0.447, 0.000),
        (-0.439, 0.000),
        (-0.134, 0.286),
        (-0.159, 0.205),
        (0.056, 0.660),
        (-0.115, 0.361),
    ];

    /// Table S.9: five tasks, five games each.
    const OF_25: [(f64, f64); 26] = [
        (0.241, 0.246),
        (-0.061, 0.774),
        (0.305, 0.138),
        (0.372, 0.067),
        (-0.147, 0.483),
        (-0.141, 0.500),
        (-0.044, 0.835),
        (-0.031, 0.884),
        (-0.307, 0.136),
        (-0.255, 0.218),
        (-0.499, 0.011),
        (-0.267, 0.197),
        (0.031, 0.884),
        (-0.231, 0.267),
        (-0.016, 0.941),
        (0.094, 0.656),
        (-0.144, 0.493),
        (-0.118, 0.574),
        (-0.135, 0.520),
        (-0.139, 0.508),
        (-0.528, 0.007),
        (-0.450, 0.024),
        (-0.338, 0.098),
        (-0.163, 0.436),
        (-0.005, 0.980),
        (-0.058, 0.783),
    ];

    /// The paper prints three digits of both: p lies between the values for the two ends of the rounding interval of
    /// r.
    #[test]
    fn every_p_of_the_paper_follows_from_its_r() {
        for (pairs, n) in [(&OF_65[..], 65), (&OF_25[..], 25)] {
            for &(r, printed) in pairs {
                let ends = [r - 0.0005, r + 0.0005].map(|r| p_value(r, n));
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                assert!(
                    (low - 0.0005..=high + 0.0005).contains(&printed),
                    "r {r} of {n}: p from {low} to {high}, not {printed}"
                );
            }
        }
    }

    /// The expected values are from scipy 1.17: `pearsonr(x, y)`, its `confidence_interval(0.95)`, and `spearmanr(x,
    /// y)`.
    #[test]
    fn by_another_library() {
        let x = [0.11, 0.32, 0.11, 0.54, 0.87, 0.45, 0.32, 0.05, 0.66, 0.11];
        let y = [3.0, 5.0, 2.0, 5.0, 9.0, 4.0, 5.0, 0.0, 5.0, 3.0];
        let ten = [
            0.885_121_901_935_557_6,
            0.000_661_858_376_650_501_2,
            0.577_125_162_637_166_6,
            0.972_678_395_497_332_9,
            0.898_253_174_908_815,
        ];
        let (few_x, few_y) = ([12.0, 1.0, 7.0, 7.0, 3.0], [-1.5, 0.25, 1.0, -4.0, 2.0]);
        let five = [
            -0.480_410_016_813_874_4,
            0.412_741_888_594_055_14,
            -0.957_036_765_216_280_1,
            0.697_485_289_814_266_5,
            -0.461_690_258_438_319_35,
        ];
        for (x, y, expected) in [(&x[..], &y[..], ten), (&few_x, &few_y, five)] {
            let pairs: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).collect();
            let found = correlation(&pairs).expect("both vary");
            let (low, high) = found.interval.expect("more than three pairs");
            let told = [found.r, found.p, low, high, found.rho];
            assert!(told.iter().zip(expected).all(|(a, b)| close(*a, b)), "{told:?}");
        }
    }

    /// The expected values of p in the tail are from scipy: `2 * scipy.stats.t.sf(abs(t), n - 2)`.
    #[test]
    fn small_p_by_another_library() {
        for (r, n, expected) in [
            (0.9, 65, 2.115_867_877_915_540_5e-24),
            (-0.668, 65, 1.210_193_542_829_16e-9),
            (0.999, 5, 3.795_497_437_340_064_5e-5),
            (0.5, 3, 2.0 / 3.0),
            (0.001, 1000, 0.974_804_414_627_923_2),
        ] {
            let found = p_value(r, n);
            assert!((found / expected - 1.0).abs() < 1e-6, "r {r} of {n}: {found:e}");
        }
    }

    #[test]
    fn what_is_not_defined() {
        let same_x = [(1.0, 1.0), (1.0, 2.0), (1.0, 3.0)];
        let same_y = same_x.map(|(x, y)| (y, x));
        assert_eq!(correlation(&same_x[..2]), Err(NoCorrelation::TooFew(2)));
        assert_eq!(correlation(&same_x), Err(NoCorrelation::FirstConstant(3)));
        assert_eq!(correlation(&same_y), Err(NoCorrelation::SecondConstant(3)));
    }

    #[test]
    fn on_a_line_p_is_0() {
        let line = [(0.0, 0.0), (1.0, -2.0), (2.0, -4.0), (4.0, -8.0)];
        let found = correlation(&line).expect("it varies");
        assert_eq!((found.r, found.p, found.rho), (-1.0, 0.0, -1.0));
        assert_eq!(found.interval, Some((-1.0, -1.0)));
        assert_eq!(correlation(&line[..3]).expect("it varies").interval, None);
    }

    #[test]
    fn equal_numbers_share_their_ranks() {
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 2.0, 3.0]), [4.0, 1.0, 4.0, 2.0, 4.0]);
    }
}
