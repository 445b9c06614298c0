//! `swarmbench-bench capacity fill`

use std::path::Path;
use std::time::Instant;

use anyhow::bail;

use swarmbench::store::{Location, Store, rebuild};
use swarmbench_terminal::{progress_bar, set};

use crate::fill::{Fill, Filled, fill};
use crate::report;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The games are played with random acts, and stored as the server stores games: every journal can be \
    verified, and boards, lists and competitions have rows. The same options make the same games.\n\nExamples:\n  \
    swarmbench-bench capacity fill --db big.db\n  \
    swarmbench-bench capacity fill --db small.db --episodes 2000\n  \
    swarmbench-bench capacity fill --db cup.db --episodes 1000 --entrants 10000 --attempts 100"
)]
pub(crate) struct Args {
    /// The database to make, which must not exist.
    #[arg(long)]
    db: Location,
    /// The number of episodes. The command makes a few more, so that all runs are complete.
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    episodes: u64,
    /// The number of entrants of an additional competition, which stays open for 30 days.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=100_000))]
    entrants: u32,
    /// The number of attempts of each of these entrants. An attempt has two games.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100))]
    attempts: u32,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { db, episodes, entrants, attempts } = args;
    if db.file().is_some_and(Path::exists) {
        bail!("{db} exists: name a file that does not");
    }
    let bar = progress_bar("{bar:30} game {human_pos} of {human_len}, {eta} left");
    let started = Instant::now();
    let filled =
        fill(&db, Fill { episodes, entrants, attempts }, |done, of| set(&bar, done, of)).await;
    bar.finish_and_clear();
    let Filled { episodes, runs, acts, competitions, organizer } = filled?;
    let bar = progress_bar("{bar:30} metrics of game {human_pos} of {human_len}, {eta} left");
    let measured = rebuild::measure_queued(&db, |done, of| set(&bar, done, of)).await;
    bar.finish_and_clear();
    measured?;
    let seconds = started.elapsed().as_secs_f64();
    let store = Store::open_to_read(&db).await?;
    let bytes = store.bytes().await?;
    store.close().await;
    report::print(&serde_json::json!({
        "database": db.to_string(), "episodes": episodes, "runs": runs, "competitions": competitions, "bytes": bytes, "acts": acts,
        "seconds": seconds, "organizer": organizer.reveal(),
    }))
}
