//! `swarmbench healthcheck`

use super::output;
use swarmbench_client::client::Client;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// Print JSON, in the shape of the API.
    #[arg(long)]
    json: bool,
}

pub async fn run(args: Args) -> anyhow::Result<()> {
    let health = Client::new(&args.server)?.health().await?;
    if args.json {
        return output::json(&health);
    }
    out!("ok");
    Ok(())
}
