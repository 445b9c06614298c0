//! `swarmbench audit`

use super::options::ServerArgs;
use super::output::{self, table};
use super::pages::{Page, pages};
use swarmbench_protocol::competition::AuditEntry;

/// Maximum entries that the server sends in one page.
const PAGE_ENTRIES_MAX: usize = 1000;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The server asks for an organizer's key: put it into SWARMBENCH_KEY. Every entry was stored in the same \
    transaction as the change that it describes. `local` stands for a user of the server's own machine, with `swarmbench key`."
)]
pub(super) struct Args {
    #[command(flatten)]
    server: ServerArgs,
    /// The maximum number of entries, newest first.
    #[arg(long, default_value_t = 50)]
    limit: usize,
    /// As JSON Lines, an entry a line in the shape of the API.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let client = args.server.client().await?;
    let limit = args.limit.clamp(1, PAGE_ENTRIES_MAX).to_string();
    let mut entries: Vec<AuditEntry> = Vec::new();
    let add = |page: Page<AuditEntry>| {
        entries.extend(page.items);
        page.next_cursor.filter(|_| entries.len() < args.limit)
    };
    pages(&client, "/api/v1/audit", &[("limit", &limit)], add).await?;
    entries.truncate(args.limit);
    let mut shown = table(&["when", "who", "what", "to", "detail"]);
    for entry in entries {
        if args.json {
            output::data(&(serde_json::to_string(&entry)? + "\n"));
        }
        let (at, detail) = (entry.at.to_string(), entry.detail.to_string());
        shown.add_row([at, entry.who, entry.action, entry.subject, detail]);
    }
    if !args.json {
        out!("{shown}");
    }
    Ok(())
}
