//! Servers that share one database.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// Server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Node))]
pub struct Server {
    /// Number of the server: a server that is started again gets another. 0 for a server that plays alone.
    pub id: i64,
    /// Host and process.
    pub name: String,
    /// Address at which the other servers reach it; none for a server that plays alone.
    pub address: Option<String>,
    /// Version of the program.
    pub version: String,
    /// Whether this is the server that answers the request.
    pub is_this: bool,
    /// Whether the server takes games that nobody plays.
    pub ready: bool,
    /// Whether the database has the server's session. A server without one has lost its connection, or its process is gone.
    pub connected: bool,
    /// Time at which the server was started.
    pub started_at: Timestamp,
    /// Milliseconds since the server was last seen, by the clock of the database. After 6,000 the others take over what it
    /// plays.
    pub seen_ms_ago: u64,
    /// Milliseconds by which the server's clock is ahead of that of the database.
    pub clock_offset_ms: i64,
    /// Number of episodes in memory.
    pub episodes: u32,
    /// Number of games, runs and competitions that the server has taken.
    pub places: u32,
}

/// Servers of a database, oldest first. The first server does what only one does: it measures games, and deletes what is old.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = NodeList))]
pub struct ServerList {
    /// Whether several servers may play on this database.
    pub cluster: bool,
    /// All servers.
    pub items: Vec<Server>,
}
