//! `swarmbench backup`

use std::path::PathBuf;

use anyhow::bail;
use indicatif::{HumanBytes, HumanCount};

use super::output::{self, progress_bar, set};
use crate::store::Location;
use crate::store::backup::{Backup, back_up};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The server may keep running: the backup only reads its database. An interrupted backup leaves \
    FILE.partial (and FILE.partial-journal), which the next backup to the same FILE replaces.\n\n\
    To restore: stop the server; move its database away, together with the files of the same name that end in -wal \
    and -shm; copy FILE to the database's place; start the server."
)]
pub(super) struct Args {
    /// The file to write, which must not exist.
    file: PathBuf,
    /// The database of the server.
    #[arg(long, env = "SWARMBENCH_DB", hide_env_values = true, default_value = "swarmbench.db")]
    db: Location,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Some(db) = args.db.file() else {
        bail!(
            "{} is a database of PostgreSQL, which has backups of its own: pg_basebackup with an archive of the log for all of \
             the server, or pg_dump for this database (docs/operate/postgres.md)",
            args.db
        );
    };
    let bar = progress_bar("{bar:30} {bytes} of at most {total_bytes}");
    let backup = back_up(db, &args.file, |written, of| set(&bar, written, of)).await;
    bar.finish_and_clear();
    let Backup { episodes, acts, rounds, bytes } = backup?;
    if args.json {
        return output::json(&serde_json::json!({
            "file": args.file, "episodes": episodes, "acts": acts, "rounds": rounds, "bytes": bytes,
        }));
    }
    let (db, file) = (db.display(), args.file.display());
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
