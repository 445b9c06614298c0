//! The store on both engines: what is written to SQLite and to PostgreSQL has the same outcomes, and all that reads gives the
//! same answers.
//!
//! `history` makes entries from a seed, `numbers` gives each engine its own numbers for them, and `answers` asks both stores
//! everything. The number of seeds is in `SWARMBENCH_SEEDS`, the first in `SWARMBENCH_SEED`.

mod answers;
mod history;
mod numbers;
mod schema;
mod sessions;
mod situations;
mod standby;
mod values;

use std::collections::BTreeMap;
use std::path::PathBuf;

use futures::future::join_all;
use swarmbench::store::entries::Entry;
use swarmbench::store::port::EpisodeStore as _;
use swarmbench::store::{Location, Store, StoreError};
use tempfile::TempDir;

use history::{History, Step};
use numbers::Side;
use swarmbench_testkit::dice::{number, tell};
use swarmbench_testkit::needs;
use swarmbench_testkit::postgres::{Scratch, Standby};

/// Seeds that are played where nobody says how many.
const SEEDS: u64 = 4;

/// Steps of a history, and after how many of them both stores are asked everything.
const STEPS: usize = 120;
const STEPS_BETWEEN: usize = 10;

/// A database for a test that needs PostgreSQL.
pub(crate) async fn scratch() -> Scratch {
    Scratch::new().await.expect("the tests run on PostgreSQL")
}

/// Address of a database of PostgreSQL.
pub(crate) fn location(scratch: &Scratch) -> Location {
    scratch.url().parse().expect("an address")
}

/// One store of each engine, with the same rows.
pub(crate) struct Pair {
    folder: TempDir,
    pub(crate) scratch: Scratch,
    pub(crate) sqlite: Side,
    pub(crate) postgres: Side,
}

impl Pair {
    pub(crate) async fn new() -> Self {
        Self::over(scratch().await).await
    }

    /// With this database of PostgreSQL.
    pub(crate) async fn over(scratch: Scratch) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let sqlite = Store::open(folder.path().join("a.db")).await.expect("it opens");
        let postgres = Store::open(location(&scratch)).await.expect("it opens");
        Self { folder, scratch, sqlite: Side::of(sqlite), postgres: Side::of(postgres) }
    }

    /// The file of SQLite.
    pub(crate) fn file(&self) -> PathBuf {
        self.folder.path().join("a.db")
    }

    /// Closes both stores, and opens them again.
    async fn reopen(&mut self) {
        let file = self.file();
        for (side, location) in
            [(&mut self.sqlite, file.into()), (&mut self.postgres, location(&self.scratch))]
        {
            side.store.clone().close().await;
            side.store = Store::open(location).await.expect("it opens again");
        }
    }

    pub(crate) async fn close(self) {
        self.sqlite.store.close().await;
        self.postgres.store.close().await;
    }

    /// Hands the same jobs to both, all at once; the outcomes, which are equal.
    pub(crate) async fn keep(&mut self, jobs: &[Vec<Entry>], names: &numbers::Names) -> Vec<bool> {
        let sqlite = kept(&self.sqlite, jobs).await;
        let postgres = kept(&self.postgres, jobs).await;
        for (number, (one, other)) in sqlite.iter().zip(&postgres).enumerate() {
            assert_eq!(
                kind(one),
                kind(other),
                "SQLite gives {one:?}, PostgreSQL {other:?} for {:#?}",
                jobs[number]
            );
        }
        self.sqlite.learn(names).await;
        self.postgres.learn(names).await;
        sqlite.iter().map(Result::is_ok).collect()
    }
}

async fn kept(side: &Side, jobs: &[Vec<Entry>]) -> Vec<Result<(), StoreError>> {
    let own = jobs.iter().map(|job| job.iter().map(|entry| side.own(entry)).collect());
    let pending: Vec<_> = own.map(|job: Vec<Entry>| side.store.keep(job)).collect();
    join_all(pending).await
}

