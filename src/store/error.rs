//! Errors of the store. They are faults of the host, never of a player.

use std::sync::Arc;

/// The store could not write or read.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// Too many readers wait for a connection. A retry may succeed.
    #[error("the journal failed: too many read at once")]
    Busy,
    /// The database failed, or rejected an entry.
    #[error("the journal failed: {0}")]
    Database(Arc<str>),
    /// The connection to a PostgreSQL server is lost or cannot be made. A retry may succeed.
    #[error("the journal failed: the database is not reached")]
    Away,
    /// Stored data cannot be decoded or is inconsistent.
    #[error("the journal failed: {0}")]
    Broken(Arc<str>),
    /// A row that others refer to does not exist.
    #[error("the journal failed: {0}")]
    Missing(Arc<str>),
    /// A commit failed earlier: nothing is written until a restart.
    #[error("the journal failed: an earlier commit failed; restart the server")]
    Failed,
    /// An earlier entry of the episode was refused: this one would leave a gap in its chain.
    #[error("the journal failed: an earlier entry of the episode was refused")]
    Gap,
    /// The token of a request was replaced or revoked before the commit of what the request asks for.
    #[error("the token was replaced or revoked")]
    NoRights,
    /// Another server of the cluster owns the place, or is taking it over.
    #[error("another server of this database plays it")]
    Elsewhere,
    /// The receiver of the request has stopped.
    #[error("the journal failed: {0}")]
    Stopped(Stopped),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stopped {
    #[error("the server is stopping")]
    Server,
    #[error("the writer has stopped")]
    Writer,
    #[error("the episode has stopped")]
    Episode,
}

impl StoreError {
    pub fn broken(problem: impl Into<Arc<str>>) -> Self {
        Self::Broken(problem.into())
    }

    /// A stored text does not decode as its column's type.
    pub fn decode(error: impl std::fmt::Display) -> Self {
        Self::broken(format!("error occurred while decoding: {error}"))
    }
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let text = error.to_string().into();
        match error {
            sqlx::Error::PoolTimedOut => Self::Busy,
            // I/O errors of the connection to a PostgreSQL server.
            sqlx::Error::Io(_) | sqlx::Error::Tls(_) | sqlx::Error::Protocol(_) => Self::Away,
            sqlx::Error::Decode(_) | sqlx::Error::ColumnDecode { .. } => Self::Broken(text),
            _ => Self::Database(text),
        }
    }
}
