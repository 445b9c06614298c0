//! `swarmbench import`

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use indicatif::{HumanCount, ProgressBar};
use serde_json::json;

use super::options::open_database;
use super::output::{self, progress_bar, set};
use crate::dataset::bounds::Bounds;
use crate::dataset::read::{Problem, Skipped, Taker, read};
use crate::store::entries::Entry;
use crate::store::entries::ImportRow;
use crate::store::{Location, Store};
use swarmbench_clock::{Clock, SystemClock};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The command reads the files of the public toolkit, and those of `swarmbench export`: meta_log.json with \
    game_log_<run_id>.json and agent_log_<run_id>.json, in any number of folders (docs/evaluate/dataset.md). Missing and \
    broken files are reported and skipped, the others are imported; the exit code is then 1. Importing the same data again \
    changes nothing. Imported games are unverified: a server on this database shows them as they were recorded, at \
    /api/v1/imports.\n\n\
    Examples:\n  swarmbench import experiment_v01 --db swarmbench.db\n  swarmbench import games.zip"
)]
pub(super) struct Args {
    /// The folder, or the zip archive.
    from: PathBuf,
    /// The database, which no server may be using: a file, or `postgres://USER@HOST/DATABASE`.
    #[arg(long, env = "SWARMBENCH_DB", hide_env_values = true, default_value = "swarmbench.db")]
    db: Location,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    // Checked first, as opening would create a new database.
    std::fs::metadata(&args.from).with_context(|| {
        format!("there is no folder or archive {} to import", args.from.display())
    })?;
    let store = open_database(&args.db, "stop it for the import").await?;
    let mut importer = Importer::new(store.clone());
    let from = args.from.clone();
    let work = move || {
        let result = read(&from, &Bounds::default(), &mut importer);
        importer.bar.finish_and_clear();
        (importer, result)
    };
    let (importer, result) = tokio::task::spawn_blocking(work).await?;
    let Importer { added, completed, known, acts, problems, .. } = importer;
    store.close().await;
    let label = |skipped| match skipped {
        Skipped::Game | Skipped::File => "skipped",
        Skipped::Acts => "warning",
    };
    let count = |kind| problems.iter().filter(|problem| problem.skipped == kind).count() as u64;
    let (games, files) = (count(Skipped::Game), count(Skipped::File));
    if added + completed + known == 0
        && let Err(error) = result
    {
        return Err(error);
    }
    if args.json {
        let problems: Vec<_> = (problems.iter())
            .map(|one| json!({ "label": label(one.skipped), "file": one.file, "problem": one.problem }))
            .collect();
        output::json(&json!({
            "from": args.from, "imported": added, "acts": acts, "completed": completed, "known": known,
            "skipped_games": games, "skipped_files": files, "problems": problems,
        }))?;
    } else {
        for Problem { skipped, file, problem } in &problems {
            note!("{}: {file}: {problem}", label(*skipped));
        }
        out!(
            "{}: {} games imported with {} acts, {} completed, {} were there already; {} problems, {} games skipped",
            args.from.display(),
            HumanCount(added),
            HumanCount(acts),
            HumanCount(completed),
            HumanCount(known),
            HumanCount(problems.len() as u64),
            HumanCount(games),
        );
    }
    result?;
    if added + completed + known == 0 {
        bail!("{} has no game that can be read", args.from.display());
    }
    if games + files > 0 {
        bail!("{games} games and {files} other files were skipped; the rest is imported");
    }
    Ok(())
}

/// Stores games and counts them.
struct Importer {
    store: Store,
    runtime: tokio::runtime::Handle,
    bar: ProgressBar,
    added: u64,
    completed: u64,
    known: u64,
    acts: u64,
    problems: Vec<Problem>,
}

impl Importer {
    fn new(store: Store) -> Self {
        Self {
            store,
            runtime: tokio::runtime::Handle::current(),
            bar: progress_bar("{bar:30} {pos} of {len} games, {elapsed}"),
            added: 0,
            completed: 0,
            known: 0,
            acts: 0,
            problems: Vec::new(),
        }
    }
}

impl Taker for Importer {
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
        // Stored before the next game is read, so that only one is in memory.
        Ok(self.runtime.block_on(self.store.keep(vec![entry]))?)
    }

    fn problem(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    fn progress(&mut self, done: u64, of: u64) {
        set(&self.bar, done, of);
    }
}
