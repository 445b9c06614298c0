//! `swarmbench leaderboard` and `swarmbench cross-play`

use std::path::Path;

use swarmbench_commands::boards;
use swarmbench_commands::options::{ServerArgs, rules};
use swarmbench_commands::play::task;
use swarmbench_engine::TaskName;

use super::options::{Source, open_database};
use super::output;
use crate::standings::Standings;
use crate::store::Location;
use swarmbench_boards::collection::Question;
use swarmbench_boards::cross_play::pairs;
use swarmbench_boards::page;
use swarmbench_protocol::table::Table as _;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Scores are means over the seeds ± population standard deviation; the total is the sum of the means. \
    docs/evaluate/boards.md says how everything is computed.\n\nExamples:\n  \
    swarmbench leaderboard                             (the standard suite, on a server on this machine)\n  \
    swarmbench leaderboard --suite quick --task Pursuit --db swarmbench.db\n  \
    swarmbench leaderboard --csv > board.csv"
)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub(super) struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// The suite: its name, or name@digest where several suites have that name (standard).
    #[arg(long)]
    suite: Option<String>,
    /// The rule set: paper or reference (paper).
    #[arg(long, value_parser = rules)]
    rules: Option<String>,
    /// Show only this task.
    #[arg(long)]
    task: Option<String>,
    /// The score to rank by: `total`, or a task for the mean of that task (total).
    #[arg(long)]
    sort: Option<String>,
    /// The run that a player's row shows: its best, its last, or the mean of all (best).
    #[arg(long)]
    pick: Option<String>,
    /// Hide the results of the paper.
    #[arg(long)]
    no_reference: bool,
    /// Hide the results of people.
    #[arg(long)]
    no_people: bool,
    /// Also show imported games, which this server cannot verify.
    #[arg(long)]
    imported: bool,
    /// Print CSV, with all columns.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print JSON, in the shape of the API.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  swarmbench cross-play --task Foraging --csv > cross-play.csv")]
pub(super) struct CrossPlayArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Count only games of this task.
    #[arg(long, value_parser = task)]
    task: Option<TaskName>,
    /// Count only games of this rule set: paper or reference.
    #[arg(long, value_parser = rules)]
    rules: Option<String>,
    /// Print CSV.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print JSON, in the shape of the API.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct SourceArgs {
    #[command(flatten)]
    server: ServerArgs,
    /// A database to read instead of a server, which no server may be using: a file, or `postgres://USER@HOST/DATABASE`.
    #[arg(long)]
    db: Option<Location>,
}

impl SourceArgs {
    async fn open(self) -> anyhow::Result<Source> {
        let Some(db) = self.db else { return Ok(Source::Server(self.server.client().await?)) };
        anyhow::ensure!(db.file().is_none_or(Path::is_file), "there is no database {db}");
        Ok(Source::Database(open_database(&db, "name it with --server instead").await?))
    }
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args {
        source,
        suite,
        rules,
        task,
        sort,
        pick,
        no_reference,
        no_people,
        imported,
        csv,
        json,
    } = args;
    let question = Question { suite, rules, task, sort, pick, no_reference, no_people, imported };
    let board = match source.open().await? {
        Source::Server(client) => client.leaderboard(&question).await?,
        Source::Database(store) => {
            let boards = Standings::new(store.clone()).boards().await?;
            let ranked = boards.ranked(&question);
            store.close().await;
            page::leaderboard(&ranked?, 0, usize::MAX)
        }
    };
    if csv {
        output::data(&board.csv());
    } else if json {
        output::json(&board)?;
    } else {
        boards::show(&board);
    }
    Ok(())
}

pub(super) async fn run_cross_play(args: CrossPlayArgs) -> anyhow::Result<()> {
    let CrossPlayArgs { source, task, rules, csv, json } = args;
    let found = match source.open().await? {
        Source::Server(client) => {
            client.cross_play(task.map(TaskName::name), rules.as_deref()).await?
        }
        Source::Database(store) => {
            let games = Standings::new(store.clone()).mixed().await?;
            store.close().await;
            let selected = games.values().filter(|game| {
                task.is_none_or(|task| game.setting.task == task)
                    && rules.as_ref().is_none_or(|rules| game.setting.rules == *rules)
            });
            page::cross_play(&pairs(selected.map(|game| &**game)), 0, usize::MAX)
        }
    };
    if csv {
        output::data(&found.csv());
    } else if json {
        output::json(&found)?;
    } else {
        boards::show_cross_play(&found);
    }
    Ok(())
}
