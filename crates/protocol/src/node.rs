//! The servers that play together on one database.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// A server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Node {
    /// Its number: a server that is started again gets another. 0 for a server that plays alone.
    pub id: i64,
    /// Host and process.
    pub name: String,
    /// Where the other servers reach it; none for a server that plays alone.
    pub address: Option<String>,
    /// The version of the program.
    pub version: String,
    /// Whether it is the server that answers this.
    pub is_this: bool,
    /// Whether it takes games that nobody plays.
    pub ready: bool,
    /// Whether the database has its session. A server without one has lost its connection, or its process is gone.
    pub connected: bool,
    /// When it was started.
    pub started_at: Timestamp,
    /// How long ago it was seen, in milliseconds, by the clock of the database. After 6,000 the others take over what it plays.
    pub seen_ms_ago: u64,
    /// How far its clock is ahead of that of the database, in milliseconds.
    pub clock_offset_ms: i64,
    /// Episodes in its memory.
    pub episodes: u32,
    /// Games, runs and competitions that it has taken.
    pub places: u32,
}

/// The servers of a database, the oldest first. The first one does what only one does: it measures games, and deletes what is old.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NodeList {
    /// Whether several servers may play on this database.
    pub cluster: bool,
    /// All of them.
    pub items: Vec<Node>,
}
