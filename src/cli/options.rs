//! Options that several commands share, and what they open.

use std::path::Path;

use anyhow::Context;

use crate::store::{OpenError, Store};
use swarmbench_client::client::Client;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct ServerArgs {
    /// The address of the server.
    #[arg(long, global = true, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    pub(super) server: String,
    /// Your key, if the server asks for one.
    #[arg(long, global = true, env = "SWARMBENCH_KEY", hide_env_values = true)]
    pub(super) key: Option<String>,
}

impl ServerArgs {
    pub(super) fn client(self) -> anyhow::Result<Client> {
        client(&self.server, self.key)
    }
}

pub(super) fn client(server: &str, key: Option<String>) -> anyhow::Result<Client> {
    let client = Client::new(server)?;
    Ok(match key {
        Some(key) => client.with_key(key),
        None => client,
    })
}

/// Where the data of a command is: on a running server, or in a database that no server uses.
pub(super) enum Source {
    Server(Client),
    Database(Store),
}

/// Opens a database. If a server uses it, the error says `what_to_do`.
pub(super) async fn open_database(db: &Path, what_to_do: &'static str) -> anyhow::Result<Store> {
    match Store::open(db).await {
        Err(error @ OpenError::InUse(_)) => {
            Err(error).context(format!("a server runs on this database: {what_to_do}"))
        }
        opened => Ok(opened?),
    }
}
