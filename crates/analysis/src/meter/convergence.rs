//! The increase of a series over a game.

use super::counts::real;
use crate::metric::RunValue;

/// The defined values of a series.
#[derive(Default)]
pub(super) struct Trend {
    /// Rounds and their values.
    values: Vec<(u32, f64)>,
}

impl Trend {
    pub(super) fn add(&mut self, round: u32, value: Option<f64>) {
        self.values.extend(value.map(|value| (round, value)));
    }

    /// The mean of the last fifth of the values minus that of the first.
    pub(super) fn increase(&self) -> RunValue {
        self.value_of(|values| {
            let window = (values.len() / 5).max(1);
            let mean = |values: &[(u32, f64)]| {
                values.iter().map(|(_, value)| value).sum::<f64>() / real(window as u64)
            };
            mean(&values[values.len() - window..]) - mean(&values[..window])
        })
    }

    /// The least-squares change over a whole game of `rounds` rounds.
    pub(super) fn slope(&self, rounds: u32) -> RunValue {
        self.value_of(|values| {
            let count = real(values.len() as u64);
            let x_mean = values.iter().map(|&(round, _)| f64::from(round)).sum::<f64>() / count;
            let y_mean = values.iter().map(|(_, value)| value).sum::<f64>() / count;
            let (mut xy, mut xx) = (0.0, 0.0);
            for &(round, value) in values {
                let x = f64::from(round) - x_mean;
                xy += x * (value - y_mean);
                xx += x * x;
            }
            xy / xx * f64::from(rounds - 1)
        })
    }

    /// Undefined for fewer than three values: the first and the last window would overlap or touch.
    fn value_of(&self, of: impl Fn(&[(u32, f64)]) -> f64) -> RunValue {
        let rounds = super::counts::small(self.values.len());
        RunValue { value: (rounds >= 3).then(|| of(&self.values)), rounds }
    }
}
