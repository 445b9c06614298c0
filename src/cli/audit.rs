//! `swarmbench audit`

use super::play::table;
use crate::players::client::Client;
use crate::wire::competition::AuditLog;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The server asks for an organizer's key: put it into SWARMBENCH_KEY. Every line was kept in the same \
    transaction as what it tells of. `local` is whoever worked on the server's own machine, with `swarmbench key`."
)]
pub(super) struct Args {
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// An organizer's key.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// The maximum number of entries, newest first.
    #[arg(long, default_value_t = 50)]
    limit: usize,
    /// As JSON Lines.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let mut client = Client::new(&args.server)?;
    if let Some(key) = args.key {
        client = client.with_key(key);
    }
    let mut shown = table(&["when", "who", "what", "to", "detail"]);
    let mut left = args.limit;
    let mut cursor: Option<String> = None;
    while left > 0 {
        let limit = left.min(1000).to_string();
        let mut query = vec![("limit", limit.as_str())];
        query.extend(cursor.as_deref().map(|cursor| ("cursor", cursor)));
        let page: AuditLog = client.get_with("/api/v1/audit", &query).await?;
        left -= page.items.len().min(left);
        for audit_entry in page.items {
            if args.json {
                println!("{}", serde_json::to_string(&audit_entry)?);
            }
            let (at, detail) = (audit_entry.at.to_string(), audit_entry.detail.to_string());
            shown.add_row([at, audit_entry.who, audit_entry.action, audit_entry.subject, detail]);
        }
        cursor = page.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    if !args.json {
        println!("{shown}");
    }
    Ok(())
}
