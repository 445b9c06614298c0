//! `swarmbench board`

use anyhow::Context;
use indicatif::HumanCount;

use super::output::{self, progress_bar, set};
use crate::store::rebuild::{RebuildError, Rebuilt, rebuild, rebuild_metrics};
use crate::store::{Location, OpenError};

#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Drop the results that boards show, rebuild them from the journals, and measure all games again.
    #[command(
        after_help = "The server has to be stopped. Either all results are rebuilt or none is changed. With --replay \
        the command also replays every episode of the boards, and compares every hash, digest, act and score, which \
        takes longer. Then it replays and measures every game that has ended (docs/evaluate/metrics.md). Ctrl-C \
        ends the measuring early: games that were not measured keep their metrics."
    )]
    Rebuild {
        /// The database, which no server may be using: a file, or `postgres://USER@HOST/DATABASE`.
        #[arg(
            long,
            env = "SWARMBENCH_DB",
            hide_env_values = true,
            default_value = "swarmbench.db"
        )]
        db: Location,
        /// Also replay every episode.
        #[arg(long)]
        replay: bool,
        /// Measure no games: metrics stay as they are.
        #[arg(long)]
        no_metrics: bool,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

pub(super) async fn run(command: Command) -> anyhow::Result<()> {
    let Command::Rebuild { db, replay, no_metrics, json } = command;
    let bar = progress_bar("{bar:30} episode {pos} of {len}, {eta} left");
    let rebuilt = rebuild(&db, replay, |done, of| set(&bar, done, of)).await;
    bar.finish_and_clear();
    let Rebuilt { rows, differing } = match rebuilt {
        Err(error @ RebuildError::Open(OpenError::InUse(_))) => {
            return Err(error).context("a server runs on this database: stop it first");
        }
        other => other?,
    };
    let measured = if no_metrics {
        None
    } else {
        let bar = progress_bar("{bar:30} game {pos} of {len} measured, {eta} left");
        let measured = rebuild_metrics(&db, |done, of| set(&bar, done, of)).await;
        bar.finish_and_clear();
        Some(measured?)
    };
    if json {
        return output::json(&serde_json::json!({
            "database": db.to_string(), "replayed": replay, "results": rows, "changed": differing, "measured": measured,
        }));
    }
    let how = if replay { "rebuilt from replayed journals" } else { "rebuilt from the journals" };
    out!("{db}: {} results {how}", HumanCount(rows));
    match differing {
        0 => out!("None has changed."),
        _ => out!("{} have changed: boards may show other numbers.", HumanCount(differing)),
    }
    if let Some(measured) = measured {
        out!("{} games were measured.", HumanCount(measured));
    }
    Ok(())
}
