//! `swarmbench board`

use std::path::PathBuf;

use anyhow::Context;
use indicatif::{HumanCount, ProgressBar, ProgressStyle};

use crate::store::OpenError;
use crate::store::rebuild::{RebuildError, Rebuilt, rebuild};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Drop the results that boards show, and rebuild them from the journals.
    #[command(
        after_help = "The server has to be stopped. Either all is made again or nothing is changed. With --replay \
        every episode of the boards is also played again, and every hash, digest, act and score is compared, which \
        takes longer."
    )]
    Rebuild {
        /// The database file, while no server uses it.
        #[arg(long, env = "SWARMBENCH_DB", default_value = "swarmbench.db")]
        db: PathBuf,
        /// Also replay every episode.
        #[arg(long)]
        replay: bool,
    },
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Command::Rebuild { db, replay } = args.command;
    let style = "{bar:30} episode {pos} of {len}, {eta} left";
    let bar = ProgressBar::new(0)
        .with_style(ProgressStyle::with_template(style).expect("a valid template"));
    let rebuilt = rebuild(&db, replay, |done, of| {
        bar.set_length(of);
        bar.set_position(done);
    })
    .await;
    bar.finish_and_clear();
    let Rebuilt { rows, differing } = match rebuilt {
        Err(error @ RebuildError::Open(OpenError::InUse(_))) => {
            return Err(error).context("a server runs on this database: stop it first");
        }
        other => other?,
    };
    let how = if replay {
        "made again from journals that were all played again"
    } else {
        "made again from the journals"
    };
    println!("{}: {} results {how}", db.display(), HumanCount(rows));
    match differing {
        0 => println!("All are as they were."),
        _ => println!(
            "{} are not as they were: boards may show other numbers now.",
            HumanCount(differing)
        ),
    }
    Ok(())
}
