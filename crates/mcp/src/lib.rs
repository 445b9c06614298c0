//! One seat of a SwarmBench server as tools for a language model, over the Model Context Protocol (MCP).
//!
//! The crate is separate because two programs offer the same tools: the server at `/mcp`, and `swarmbench mcp`, a
//! client of a server, over its standard input and output. They differ only in how they reach the seat: [`SeatAccess`]. No
//! other crate names rmcp.
//!
//! - [`SeatAccess`] and [`Refusal`]: the interface that a program provides. [`essential`], [`answer`]: one HTTP request.
//!   [`serve`]: standard input and output.
//! - `player.rs`: the requests of the protocol. `arguments.rs`: the arguments that models send, read strictly.
//!   `seen.rs`: the observations that they see. `texts.rs`: every sentence that they read.

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
pub use self::seat::{Refusal, SeatAccess};
pub use self::stdio::{StdioError, serve};

/// Maximum wait of a tool, in seconds. Clients give up a tool call after 60 seconds, and some of them cannot be
/// configured to wait longer.
pub const MCP_WAIT_S_MAX: u32 = 45;

/// Default wait of `act` for the next round, in seconds.
pub const MCP_ACT_WAIT_S_DEFAULT: u32 = 30;

/// Maximum number of JSON values of a message after unused parts are removed: the library allocates each of them.
pub const MCP_VALUES_MAX: usize = 256;

/// Maximum size in bytes of an observation that a result also contains as JSON. Models get larger ones as text alone.
pub const MCP_STRUCTURED_BYTES_MAX: usize = 256 * 1024;
