//! Latency histograms.

use std::sync::Mutex;
use std::time::Duration;

use hdrhistogram::Histogram;
use serde::Serialize;

/// The longest time that is told apart from longer ones: an hour.
const MICROS_MAX: u64 = 3_600_000_000;

/// Collects durations from many tasks.
#[derive(Debug)]
pub struct Latencies(Mutex<Histogram<u64>>);

impl Default for Latencies {
    fn default() -> Self {
        let histogram = Histogram::new_with_max(MICROS_MAX, 3).expect("the bounds are allowed");
        Self(Mutex::new(histogram))
    }
}

impl Latencies {
    /// Adds durations.
    pub fn record(&self, taken: impl IntoIterator<Item = Duration>) {
        let mut histogram = self.0.lock().expect("nothing panics while it holds this");
        for taken in taken {
            histogram.saturating_record(u64::try_from(taken.as_micros()).unwrap_or(MICROS_MAX));
        }
    }

    /// What was collected, in short.
    #[must_use]
    pub fn spread(&self) -> Spread {
        let histogram = self.0.lock().expect("nothing panics while it holds this");
        let millis = |micros: u64| super::float(micros) / 1000.0;
        Spread {
            count: histogram.len(),
            p50_ms: millis(histogram.value_at_quantile(0.5)),
            p99_ms: millis(histogram.value_at_quantile(0.99)),
            max_ms: millis(histogram.max()),
        }
    }
}

/// A distribution of durations, in milliseconds, to three digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Of how many.
    pub count: u64,
    /// Half of them took no longer.
    pub p50_ms: f64,
    /// 99 of 100 took no longer.
    pub p99_ms: f64,
    /// The longest.
    pub max_ms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_what_was_recorded() {
        let latencies = Latencies::default();
        latencies.record((1..=1000).map(Duration::from_millis));
        let spread = latencies.spread();
        assert_eq!(spread.count, 1000);
        // Three digits are kept.
        for (told, true_one) in
            [(spread.p50_ms, 500.0), (spread.p99_ms, 990.0), (spread.max_ms, 1000.0)]
        {
            assert!((told - true_one).abs() <= true_one / 1000.0, "{told} is not {true_one}");
        }
    }
}
