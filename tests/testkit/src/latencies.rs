//! Latency histograms.

use std::sync::Mutex;
use std::time::Duration;

use hdrhistogram::Histogram;
use serde::Serialize;

/// The longest duration that is recorded exactly: an hour.
const MICROS_MAX: u64 = 3_600_000_000;

/// A histogram shared by many tasks.
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
    pub fn record(&self, durations: impl IntoIterator<Item = Duration>) {
        let mut histogram = self.0.lock().expect("nothing panics while it holds this");
        for duration in durations {
            histogram.saturating_record(u64::try_from(duration.as_micros()).unwrap_or(MICROS_MAX));
        }
    }

    /// The distribution of the durations so far.
    pub fn spread(&self) -> Spread {
        let histogram = self.0.lock().expect("nothing panics while it holds this");
        let millis = |micros: u64| Duration::from_micros(micros).as_secs_f64() * 1000.0;
        Spread {
            count: histogram.len(),
            p50_ms: millis(histogram.value_at_quantile(0.5)),
            p99_ms: millis(histogram.value_at_quantile(0.99)),
            max_ms: millis(histogram.max()),
        }
    }
}

/// A distribution of durations, to three digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Number of durations.
    pub count: u64,
    /// Median.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// Maximum.
    pub max_ms: f64,
}
