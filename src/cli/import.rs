//! `swarmbench import`

use std::path::PathBuf;

use anyhow::{Context, bail};
use indicatif::{HumanCount, ProgressBar, ProgressStyle};

use crate::clock::{Clock, SystemClock};
use crate::dataset::bounds::Bounds;
use crate::dataset::read::{Problem, Taker, read};
use crate::store::entries::Entry;
use crate::store::imports::ImportRow;
use crate::store::{OpenError, Store};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Reads what the public toolkit writes, and what `swarmbench export` writes: meta_log.json with \
    game_log_<run_id>.json and agent_log_<run_id>.json, in any number of folders (docs/evaluate/dataset.md). What is missing or \
    broken is told by its name and skipped, the rest is imported. The same data again changes nothing. Imported games \
    are unverified: they are shown as they were recorded, at /api/v1/imports of a server on this database.\n\n\
    Examples:\n  swarmbench import experiment_v01 --db swarmbench.db\n  swarmbench import games.zip"
)]
pub(super) struct Args {
    /// The folder, or the zip archive.
    from: PathBuf,
    /// The database file, while no server uses it.
    #[arg(long, env = "SWARMBENCH_DB", default_value = "swarmbench.db")]
    db: PathBuf,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let store = match Store::open(&args.db).await {
        Ok(store) => store,
        Err(error @ OpenError::InUse(_)) => {
            return Err(error).context("a server runs on this database: stop it for the import");
        }
        Err(error) => return Err(error.into()),
    };
    let keeper = Keeper::new(store.clone());
    let from = args.from.clone();
    let work = move || {
        let mut keeper = keeper;
        let result = read(&from, &Bounds::default(), &mut keeper);
        keeper.bar.finish_and_clear();
        (keeper, result)
    };
    let (keeper, result) = tokio::task::spawn_blocking(work).await?;
    let Keeper { added, completed, known, acts, problems, .. } = keeper;
    store.close().await;
    for Problem { file, problem } in &problems {
        eprintln!("skipped: {file}: {problem}");
    }
    println!(
        "{}: {} games imported with {} acts, {} completed, {} were there already; {} problems",
        args.from.display(),
        HumanCount(added),
        HumanCount(acts),
        HumanCount(completed),
        HumanCount(known),
        HumanCount(problems.len() as u64),
    );
    result?;
    if added + completed + known == 0 {
        bail!("{} holds no game that can be read", args.from.display());
    }
    Ok(())
}

/// Keeps games, and counts.
struct Keeper {
    store: Store,
    runtime: tokio::runtime::Handle,
    bar: ProgressBar,
    added: u64,
    completed: u64,
    known: u64,
    acts: u64,
    problems: Vec<Problem>,
}

impl Keeper {
    fn new(store: Store) -> Self {
        let style = "{bar:30} {pos} of {len} games, {elapsed}";
        let style = ProgressStyle::with_template(style).expect("a valid template");
        Self {
            store,
            runtime: tokio::runtime::Handle::current(),
            bar: ProgressBar::new(0).with_style(style),
            added: 0,
            completed: 0,
            known: 0,
            acts: 0,
            problems: Vec::new(),
        }
    }
}

impl Taker for Keeper {
    fn game(&mut self, game: ImportRow) -> anyhow::Result<()> {
        let found = self.runtime.block_on(self.store.find_import(&game.id))?;
        match found {
            Some(found) if found.acts > 0 || game.acts == 0 => {
                self.known += 1;
                return Ok(());
            }
            Some(_) => self.completed += 1,
            None => self.added += 1,
        }
        self.acts += game.acts;
        let entry = Entry::Import { game: Box::new(game), at: SystemClock.now() };
        // One after the other: only one game is in memory.
        Ok(self.runtime.block_on(self.store.keep(vec![entry]))?)
    }

    fn problem(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    fn progress(&mut self, done: u64, of: u64) {
        self.bar.set_length(of);
        self.bar.set_position(done);
    }
}
