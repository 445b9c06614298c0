//! What a swarm did, in numbers: metrics of one game, from the states and acts of its rounds.
//!
//! Pure: no files, no clock, no network, no wire format. A metric of a game depends on that game alone.
//! [`Meter`] takes a game round by round; `docs/evaluate/metrics.md` defines every metric.
//!
//! A crate of its own because the server, the command line and figures all measure games, and figures and tables are
//! made without a server.

pub mod game;
pub mod metric;
pub mod statistics;

mod meter;

pub use meter::{Counts, Embedder, Meter, Metrics, Options};
pub use metric::{Definition, Metric, RunValue};

/// The revision of all definitions; it is written beside every value. Any change of a value is a new revision.
pub const METRICS_REVISION: u32 = 1;
