//! The least-squares line through points.

use super::{float, is_constant, mean};

/// The line y = intercept + slope · x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The change of y when x rises by 1.
    pub slope: f64,
    /// The value of y at x = 0.
    pub intercept: f64,
    /// The share of the variance of y that the line explains, 0 to 1; 0 if y is constant.
    pub r_squared: f64,
}

impl Line {
    /// The line with the smallest sum of squared vertical distances; `None` if x is constant.
    #[must_use]
    pub fn through(points: &[(f64, f64)]) -> Option<Self> {
        let (x, y): (Vec<f64>, Vec<f64>) = points.iter().copied().unzip();
        if is_constant(&x) {
            return None;
        }
        let (at_x, at_y) = (mean(&x)?, mean(&y)?);
        let sum = |term: &dyn Fn(f64, f64) -> f64| -> f64 {
            points.iter().map(|(x, y)| term(x - at_x, y - at_y)).sum::<f64>() / float(x.len())
        };
        let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
        let slope = xy / xx;
        let r_squared = if is_constant(&y) { 0.0 } else { slope * xy / yy };
        Some(Self { slope, intercept: at_y - slope * at_x, r_squared })
    }
}

#[cfg(test)]
mod tests {
    use super::super::correlation;
    use super::*;

    /// Anscombe's four sets of points (1973), which agree in all of these numbers and in nothing else.
    #[test]
    fn anscombes_quartet() {
        let x = [10.0, 8.0, 13.0, 9.0, 11.0, 14.0, 6.0, 4.0, 12.0, 7.0, 5.0];
        let last = [8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 19.0, 8.0, 8.0, 8.0];
        let y = [
            [8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68],
            [9.14, 8.14, 8.74, 8.77, 9.26, 8.10, 6.13, 3.10, 9.13, 7.26, 4.74],
            [7.46, 6.77, 12.74, 7.11, 7.81, 8.84, 6.08, 5.39, 8.15, 6.42, 5.73],
            [6.58, 5.76, 7.71, 8.84, 8.47, 7.04, 5.25, 12.50, 5.56, 7.91, 6.89],
        ];
        for (y, x) in y.iter().zip([x, x, x, last]) {
            let points: Vec<(f64, f64)> = x.into_iter().zip(*y).collect();
            let Line { slope, intercept, r_squared } = Line::through(&points).expect("x varies");
            let r = correlation(&points).expect("both vary").r;
            assert!((r - 0.816).abs() < 0.001, "{r}");
            assert!((slope - 0.5).abs() < 0.001 && (intercept - 3.0).abs() < 0.01);
            assert!((r_squared - 0.667).abs() < 0.001 && (r_squared - r * r).abs() < 1e-12);
        }
    }

    #[test]
    fn level_and_upright_points() {
        let level = Line { slope: 0.0, intercept: 2.0, r_squared: 0.0 };
        assert_eq!(Line::through(&[(0.0, 2.0), (1.0, 2.0)]), Some(level));
        assert_eq!(Line::through(&[(1.0, 0.0), (1.0, 2.0)]), None);
        assert_eq!(Line::through(&[]), None);
    }
}
