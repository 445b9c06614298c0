//! A networked evaluation server for SwarmBench: it hosts episodes, resolves their rounds when all
//! agents have acted, and keeps everything in a journal from which any of it can be recomputed.
//!
//! The modules, in the order in which data flows:
//!
//! - [`http`]: routes and connections; the only place that names axum. [`wire`] has the shapes of its JSON.
//! - [`episode`]: the barrier, the actor that steps the engine, and the snapshots that readers share.
//! - [`journal`]: the records of an episode, and how it is replayed.
//! - [`store`]: the database; the only place that names sqlx.
//! - [`run`]: suites of games for one model. [`competition`]: runs on seeds that are secret until the end.
//! - [`prompt`]: observations as text for language models.
//! - [`server`]: starts and stops all of the above.
//! - [`llm`]: requests to language models, over the network or from a cassette.
//! - [`players`]: a client of the server that plays. [`loadtest`]: many of them at once. [`cli`]: the commands.
//! - [`fair`], [`work`]: fair shares of scarce resources, and worker threads that use them.
//! - [`clock`], [`host`], [`ids`], [`keys`], [`telemetry`]: what several modules need.

#![expect(
    missing_docs,
    reason = "an application: names and types say what is there, comments say why"
)]
#![expect(clippy::missing_errors_doc, reason = "error types say what can fail")]
#![expect(clippy::must_use_candidate, reason = "types that must not be dropped at once say so")]

pub use swarmbench_boards as board;
pub use swarmbench_boards::competition;
pub use swarmbench_client as players;
pub use swarmbench_client::{eval, llm};
pub use swarmbench_clock as clock;
pub use swarmbench_journal as journal;
pub use swarmbench_loadtest as loadtest;
pub use swarmbench_prompt as prompt;
pub use swarmbench_protocol as wire;
pub use swarmbench_protocol::names;

pub mod budget;
pub mod cli;
pub mod competitions;
pub mod dataset;
pub mod episode;
pub mod fair;
pub mod host;
pub mod hosted;
pub mod http;
pub mod ids;
pub mod keys;
mod migrations;
pub mod run;
pub mod server;
pub mod standings;
pub mod store;
pub mod telemetry;
pub mod work;
