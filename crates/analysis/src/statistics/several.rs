//! Multiple tests.

use super::float;

/// The stars of a p: `***` below 0.001, `**` below 0.01, `*` below 0.05.
#[must_use]
pub fn stars(p: f64) -> &'static str {
    match p {
        p if p < 0.001 => "***",
        p if p < 0.01 => "**",
        p if p < 0.05 => "*",
        _ => "",
    }
}

/// The q values of Benjamini and Hochberg for a family of tests. If all tests with a q up to some value are accepted,
/// that value is the expected share of false ones among them. Tests without a p are no part of the family.
#[must_use]
pub fn q_values(p: &[Option<f64>]) -> Vec<Option<f64>> {
    let mut order: Vec<(usize, f64)> =
        p.iter().enumerate().filter_map(|(place, p)| Some((place, (*p)?))).collect();
    order.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let mut q = vec![None; p.len()];
    let mut least: f64 = 1.0;
    for (rank, (place, p)) in (1..).zip(&order).collect::<Vec<_>>().into_iter().rev() {
        least = least.min(p * float(order.len()) / float(rank));
        q[*place] = Some(least);
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expected values are from scipy 1.17: `false_discovery_control(p, method="bh")`.
    #[test]
    fn q_by_another_library() {
        let p = [0.012, 0.8, 0.0004, 0.03, 0.03, 0.2, 0.049];
        let expected = [0.042, 0.8, 0.0028, 0.0525, 0.0525, 0.7 / 3.0, 0.0686];
        let mut family: Vec<Option<f64>> = p.map(Some).to_vec();
        family.insert(2, None);
        let mut found = q_values(&family);
        assert_eq!(found.remove(2), None);
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found.expect("a test") - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn marks() {
        let found = [0.05, 0.049, 0.01, 0.009, 0.001, 0.0009].map(stars);
        assert_eq!(found, ["", "*", "*", "**", "**", "***"]);
    }
}
