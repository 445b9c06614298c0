//! What can go wrong in the store. It is the host's fault, never a player's.

use std::sync::Arc;

/// Why something could not be kept or read.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// Too many requests wait for a connection; the same works later.
    #[error("the journal failed: too many read at once")]
    Busy,
    /// The database failed, or rejected an entry.
    #[error("the journal failed: {0}")]
    Database(Arc<str>),
    /// The database is on another machine, and not reached: the same works later.
    #[error("the journal failed: the database is not reached")]
    Away,
    /// What is stored cannot be read, or contradicts itself.
    #[error("the journal failed: {0}")]
    Broken(Arc<str>),
    /// A row that others refer to does not exist.
    #[error("the journal failed: {0}")]
    Missing(Arc<str>),
    /// A commit failed earlier, and nothing is stored until a restart.
    #[error("the journal failed: an earlier commit failed; restart the server")]
    Failed,
    /// An earlier entry of the episode was refused, and this one would leave a gap in its chain.
    #[error("the journal failed: an earlier entry of the episode was refused")]
    Gap,
    /// Another server of this database plays it, or takes it over at this moment.
    #[error("another server of this database plays it")]
    Elsewhere,
    /// Nothing takes the request any more.
    #[error("the journal failed: {0}")]
    Stopped(Stopped),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stopped {
    /// The whole server.
    #[error("the server is stopping")]
    Server,
    /// The task that writes.
    #[error("the writer has stopped")]
    Writer,
    /// The actor of the episode.
    #[error("the episode has stopped")]
    Episode,
}

impl StoreError {
    /// What is stored cannot be read.
    pub fn broken(problem: impl Into<Arc<str>>) -> Self {
        Self::Broken(problem.into())
    }

    /// A stored text is not what its column holds.
    pub fn decode(error: impl std::fmt::Display) -> Self {
        Self::broken(format!("error occurred while decoding: {error}"))
    }
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let text = error.to_string().into();
        match error {
            sqlx::Error::PoolTimedOut => Self::Busy,
            // Between this process and a database on another machine.
            sqlx::Error::Io(_) | sqlx::Error::Tls(_) | sqlx::Error::Protocol(_) => Self::Away,
            sqlx::Error::Decode(_) | sqlx::Error::ColumnDecode { .. } => Self::Broken(text),
            _ => Self::Database(text),
        }
    }
}
