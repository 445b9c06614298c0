//! Options that several commands share, and what they open.

use anyhow::{Context, bail};

use swarmbench_engine::RuleSet;

use crate::store::{Location, OpenError, Store};
use swarmbench_client::client::Client;
use swarmbench_client::llm::ApiKey;

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
    pub(super) async fn client(self) -> anyhow::Result<Client> {
        client(&self.server, self.key).await
    }
}

/// A client of a server that is alive: one that does not answer is noticed before long requests are made.
pub(super) async fn client(server: &str, key: Option<String>) -> anyhow::Result<Client> {
    let client = Client::new(server)?;
    client.health().await?;
    Ok(match key {
        Some(key) => client.with_key(key),
        None => client,
    })
}

/// The name of a rule set, as it is on the wire.
pub(super) fn rules(name: &str) -> Result<String, String> {
    let names = RuleSet::ALL.map(RuleSet::name).join(", ");
    let found = RuleSet::find(name).map(|rules| rules.name().to_owned());
    found.ok_or_else(|| format!("the rule sets are {names}"))
}

/// Where the data of a command is: on a running server, or in a database that no server uses.
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

/// The environment variable with the key of an endpoint where nobody names one.
pub(super) const KEY_VARIABLE: &str = "OPENAI_API_KEY";

/// The address of the endpoint of a model: as it was named with `option`, or in the environment.
pub(super) fn api_base(named: Option<&str>, model: &str, option: &str) -> anyhow::Result<String> {
    let environment = || std::env::var("OPENAI_BASE_URL").ok().filter(|url| !url.is_empty());
    match named.map(str::to_owned).or_else(environment) {
        Some(base) => Ok(base),
        None => bail!(
            "where is {model}? Name its endpoint with {option}, such as https://api.openai.com/v1, or \
             http://127.0.0.1:11434/v1 for a model on this machine"
        ),
    }
}

/// The key for a model, from the variable that was named with `option`, or the usual one.
pub(super) fn api_key(
    named: Option<&str>,
    usual: &str,
    model: &str,
    option: &str,
) -> anyhow::Result<ApiKey> {
    let variable = named.unwrap_or(usual);
    let value = std::env::var(variable).ok();
    if named.is_some() && value.is_none() {
        bail!(
            "the environment variable {variable} is not set: put the key for {model} into it, `export {variable}=…`, or \
             name another with {option}"
        );
    }
    Ok(ApiKey::new(variable, value))
}
