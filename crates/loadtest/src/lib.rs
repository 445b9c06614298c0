//! A load test of a running server, from the outside, and of what it is measured against.
//!
//! A crate of its own because it must not share code with what it measures, except for the shapes of the wire.
//!
//! - [`play`]: a grid of games, small to large. [`polls`]: many requests that wait. [`slow`]: clients that do harm.
//! - [`obs`] against [`bare_handler`], [`acts`] against [`bare_commit`]: how far the server is from what the
//!   libraries below it could do at best, measured in turns.
//! - [`connection`]: a client that costs little. [`games`]: episodes to play. [`latencies`], [`metrics`],
//!   [`rounds`]: what all of them need.

pub mod acts;
pub mod bare_commit;
pub mod bare_handler;
pub mod connection;
pub mod games;
pub mod latencies;
pub mod metrics;
pub mod obs;
pub mod play;
pub mod polls;
pub mod rounds;
pub mod slow;

use std::sync::Arc;

/// Receives progress.
pub type Progress = Arc<dyn Fn(&str, u64, u64) + Send + Sync>;

/// A load test could not be made at all. Answers that are errors do not end one: they are counted.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The address is none that can be used.
    #[error("{0:?} is not the address of a server; it looks like http://127.0.0.1:8080")]
    Address(String),
    /// The server's name leads nowhere.
    #[error("{host} is not found: {source}")]
    Lookup {
        /// The name and the port.
        host: String,
        /// Why.
        source: std::io::Error,
    },
    /// Something that must work did not.
    #[error("{what}: {why}")]
    Failed {
        /// What was tried.
        what: &'static str,
        /// Why it failed.
        why: String,
    },
}

impl LoadError {
    /// What was tried, and why it failed.
    fn of(what: &'static str) -> impl Fn(&dyn std::fmt::Display) -> Self {
        move |why| Self::Failed { what, why: why.to_string() }
    }
}

/// A count as a number that can be divided.
#[expect(clippy::cast_precision_loss, reason = "no count here comes near 2⁵³")]
const fn float(count: u64) -> f64 {
    count as f64
}

/// How often a second.
fn per_second(count: u64, taken: std::time::Duration) -> f64 {
    float(count) / taken.as_secs_f64().max(1e-9)
}

/// The number in the middle; the mean of the two where the count is even. Zero of none.
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
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        for (numbers, middle) in
            [(vec![], 0.0), (vec![3.0], 3.0), (vec![9.0, 1.0, 2.0], 2.0), (vec![4.0, 1.0], 2.5)]
        {
            assert!((median(numbers.clone()) - middle).abs() < 1e-12, "{numbers:?}");
        }
    }
}
