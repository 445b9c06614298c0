//! A load test of a running server, and the bare programs that it is compared with. It shares no code with the server
//! that it measures, except for the shapes of the wire.
//!
//! - [`play`]: a grid of games, small to large. [`polls`]: many waiting requests.
//! - [`reads`]: boards, lists and look-ups on a server with many episodes. [`competition`]: the pages of a large competition
//!   while its games end.
//! - [`obs`] against [`bare_handler`], [`acts`] against [`bare_commit`] and [`bare_acts`]: the server beside the
//!   optimum of its libraries, measured in turns.
//! - [`connection`]: a cheap client. [`games`]: episodes to play. [`metrics`], [`rounds`]: shared parts.

pub(crate) mod acts;
pub(crate) mod bare_acts;
pub(crate) mod bare_commit;
pub(crate) mod bare_handler;
pub(crate) mod competition;
pub(crate) mod connection;
pub(crate) mod games;
pub(crate) mod metrics;
pub(crate) mod obs;
pub(crate) mod play;
pub(crate) mod polls;
pub(crate) mod reads;
pub(crate) mod rounds;

use std::sync::Arc;

/// A callback for progress.
pub(crate) type Progress = Arc<dyn Fn(&str, u64, u64) + Send + Sync>;

/// A reason why a load test could not run. Error answers of the server do not end it: they are counted.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LoadError {
    /// The address is not that of a server.
    #[error("{0:?} is not the address of a server, such as http://127.0.0.1:8080")]
    Address(String),
    /// The server's name was not resolved.
    #[error("{host} is not found: {source}")]
    Lookup {
        /// `NAME:PORT`.
        host: String,
        /// The error of the host's resolver.
        source: std::io::Error,
    },
    /// A step of the load test failed.
    #[error("{what}: {why}")]
    Failed {
        /// The step.
        what: &'static str,
        /// The cause.
        why: String,
    },
}

impl LoadError {
    /// A constructor for errors of the step `what`.
    fn of(what: &'static str) -> impl Fn(&dyn std::fmt::Display) -> Self {
        move |why| Self::Failed { what, why: why.to_string() }
    }
}

/// A count as a float.
#[expect(clippy::cast_precision_loss, reason = "no count here comes near 2⁵³")]
const fn float(count: u64) -> f64 {
    count as f64
}

/// Events per second.
fn per_second(count: u64, elapsed: std::time::Duration) -> f64 {
    float(count) / elapsed.as_secs_f64().max(1e-9)
}

/// The median; the mean of the two middle numbers if the count is even, 0 without numbers.
fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    let middle = numbers.len() / 2;
    match numbers.len() {
        0 => 0.0,
        count if count % 2 == 1 => numbers[middle],
        _ => f64::midpoint(numbers[middle - 1], numbers[middle]),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use swarmbench_testkit::latencies::Latencies;

    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        for (numbers, middle) in
            [(vec![], 0.0), (vec![3.0], 3.0), (vec![9.0, 1.0, 2.0], 2.0), (vec![4.0, 1.0], 2.5)]
        {
            assert!((median(numbers.clone()) - middle).abs() < 1e-12, "{numbers:?}");
        }
    }

    #[test]
    fn quantiles_are_those_of_what_was_recorded() {
        let latencies = Latencies::default();
        latencies.record((1..=1000).map(Duration::from_millis));
        let spread = latencies.spread();
        assert_eq!(spread.count, 1000);
        // Three digits are exact.
        for (reported, exact) in
            [(spread.p50_ms, 500.0), (spread.p99_ms, 990.0), (spread.max_ms, 1000.0)]
        {
            assert!((reported - exact).abs() <= exact / 1000.0, "{reported} is not {exact}");
        }
    }
}
