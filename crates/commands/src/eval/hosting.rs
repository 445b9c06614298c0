//! The server of an evaluation.

use futures::future::{BoxFuture, LocalBoxFuture};
use swarmbench_client::client::Client;
use tokio_util::sync::CancellationToken;

/// A client of a server, and the server if it is the command's own.
pub type Opened = (Client, Option<Box<dyn Hosted>>);

/// A server as the command line names it: one that runs already, or one that the command starts.
pub trait Hosting: Send + Sync {
    /// The number of games that are open at a time, if it is said.
    fn parallel(&self) -> Option<u32>;

    /// Options by which other commands reach the same server or database.
    fn place(&self) -> String;

    /// Requires a running server and an entrant's key for an attempt in a competition.
    fn check_attempt(&self) -> anyhow::Result<()>;

    /// Opens the server. `stop` is cancelled when a server of this command cannot acknowledge anything any more.
    fn open<'h>(
        &'h self,
        stop: &'h CancellationToken,
    ) -> LocalBoxFuture<'h, anyhow::Result<Opened>>;
}

/// A server that the command runs.
pub trait Hosted: Send + Sync {
    /// Stops the server. Fails if it could not store everything.
    fn close(self: Box<Self>) -> BoxFuture<'static, anyhow::Result<()>>;
}
