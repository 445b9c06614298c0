//! Metrics of a swarm: numbers about one game, from the states and acts of its rounds.
//!
//! The crate is pure: no files, no clock, no network. A metric of a game depends on that game alone. [`Meter`] takes
//! a game round by round, [`journal`] reads it from its journal; `docs/evaluate/metrics.md` defines every metric.
//!
//! The crate is separate because the server, the command line and pictures all measure games, and tables and pictures are
//! made without a server.

pub mod game;
pub mod journal;
pub mod means;
pub mod metric;

mod characters;
mod embed;
mod meter;

pub use embed::Hash1;
pub use meter::{Counts, Meter, Metrics, Options};
pub use metric::{Definition, Metric, RunValue};

/// The revision of all definitions, written beside every value. Any change of a value is a new revision.
pub const METRICS_REVISION: u32 = 1;