/// Kind of an outcome; the words of the engines differ.
pub(crate) fn kind<T>(outcome: &Result<T, StoreError>) -> &'static str {
    match outcome {
        Ok(_) => "ok",
        Err(StoreError::Busy) => "busy",
        Err(StoreError::Away) => "away",
        Err(StoreError::Database(_)) => "refused",
        Err(StoreError::Broken(_)) => "broken",
        Err(StoreError::Missing(_)) => "missing",
        Err(StoreError::Failed) => "failed",
        Err(StoreError::Gap) => "gap",
        Err(StoreError::Stopped(_)) => "stopped",
        Err(StoreError::Elsewhere) => "elsewhere",
        Err(StoreError::NoRights) => "no rights",
    }
}

/// Says how to play a seed again, also where the store itself panics.
struct Playing(u64);

impl Drop for Playing {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let seed = self.0;
            tell(&format!(
                "again: SWARMBENCH_SEED={seed} SWARMBENCH_SEEDS=1 cargo test --test parts store::histories"
            ));
        }
    }
}

#[needs(postgres)]
#[tokio::test(flavor = "multi_thread")]
async fn histories_are_the_same_on_both_engines() {
    let first = number("SWARMBENCH_SEED").unwrap_or(0);
    let count = number("SWARMBENCH_SEEDS").unwrap_or(SEEDS);
    let mut reached = BTreeMap::new();
    for seed in first..first + count {
        let playing = Playing(seed);
        let pair = Pair::new().await;
        play(seed, pair, None, &mut reached).await;
        drop(playing);
    }
    // A single seed may leave something out.
    if count >= SEEDS {
        let missing = missing(&reached);
        assert!(missing.is_empty(), "no history has {missing:?}, only {reached:?}");
        for outcome in ["ok", "refused", "gap", "recovered", "reopened"] {
            assert!(reached.contains_key(outcome), "nothing was {outcome}");
        }
    }
    tell(&format!("{count} histories from seed {first} on: {reached:?}"));
}

/// The kinds of entries that no history has had.
fn missing(reached: &BTreeMap<&str, u64>) -> Vec<&'static str> {
    numbers::VARIANTS.iter().copied().filter(|name| !reached.contains_key(name)).collect()
}

/// Plays a history, where there is a standby with each commit while it is away.
async fn play(
    seed: u64,
    mut pair: Pair,
    standby: Option<&Standby>,
    reached: &mut BTreeMap<&'static str, u64>,
) {
    let mut history = History::new(seed);
    let mut note = |what| *reached.entry(what).or_default() += 1;
    for step in 1..=STEPS {
        match history.step() {
            Step::Jobs(jobs) => {
                let before = pair.sqlite.store.writer().changes().position();
                let keeping = pair.keep(&jobs, &history.names);
                let kept = match standby {
                    Some(standby) => standby.away(keeping).await,
                    None => keeping.await,
                };
                for (job, kept) in jobs.iter().zip(&kept) {
                    if *kept {
                        note("ok");
                        for entry in job {
                            note(numbers::variant(entry));
                        }
                    } else {
                        note("refused");
                        if job.iter().filter_map(Entry::chain).any(|key| history.is_broken(key)) {
                            note("gap");
                        }
                    }
                }
                let positions = pair.postgres.store.writer().changes().position();
                assert_eq!(pair.sqlite.store.writer().changes().position(), positions);
                answers::compare_changes(&pair, before);
                history.settle(&jobs, &kept);
                history.learn(&pair.sqlite);
            }
            Step::Recover(episode) => {
                note("recovered");
                for side in [&pair.sqlite, &pair.postgres] {
                    side.store.recovered(episode);
                }
                let stored = pair.sqlite.store.summary_of(episode).await.expect("it is read");
                history.resume(episode, stored.map(|stored| stored.rounds));
            }
            Step::Reopen => {
                note("reopened");
                pair.reopen().await;
                history.forget_refusals();
            }
        }
        for side in [&pair.sqlite, &pair.postgres] {
            assert!(!side.store.writer().has_failed(), "the writer has failed after {step} steps");
            assert_eq!(side.store.writer().backlog_jobs(), 0);
        }
        if step % STEPS_BETWEEN == 0 {
            answers::compare(&pair, &history).await;
        }
    }
    pair.close().await;
}
