//! `swarmbench key`

use anyhow::{anyhow, bail};
use jiff::{Span, SpanRelativeTo, Timestamp};
use serde_json::json;

use super::options::{Source, open_database};
use super::output::{self, cell, table};
use crate::keys::{Key, KeyRow, Role};
use crate::store::Location;
use crate::store::entries::{AuditRow, Entry};
use swarmbench_clock::{Clock, SystemClock, SystemEntropy};
use swarmbench_commands::options::client;
use swarmbench_commands::pages::Page;
use swarmbench_protocol::key::{CreatedKey, KeyRequest};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "A server without keys is open to every program on its machine. Once a key exists, creating \
    episodes requires one: `Authorization: Bearer secret_…`, or SWARMBENCH_KEY for the commands \
    of this program. Revoking all keys does not open the server again.\n\n\
    Examples:\n  \
    swarmbench key create --name alice --role organizer       (the server is stopped)\n  \
    swarmbench key create --name 'team blue' --expires 30d --server http://127.0.0.1:8080\n  \
    swarmbench key list\n  \
    swarmbench key revoke key_0198f2c55cf77c3e8f1be8a0c1a2b3c4"
)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Create a key. The key is shown only once.
    Create {
        /// The name of the holder.
        #[arg(long)]
        name: String,
        /// The role of the holder.
        #[arg(long, value_enum, default_value = "member")]
        role: Role,
        /// The expiry: a time such as 2027-01-31T12:00:00Z, or a span such as 30d. Default: the key never expires.
        #[arg(long, value_parser = expiry)]
        expires: Option<Timestamp>,
        #[command(flatten)]
        keys: KeyStore,
    },
    /// List all keys, revoked and expired ones included.
    List {
        #[command(flatten)]
        keys: KeyStore,
    },
    /// Revoke a key. A revoked key is no longer accepted; episodes that were created with it continue.
    Revoke {
        /// The key's id, from `swarmbench key list`.
        id: String,
        #[command(flatten)]
        keys: KeyStore,
    },
}

/// Store of the keys: a database that no server uses, or a running server.
#[derive(Debug, clap::Args)]
struct KeyStore {
    /// The database, which no server may be using: a file, or `postgres://USER@HOST/DATABASE`.
    #[arg(long, env = "SWARMBENCH_DB", hide_env_values = true, default_value = "swarmbench.db")]
    db: Location,
    /// The address of a running server, which requires an organizer's key.
    #[arg(long)]
    server: Option<String>,
    /// An organizer's key, for `--server`.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// Print JSON, in the shape of the API.
    #[arg(long)]
    json: bool,
}

fn expiry(text: &str) -> Result<Timestamp, String> {
    let now = SystemClock.now();
    let at = text.parse::<Timestamp>().or_else(|_| {
        let span: Span = text.parse()?;
        now.checked_add(span.to_duration(SpanRelativeTo::days_are_24_hours())?)
    });
    match at {
        Ok(at) if at > now => Ok(at),
        Ok(_) => Err("it must be in the future".to_owned()),
        Err(_) => {
            Err("a time such as 2027-01-31T12:00:00Z, or a span such as 30d or 12h".to_owned())
        }
    }
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    match args.command {
        Command::Create { name, role, expires, keys } => {
            let as_json = keys.json;
            let (key, secret) = match keys.open().await? {
                Source::Server(client) => {
                    let role = Some(role.name().to_owned());
                    let created = client
                        .create_key(&KeyRequest { name, role, expires_at: expires.map(Into::into) })
                        .await?;
                    (created.key, created.secret)
                }
                Source::Database(store) => {
                    let now = SystemClock.now();
                    let (key, token) = Key::new(role, &name, expires, now, &SystemEntropy)
                        .map_err(|problem| anyhow!("the name {problem}"))?;
                    let shown = key.summary(now);
                    let detail = json!({ "name": key.name, "role": key.role.name() });
                    let audit_entry = audit_entry("key.create", &key.id, detail);
                    let row = KeyRow { key, hash: token.hash(), acts_for: None };
                    store.keep(vec![Entry::AddKey(Box::new(row)), audit_entry]).await?;
                    store.close().await;
                    (shown, token.reveal().to_owned())
                }
            };
            if as_json {
                return output::json(&CreatedKey { key, secret });
            }
            out!("{secret}");
            note!(
                "\nThis is the key of {:?} ({}, {}). It cannot be shown again: keep it safe, and send it as\n  \
                 Authorization: Bearer {}…\nThe commands of this program read it from the environment variable SWARMBENCH_KEY.",
                key.name,
                key.role,
                key.id,
                secret.chars().take(10).collect::<String>()
            );
        }
        Command::List { keys } => {
            let as_json = keys.json;
            let keys = match keys.open().await? {
                Source::Server(client) => client.keys().await?.items,
                Source::Database(store) => {
                    let now = SystemClock.now();
                    let keys = store.keys().await?;
                    store.close().await;
                    keys.iter().map(|key| key.summary(now)).collect::<Vec<_>>()
                }
            };
            if as_json {
                return output::json(&Page::of(keys));
            }
            let mut table =
                table(&["id", "name", "role", "state", "created", "expires", "revoked"]);
            for key in &keys {
                table.add_row([
                    key.id.clone(),
                    key.name.clone(),
                    key.role.clone(),
                    key.state.clone(),
                    key.created_at.to_string(),
                    cell(key.expires_at),
                    cell(key.revoked_at),
                ]);
            }
            out!("{table}");
        }
        Command::Revoke { id, keys } => {
            let as_json = keys.json;
            let key = match keys.open().await? {
                Source::Server(client) => client.revoke_key(&id).await?,
                Source::Database(store) => {
                    let now = SystemClock.now();
                    let find = async || {
                        let keys = store.keys().await?;
                        keys.into_iter().find(|key| key.id == id).ok_or_else(|| {
                            anyhow!("there is no key {id}; `swarmbench key list` shows all")
                        })
                    };
                    if find().await?.revoked_at.is_none() {
                        let revoke = Entry::RevokeKey { id: id.clone(), at: now };
                        store.keep(vec![revoke, audit_entry("key.revoke", &id, json!({}))]).await?;
                    }
                    let key = find().await?;
                    store.close().await;
                    key.summary(now)
                }
            };
            if as_json {
                return output::json(&key);
            }
            out!("{} ({:?}) is revoked.", key.id, key.name);
        }
    }
    Ok(())
}

/// An audit entry for a change on the server's own machine.
fn audit_entry(action: &'static str, subject: &str, detail: serde_json::Value) -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: SystemClock.now(),
        who: "local".to_owned(),
        action,
        subject: subject.to_owned(),
        detail,
        shown: None,
    }))
}

impl KeyStore {
    async fn open(self) -> anyhow::Result<Source> {
        let Self { db, server, key, json: _ } = self;
        if let Some(server) = server {
            let Some(key) = key else {
                bail!("a running server asks for an organizer's key: put it into SWARMBENCH_KEY");
            };
            return Ok(Source::Server(client(&server, Some(key)).await?));
        }
        let what_to_do = "name it with --server http://…, and put an organizer's key into SWARMBENCH_KEY; the first key \
            of a database is made while its server is stopped";
        Ok(Source::Database(open_database(&db, what_to_do).await?))
    }
}
