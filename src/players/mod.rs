//! How a player meets a server: over HTTP, like everybody else.

pub mod client;
pub mod drive;
pub mod play;
mod recent;
