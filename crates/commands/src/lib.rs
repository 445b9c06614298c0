//! The commands that a person gives to a server from any machine: they need its address, and neither its database nor its code.
//!
//! The crate is separate because nobody waits for a command as games wait for a round: it is compiled with fewer optimisations. The
//! server's program has further commands, which open a database or run a server.
//!
//! - [`eval`], [`play`], [`mcp`]: players. [`replay`]: one game as a film, a picture or a page. [`worth`]: what could still be scored.
//! - [`competition`], [`audit`], [`clock`], [`healthcheck`]: what organizers and operators ask of a server.
//! - [`boards`], [`journals`], [`pages`], [`options`], [`output`], [`stop`]: what several commands share, those of the server's
//!   program among them.

#![expect(
    missing_docs,
    reason = "an application: names and types say what is there, comments say why"
)]
#![expect(clippy::missing_errors_doc, reason = "error types say what can fail")]
#![expect(clippy::must_use_candidate, reason = "types that must not be dropped at once say so")]
// Those macros panic when nobody reads the output; `swarmbench_terminal` has replacements.
#![warn(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
extern crate swarmbench_terminal;

pub mod audit;
pub mod boards;
pub mod clock;
pub mod competition;
pub mod eval;
pub mod healthcheck;
pub mod journals;
pub mod mcp;
pub mod options;
pub mod output;
pub mod pages;
mod partial;
pub mod play;
pub mod replay;
pub mod stop;
pub mod worth;
