//! The queries, a file a table.

pub mod audit;
pub mod clock;
pub mod competitions;
pub mod episodes;
pub mod exports;
pub(in crate::store) mod forks;
pub mod games;
pub mod imports;
pub mod journals;
pub mod keys;
pub mod metrics;
pub mod records;
pub mod results;
pub mod runs;
pub mod seats;
pub(in crate::store) mod templates;
pub mod tokens;
