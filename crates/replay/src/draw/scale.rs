//! Numbers of pictures: scales, rounded ranges and labels, and sizes.

/// The sizes of text.
pub(crate) const TITLE: f64 = 14.0;
pub(crate) const HEADING: f64 = 12.0;
pub(crate) const LABEL: f64 = 10.0;

/// The empty border of a picture.
pub(crate) const MARGIN: f64 = 16.0;

/// A linear map from numbers to coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    least: f64,
    most: f64,
    from: f64,
    to: f64,
}

impl Scale {
    /// Maps `least` to `from` and `most` to `to`. An empty range is extended.
    pub(crate) fn new((least, most): (f64, f64), from: f64, to: f64) -> Self {
        let most = if most > least { most } else { least + 1.0 };
        Self { least, most, from, to }
    }

    fn at(self, value: f64) -> f64 {
        (value - self.least) / (self.most - self.least) * (self.to - self.from) + self.from
    }

    /// The coordinate of a value, clamped to the scale.
    pub(crate) fn within(self, value: f64) -> f64 {
        self.at(value.clamp(self.least, self.most))
    }
}

/// A count as a coordinate.
#[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
pub(crate) fn real(count: usize) -> f64 {
    count as f64
}

/// About `count` round numbers in a range.
fn ticks((least, most): (f64, f64), count: usize) -> Vec<f64> {
    if most <= least {
        return vec![least];
    }
    let raw = (most - least) / real(count.max(1));
    let magnitude = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * magnitude)
        .find(|&step| step >= raw * 0.999)
        .unwrap_or(10.0 * magnitude);
    let first = (least / step - 1e-9).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let last = ((most / step + 1e-9).floor() - first).max(0.0) as usize;
    (0..=last).map(|place| (first + real(place)) * step).collect()
}

/// The smallest range with round ends around all values and 0.
pub(crate) fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (mut least, mut most) = (0.0_f64, 0.0_f64);
    for value in values.into_iter().filter(|value| value.is_finite()) {
        least = least.min(value);
        most = most.max(value);
    }
    if most <= least {
        return (least, least + 1.0);
    }
    let marks = ticks((least, most), 4);
    let step = if marks.len() > 1 { marks[1] - marks[0] } else { most - least };
    ((least / step + 1e-9).floor() * step, (most / step - 1e-9).ceil() * step)
}

/// A number as a label, with at most three decimals.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.').replace('-', "−");
    if text == "−0" { "0".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        assert_eq!(ticks((0.0, 100.0), 5), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks((0.0, 1.0), 4), [0.0, 0.5, 1.0]);
        assert_eq!(ticks((-3.0, 3.0), 3), [-2.0, 0.0, 2.0]);
        assert_eq!(ticks((2.0, 2.0), 3), [2.0]);
        assert_eq!(range([3.7, 11.0]), (0.0, 15.0));
        assert_eq!(range([]), (0.0, 1.0));
        assert_eq!(range([-4.0, f64::NAN, 2.0]), (-4.0, 2.0));
    }

    #[test]
    fn numbers_are_short() {
        let shown: Vec<String> = [0.1 + 0.2, -2.0, -0.0001, 100.0].map(number).into();
        assert_eq!(shown, ["0.3", "−2", "0", "100"]);
    }
}
