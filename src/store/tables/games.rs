//! Games of runs.

use std::collections::BTreeMap;
use std::sync::Arc;

use jiff::Timestamp;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use swarmbench_boards::{EndedGame, Slot};
use swarmbench_journal::Tally;

use crate::ids::{EpisodeId, EpisodeKey, RunKey};
use crate::store::runs::void_reason;
use crate::store::sql::{Builder, FromRow, LISTED_AT_ONCE, SqlRow, get};
use crate::store::{Store, StoreError};

/// Size of the cache for games of ended runs: reading a row costs far more than copying it.
const GAMES_BYTES_MAX: u64 = 32 * 1024 * 1024;

/// Estimated bytes of a game's id, reasons and counts.
const TEXTS_BYTES: usize = 128;

#[derive(Clone, Debug)]
pub struct StoredGame {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// Index in the run's plan.
    pub slot: u32,
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: String,
    pub reason: Option<String>,
    /// Score so far.
    pub score: f64,
    pub rounds: u32,
    /// Counts of acts; all 0 before the end.
    pub tally: Tally,
    pub void_reason: Option<String>,
    pub ended_at: Option<Timestamp>,
}

impl StoredGame {
    /// Converts the game for boards; `None` if the plan has no such slot.
    pub fn in_plan(&self, plan: &[Slot]) -> Option<EndedGame> {
        Some(EndedGame {
            slot: *plan.get(self.slot as usize)?,
            score: self.score,
            tally: self.tally,
            voided: !self.counts(),
        })
    }

    /// False for voided games.
    pub const fn counts(&self) -> bool {
        self.void_reason.is_none()
    }

    pub const fn is_over(&self) -> bool {
        self.ended_at.is_some()
    }
}

/// Games of a run, ordered by slot and then by age.
pub type RunGames = Arc<[StoredGame]>;

/// Cache for games of ended runs, which change only when an episode is voided.
#[derive(Debug)]
pub(in crate::store) struct EndedGames(Cache<RunKey, CachedGames, ByBytes>);

#[derive(Clone, Debug)]
struct CachedGames {
    /// Number of voided episodes before the games were read.
    voided: u64,
    games: RunGames,
}

#[derive(Clone, Debug)]
struct ByBytes;

impl Weighter<RunKey, CachedGames> for ByBytes {
    fn weight(&self, _: &RunKey, cached: &CachedGames) -> u64 {
        ((cached.games.len() + 1) * (size_of::<StoredGame>() + TEXTS_BYTES)) as u64
    }
}

impl EndedGames {
    pub(in crate::store) fn new() -> Self {
        Self(Cache::with_weighter(10_000, GAMES_BYTES_MAX, ByBytes))
    }

    /// Cached games of a run, if no episode was voided since.
    fn get(&self, run: RunKey, voided: u64) -> Option<RunGames> {
        self.0.get(&run).filter(|cached| cached.voided == voided).map(|cached| cached.games)
    }
}

impl Store {
    /// All games ever opened by a run, ordered by slot and then by age.
    pub async fn games_of(&self, run: RunKey) -> Result<Vec<StoredGame>, StoreError> {
        let mut all = BTreeMap::new();
        self.add_games(&[run], &mut all).await?;
        Ok(all.remove(&run).unwrap_or_default())
    }

    /// [`Store::games_of`] for several runs; runs without games are left out. Games of ended runs are cached.
    pub async fn games_of_all(
        &self,
        runs: &[RunKey],
    ) -> Result<BTreeMap<RunKey, RunGames>, StoreError> {
        // Read first: an episode voided meanwhile invalidates the cached games.
        let voided = self.writer().changes().voided();
        let mut all = BTreeMap::new();
        let mut missing = Vec::new();
        for &run in runs {
            match self.ended_games.get(run, voided) {
                Some(games) => drop(all.insert(run, games)),
                None => missing.push(run),
            }
        }
        for some in missing.chunks(LISTED_AT_ONCE) {
            let mut read = BTreeMap::new();
            let ended = self.ended_of(some).await?;
            self.add_games(some, &mut read).await?;
            for (run, games) in read {
                let games = RunGames::from(games);
                // A run may end while one of its games is being played.
                if ended.binary_search(&run).is_ok() && games.iter().all(StoredGame::is_over) {
                    let cached = CachedGames { voided, games: Arc::clone(&games) };
                    self.ended_games.0.insert(run, cached);
                }
                all.insert(run, games);
            }
        }
        Ok(all)
    }

    /// The ended ones among some runs, in order.
    async fn ended_of(&self, runs: &[RunKey]) -> Result<Vec<RunKey>, StoreError> {
        let mut query = Builder::new("SELECT key FROM runs WHERE ended_at IS NOT NULL AND key IN ");
        query.push_list(runs.iter().map(|run| run.0));
        query.push(" ORDER BY key");
        self.fetch_all(query.build()).await
    }

    async fn add_games(
        &self,
        runs: &[RunKey],
        all: &mut BTreeMap<RunKey, Vec<StoredGame>>,
    ) -> Result<(), StoreError> {
        let mut query = Builder::new(
            "SELECT e.run, e.key, e.id, e.slot, e.status, e.reason, e.ended_at, e.voided_at, e.void_reason,
                    coalesce(r.score, (SELECT score FROM rounds WHERE episode = e.key
                                       ORDER BY round DESC LIMIT 1), 0.0) AS score,
                    coalesce(r.rounds, (SELECT max(round) + 1 FROM rounds WHERE episode = e.key), 0)
                        AS rounds,
                    r.acts, r.invalid, r.clock_outs, r.prompt_tokens, r.completion_tokens, r.failures,
                    r.usage
             FROM episodes e LEFT JOIN results r ON r.episode = e.key WHERE e.run IN ",
        );
        query.push_list(runs.iter().map(|run| run.0));
        query.push(" ORDER BY e.run, e.slot NULLS FIRST, e.key");
        for (run, game) in self.fetch_all::<(RunKey, StoredGame)>(query.build()).await? {
            all.entry(run).or_default().push(game);
        }
        Ok(())
    }
}

impl FromRow for (RunKey, StoredGame) {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let has_result = get::<Option<u64>>(row, "acts")?.is_some();
        let game = StoredGame {
            episode: get(row, "key")?,
            id: get(row, "id")?,
            slot: get(row, "slot")?,
            status: get(row, "status")?,
            reason: get(row, "reason")?,
            score: get(row, "score")?,
            rounds: get(row, "rounds")?,
            tally: if has_result { Tally::from_row(row)? } else { Tally::default() },
            void_reason: void_reason(row)?,
            ended_at: get(row, "ended_at")?,
        };
        Ok((get(row, "run")?, game))
    }
}
