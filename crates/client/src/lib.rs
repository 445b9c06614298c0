//! Programs that meet a SwarmBench server over HTTP: a client, players, language models, and evaluations made of
//! them.
//!
//! The crate is separate because it needs no server: it is built without a database and without a web framework.
//!
//! - [`client`]: requests, and which of them are tried again.
//! - [`drive`]: the one loop that plays seats. [`play`]: built-in players.
//! - [`llm`]: language models. [`eval`]: experiments, their runs and reports.

pub mod client;
pub mod drive;
pub mod eval;
mod http;
mod lines;
pub mod llm;
mod page;
pub mod play;
mod recent;
