//! Options that several commands share, and what they open.

use anyhow::Context;

use swarmbench_engine::RuleSet;

use crate::store::{Location, OpenError, Store};
use swarmbench_client::client::Client;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct ServerArgs {
    /// The address of the server.
    #[arg(long, global = true, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    pub(super) server: String,
    /// Your key, if the server requires one.
    #[arg(long, global = true, env = "SWARMBENCH_KEY", hide_env_values = true)]
    pub(super) key: Option<String>,
}

impl ServerArgs {
    pub(super) async fn client(self) -> anyhow::Result<Client> {
        client(&self.server, self.key).await
    }
}

/// A client of a server that answers: a dead one is noticed before long requests.
pub(super) async fn client(server: &str, key: Option<String>) -> anyhow::Result<Client> {
    let client = Client::new(server)?;
    client.health().await?;
    Ok(match key {
        Some(key) => client.with_key(key),
        None => client,
    })
}

/// Wire name of a rule set.
pub(super) fn rules(name: &str) -> Result<String, String> {
    let names = RuleSet::ALL.map(RuleSet::name).join(", ");
    let found = RuleSet::find(name).map(|rules| rules.name().to_owned());
    found.ok_or_else(|| format!("the rule sets are {names}"))
}

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
