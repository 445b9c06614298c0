//! Options that several commands share.

use swarmbench_client::client::Client;
use swarmbench_engine::RuleSet;

#[derive(Clone, Debug, clap::Args)]
pub struct ServerArgs {
    /// The address of the server.
    #[arg(long, global = true, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    pub server: String,
    /// Your key, if the server requires one.
    #[arg(long, global = true, env = "SWARMBENCH_KEY", hide_env_values = true)]
    pub key: Option<String>,
}

impl ServerArgs {
    pub async fn client(self) -> anyhow::Result<Client> {
        client(&self.server, self.key).await
    }
}

/// A client of a server that answers: a dead one is noticed before long requests.
pub async fn client(server: &str, key: Option<String>) -> anyhow::Result<Client> {
    let client = Client::new(server)?;
    client.health().await?;
    Ok(match key {
        Some(key) => client.with_key(key),
        None => client,
    })
}

/// Wire name of a rule set.
pub fn rules(name: &str) -> Result<String, String> {
    let names = RuleSet::ALL.map(RuleSet::name).join(", ");
    let found = RuleSet::find(name).map(|rules| rules.name().to_owned());
    found.ok_or_else(|| format!("the rule sets are {names}"))
}
