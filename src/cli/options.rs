//! Sources of a command's data.

use anyhow::Context;
use swarmbench_client::client::Client;

use crate::store::{Location, OpenError, Store};

/// Source of a command's data: a running server, or a database that no server uses.
pub(super) enum Source {
    Server(Client),
    Database(Store),
}

/// Opens a database. If a server uses it, the error says `what_to_do`.
pub(super) async fn open_database(
    db: &Location,
    what_to_do: &'static str,
) -> anyhow::Result<Store> {
    match Store::open(db).await {
        Err(error @ OpenError::InUse(_)) => {
            Err(error).context(format!("a server runs on this database: {what_to_do}"))
        }
        opened => Ok(opened?),
    }
}
