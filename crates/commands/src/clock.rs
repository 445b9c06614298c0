//! `swarmbench clock`

use jiff::SignedDuration;

use super::options::ServerArgs;
use super::output;
use swarmbench_protocol::clock::ConfirmedClock;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Look at `date -u` on the server's machine first: anything that a wrong clock reveals stays revealed. The server \
    requires an organizer's key: put the key into SWARMBENCH_KEY."
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Confirm that the clock of the server's host is right, after which the server no longer doubts its time of day.
    Confirm {
        #[command(flatten)]
        server: ServerArgs,
        /// Print JSON, in the shape of the API.
        #[arg(long)]
        json: bool,
    },
}

pub async fn run(args: Args) -> anyhow::Result<()> {
    let Command::Confirm { server, json } = args.command;
    let confirmed: ConfirmedClock =
        server.client().await?.post("/api/v1/clock/confirm", &serde_json::json!({})).await?;
    if json {
        return output::json(&confirmed);
    }
    output::text(&shown(&confirmed));
    Ok(())
}

fn shown(confirmed: &ConfirmedClock) -> String {
    let ConfirmedClock { now, moved_ms, doubt } = confirmed;
    let before = **now - SignedDuration::from_millis(*moved_ms);
    let doubt = doubt.as_deref().unwrap_or("the time of day was not in doubt");
    format!("before  {before:.3}\nnow     {now} ({moved_ms:+} ms)\ndoubt   {doubt}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_was_set_back_is_shown() {
        let now = "2026-03-01T11:00:00Z".parse::<jiff::Timestamp>().expect("a time").into();
        let doubt = Some("it has jumped".to_owned());
        let shown = shown(&ConfirmedClock { now, moved_ms: -3_600_000, doubt });
        let expected = "before  2026-03-01T12:00:00.000Z\nnow     2026-03-01T11:00:00.000Z (-3600000 ms)\ndoubt   it has jumped\n";
        assert_eq!(shown, expected);
    }
}
