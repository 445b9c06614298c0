//! A networked evaluation server for SwarmBench: it hosts episodes, resolves their rounds when all
//! agents have acted, and keeps everything in a journal from which any of it can be recomputed.
//!
//! The modules, from those that a request meets first to those that all others use:
//!
//! - [`cli`]: the commands. [`server`]: starts and stops everything below.
//! - [`http`]: routes and connections; the only module that names axum. [`membership`]: a server's part in a cluster.
//! - [`dataset`]: the public toolkit's data format. [`standings`]: the boards of a database.
//! - [`competitions`]: runs on seeds that are secret until the end. [`run`]: suites of games for one model.
//! - [`hosted`]: built-in players that the server plays. [`episode`]: the barrier, the actor that steps the engine, and
//!   the snapshots that readers share.
//! - [`store`]: the database; besides [`migrations`] the only module that names sqlx.
//! - [`cluster`]: what a server of a cluster decides, as machines without clock, network or database.
//! - [`fair`], [`work`], [`budget`]: fair shares of scarce resources, worker threads, memory.
//! - [`host`], [`ids`], [`keys`], [`telemetry`]: what several modules need.

#![expect(
    missing_docs,
    reason = "an application: names and types say what is there, comments say why"
)]
#![expect(clippy::missing_errors_doc, reason = "error types say what can fail")]
#![expect(clippy::must_use_candidate, reason = "types that must not be dropped at once say so")]
// Those macros panic when nobody reads the output; `swarmbench_terminal` has replacements.
#![warn(clippy::print_stdout, clippy::print_stderr)]

#[cfg(feature = "cli")]
#[macro_use]
extern crate swarmbench_terminal;

pub mod appraisal;
pub mod budget;
#[cfg(feature = "cli")]
pub mod cli;
pub mod cluster;
pub mod competitions;
pub mod dataset;
pub mod episode;
pub mod fair;
pub mod host;
pub mod hosted;
pub mod http;
pub mod ids;
pub mod keys;
pub mod measure;
pub mod membership;
pub mod migrations;
pub mod pages;
pub mod run;
pub mod server;
pub mod standings;
pub mod store;
pub mod telemetry;
pub mod work;
