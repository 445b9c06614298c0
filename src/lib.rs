//! A networked evaluation server for SwarmBench: it hosts episodes, resolves their rounds when all
//! agents have acted, and keeps everything in a journal from which any of it can be recomputed.
//!
//! The modules, in the order in which data flows:
//!
//! - [`http`]: a request comes in; the only place that names axum. [`wire`] has the shapes of its JSON.
//! - [`episode`]: the barrier, the actor that steps the engine, and what readers share.
//! - [`journal`]: the records of an episode, and how it is replayed.
//! - [`store`]: the database; the only place that names sqlx.
//! - [`run`]: suites of games for one model. [`competition`]: runs on seeds that nobody knows before the end.
//! - [`prompt`]: observations as text for language models.
//! - [`server`]: all of the above, started and stopped.
//! - [`llm`]: language models, asked over the network or played from a cassette.
//! - [`players`]: how a player meets a server. [`loadtest`]: many at once. [`cli`]: the commands.
//! - [`fair`], [`work`]: who gets the next share of something scarce, and heavy work done by it.
//! - [`clock`], [`host`], [`ids`], [`keys`], [`telemetry`]: what several of them need.

pub mod board;
pub mod budget;
pub mod cli;
pub mod clock;
pub mod competition;
pub mod competitions;
pub mod dataset;
pub mod episode;
pub mod eval;
pub mod fair;
pub mod host;
pub mod hosted;
pub mod http;
pub mod ids;
pub mod journal;
pub mod keys;
pub mod llm;
pub mod loadtest;
mod migrations;
pub mod names;
pub mod players;
pub mod prompt;
pub mod run;
pub mod server;
pub mod standings;
pub mod store;
pub mod telemetry;
pub mod wire;
pub mod work;
