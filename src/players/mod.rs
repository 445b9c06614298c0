//! Players, which use a server over HTTP like all other clients.

pub mod client;
pub mod drive;
pub mod play;
mod recent;
