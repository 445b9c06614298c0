//! `swarmbench backup`

use std::path::PathBuf;

use indicatif::{HumanBytes, HumanCount};

use super::output::{self, progress_bar, set};
use crate::store::backup::{Backup, back_up};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The server may keep running: its database is only read. An interrupted backup leaves \
    FILE.partial (and FILE.partial-journal), which the next backup to the same FILE replaces.\n\n\
    To restore: stop the server; move its database away, together with the files of the same name that end in -wal \
    and -shm; copy FILE to the database's place; start the server."
)]
pub(super) struct Args {
    /// The file to write; it must not exist.
    file: PathBuf,
    /// The database of the server.
    #[arg(long, env = "SWARMBENCH_DB", default_value = "swarmbench.db")]
    db: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let bar = progress_bar("{bar:30} {bytes} of at most {total_bytes}");
    let backup = back_up(&args.db, &args.file, |written, of| set(&bar, written, of)).await;
    bar.finish_and_clear();
    let Backup { episodes, acts, rounds, bytes } = backup?;
    if args.json {
        return output::json(&serde_json::json!({
            "file": args.file, "episodes": episodes, "acts": acts, "rounds": rounds, "bytes": bytes,
        }));
    }
    let (db, file) = (args.db.display(), args.file.display());
    out!(
        "{file}: {} episodes, {} acts, {} rounds, {}; read again and found sound",
        HumanCount(episodes),
        HumanCount(acts),
        HumanCount(rounds),
        HumanBytes(bytes),
    );
    out!(
        "To restore it: stop the server, move {db}, {db}-wal and {db}-shm away, copy {file} to {db}, start the server."
    );
    Ok(())
}
