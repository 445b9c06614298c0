//! `swarmbench audit`

use super::options::ServerArgs;
use super::output::{self, table};
use super::pages::{Page, pages};
use swarmbench_protocol::competition::AuditEntry;

/// Maximum entries that the server sends in one page.
const PAGE_ENTRIES_MAX: usize = 1000;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The server requires an organizer's key: put the key into SWARMBENCH_KEY. Every entry was stored in the same \
    transaction as the change that it describes. The actor `local` is a user of the server's machine who ran `swarmbench key`."
)]
pub struct Args {
    #[command(flatten)]
    server: ServerArgs,
    /// The maximum number of entries. The newest come first.
    #[arg(long, default_value_t = 50)]
    limit: usize,
    /// Print JSON Lines, one entry per line in the shape of the API.
    #[arg(long)]
    json: bool,
}

pub async fn run(args: Args) -> anyhow::Result<()> {
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
