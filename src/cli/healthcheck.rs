//! `swarmbench healthcheck`

use swarmbench_client::client::Client;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    Client::new(&args.server)?.health().await?;
    out!("ok");
    Ok(())
}
