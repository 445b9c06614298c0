//! One seat of a SwarmBench server as tools for a language model, over the Model Context Protocol (MCP).
//!
//! A crate of its own because two programs offer the same tools: the server at `/mcp`, and `swarmbench mcp`, a client
//! of a server, over its standard input and output. They differ only in how they reach the seat: [`Seat`]. No other
//! crate names rmcp.
//!
//! - [`Seat`] and [`Refusal`]: what a program has to provide. [`essential`], [`answer`]: one HTTP request. [`serve`]: standard input
//!   and output.
//! - `player.rs`: the requests of the protocol. `arguments.rs`: what models send, read strictly. `seen.rs`: what they
//!   see. `texts.rs`: every sentence that they read.

mod arguments;
mod http;
mod message;
mod player;
mod seat;
mod seen;
mod stdio;
mod texts;

pub use self::http::answer;
pub use self::message::essential;
pub use self::seat::{Refusal, Seat};
pub use self::stdio::{StdioError, serve};

/// Seconds that a tool waits at most. Clients give up a tool call after 60 seconds, and some of them cannot be told to
/// wait longer.
pub const MCP_WAIT_S_MAX: u32 = 45;

/// Seconds that `act` waits for the next round if it is not told how long.
pub const MCP_ACT_WAIT_S_DEFAULT: u32 = 30;

/// Values of a message without what nobody reads: the library keeps each of them as a value of its own.
pub const MCP_VALUES_MAX: usize = 256;

/// Bytes of an observation up to which a result has it as JSON, too. Of a larger one models get the text alone.
pub const MCP_STRUCTURED_BYTES_MAX: usize = 256 * 1024;
