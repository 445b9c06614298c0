//! `swarmbench mcp`

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::time::Duration;

use anyhow::bail;
use futures::future::BoxFuture;
use swarmbench_client::client::{Client, ClientError};
use swarmbench_mcp::{Refusal, SeatAccess, serve};
use swarmbench_protocol::act::{ActRequest, Receipt};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "An assistant starts this command itself: the assistant's configuration names the command, with the seat's \
    token in SWARMBENCH_TOKEN. The tools are `look` and `act`; docs/play/mcp.md has configurations for some \
    assistants.\n\nFor Claude Code:\n\n  \
    claude mcp add --env SWARMBENCH_TOKEN=seat_… --transport stdio swarmbench \\\n         \
    -- swarmbench mcp --server http://127.0.0.1:8080\n\nAn \
    assistant that speaks HTTP needs no command: the server has the same tools at /mcp."
)]
pub struct Args {
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// The token of the seat.
    #[arg(long, env = "SWARMBENCH_TOKEN", hide_env_values = true, hide = true)]
    token: Option<String>,
}

pub async fn run(args: Args) -> anyhow::Result<()> {
    if std::io::stdin().is_terminal() {
        bail!(
            "this command is started by an assistant, and talks to it over standard input and output; \
             `swarmbench mcp --help` shows how an assistant is set up"
        );
    }
    let client = Client::new(&args.server)?;
    if args.token.is_none() {
        note!("{NO_TOKEN}");
    }
    serve(Arc::new(RemoteSeat { client, token: args.token })).await?;
    Ok(())
}

/// Message to an assistant that was set up without a token.
const NO_TOKEN: &str = "no seat token: put the token of one agent (seat_…) into the environment of `swarmbench mcp` as \
    SWARMBENCH_TOKEN, and start the assistant again";

/// A seat on a remote server.
struct RemoteSeat {
    client: Client,
    token: Option<String>,
}

impl RemoteSeat {
    fn token(&self) -> Result<&str, Refusal> {
        self.token.as_deref().ok_or_else(|| Refusal::NoAnswer(NO_TOKEN.to_owned()))
    }
}

impl SeatAccess for RemoteSeat {
    fn obs(
        &self,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> BoxFuture<'_, Result<Vec<u8>, Refusal>> {
        Box::pin(async move {
            self.client.obs(self.token()?, after, wait, prompt).await.map_err(refusal)
        })
    }

    fn act(&self, act: ActRequest) -> BoxFuture<'_, Result<Receipt, Refusal>> {
        Box::pin(async move { self.client.act(self.token()?, &act).await.map_err(refusal) })
    }
}

fn refusal(error: ClientError) -> Refusal {
    match error {
        ClientError::Refused { problem, .. } => Refusal::Problem(problem),
        error => Refusal::NoAnswer(error.to_string()),
    }
}
