//! `swarmbench migrate`

use data_encoding::HEXLOWER;
use indicatif::{HumanCount, ProgressBar};
use serde_json::json;

use super::output::{self, progress_bar, set, style};
use crate::competitions;
use crate::store::Location;
use crate::store::copy::{Copied, CopiedTable, Step, copy};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The command copies all data of a server to a database of the other engine. (It is not needed after an update: `swarmbench \
serve` migrates the tables of an older version by itself.) FROM stays as it is, so you go back by starting the server on it.

From SQLite to PostgreSQL:
  1. stop the server, and make a backup: swarmbench backup swarmbench-before.db --db swarmbench.db
  2. createdb --encoding UTF8 --template template0 --owner swarmbench swarmbench
  3. swarmbench migrate --from swarmbench.db --to postgres://swarmbench@db.example/swarmbench
  4. swarmbench serve --db postgres://swarmbench@db.example/swarmbench
Back:
  swarmbench migrate --from postgres://swarmbench@db.example/swarmbench --to swarmbench.db

TO is an empty database, or a file that does not exist. If the command is interrupted, run it again: it continues where it \
stopped, and no server starts on an unfinished copy. To begin again instead, remove the file, or `dropdb` and `createdb` the \
database. At the end the command compares every row of both databases, and replays every journal of the copy, as `swarmbench \
verify --db TO` does. Do not start a server on FROM before the end: TO would lack what that server writes, and the comparison \
would fail.

The password of PostgreSQL comes from PGPASSWORD, from ~/.pgpass, or from a file: ?password_file=FILE after the address.")]
pub(super) struct Args {
    /// The database of the stopped server: a file, or `postgres://USER@HOST/DATABASE`.
    #[arg(long)]
    from: Location,
    /// The database that becomes the copy: an empty one of the other engine.
    #[arg(long)]
    to: Location,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { from, to, json } = args;
    let bar = progress_bar(ROWS);
    let mut part = None;
    let copied = copy(&from, &to, &competitions::FORMATS, |step| show(&bar, &mut part, step)).await;
    bar.finish_and_clear();
    let Copied { tables, checked, is_continued } = copied?;
    let rows = tables.iter().map(|table| table.rows).sum();
    if json {
        let table = |table: &CopiedTable| {
            let digest = HEXLOWER.encode(&table.digest);
            json!({ "name": table.name, "rows": table.rows, "digest": digest })
        };
        return output::json(&json!({
            "from": from.to_string(), "to": to.to_string(), "continued": is_continued, "rows": rows,
            "tables": tables.iter().map(table).collect::<Vec<_>>(),
            "episodes": checked.episodes, "rounds": checked.rounds, "sound": checked.is_sound(),
        }));
    }
    let [rows, episodes, rounds] = [rows, checked.episodes, checked.rounds].map(HumanCount);
    let continued = if is_continued { " (an interrupted copy was continued)" } else { "" };
    out!("{to}: {rows} rows in {} tables, all equal to those of {from}{continued}", tables.len());
    out!("sound: {episodes} episodes with {rounds} rounds were played again");
    out!(
        "Now start the server with --db {to}, and keep {from}, which is unchanged, until you are content."
    );
    Ok(())
}

const ROWS: &str = "{msg} {bar:30} {human_pos} of {human_len} rows, {eta} left";
const EPISODES: &str = "{bar:30} episode {pos} of {len}, {eta} left";
const SEARCH: &str = "{spinner} {msg}";

/// Shows a step. `part` is the subject of the bar, which restarts with each new part.
fn show(bar: &ProgressBar, part: &mut Option<(&'static str, &'static str)>, step: Step) {
    let (now, template, done, of) = match step {
        Step::Search(_) => (("texts that", "PostgreSQL cannot store"), SEARCH, 0, 0),
        Step::Copy { table, done, of } => (("copying", table), ROWS, done, of),
        Step::Compare { table, done, of } => (("comparing", table), ROWS, done, of),
        Step::Check { done, of } => (("", ""), EPISODES, done, of),
    };
    if part.replace(now) != Some(now) {
        bar.reset();
        bar.set_style(style(template));
        bar.set_message(format!("{} {}", now.0, now.1));
    }
    set(bar, done, of);
}
