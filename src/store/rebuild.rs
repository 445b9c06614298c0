//! Rebuilds the table `results` from the journals.

use futures::TryStreamExt;
use swarmbench_analysis::Options;
use swarmbench_analysis::journal::measure;

use super::metrics::{self, Measured, MetricsRow};
use super::sql::{Begin, Connection, get, query};
use super::stored_replay::{StoredJournal, read_journal, replay_stored};
use super::templates::opening;
use super::{Alone, Location, OpenError, results};
use crate::ids::EpisodeKey;
use swarmbench_journal::Tally;
use swarmbench_journal::record::{ActRecord, RawRecord, Record};

/// Episodes listed by one query.
const CHUNK: i64 = 256;

/// The rebuild failed; its transaction was rolled back.
#[derive(Debug, thiserror::Error)]
pub enum RebuildError {
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error("the database cannot be used")]
    Sqlite(#[from] sqlx::Error),
    #[error("the journal of {episode} is broken: {problem}; nothing was changed")]
    Journal {
        /// Public id.
        episode: String,
        problem: String,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rebuilt {
    pub rows: u64,
    /// Rows that are new, gone or different from before.
    pub differing: u64,
}

/// Rebuilds all results from openings, acts, rounds and ends, in one transaction and in bounded memory. `replay` also replays
/// every episode and compares all hashes, digests, acts and scores. `progress` gets the finished and the total number of
/// episodes.
pub async fn rebuild(
    location: impl Into<Location>,
    replay: bool,
    mut progress: impl FnMut(u64, u64),
) -> Result<Rebuilt, RebuildError> {
    let mut database = Alone::open(&location.into()).await?;
    let work = async |connection: &mut Connection| all(connection, replay, &mut progress).await;
    let rebuilt = database.connection.transaction(Begin::Write, work).await?;
    database.close().await?;
    Ok(rebuilt)
}

async fn all(
    database: &mut Connection,
    replay: bool,
    progress: &mut impl FnMut(u64, u64),
) -> Result<Rebuilt, RebuildError> {
    run(database, "CREATE TEMPORARY TABLE earlier AS SELECT * FROM results").await?;
    run(database, "DELETE FROM results").await?;
    let of =
        count(database, "SELECT count(*) FROM episodes WHERE status NOT IN ('waiting', 'running')")
            .await?;
    let (mut last, mut done) = (i64::MIN, 0);
    loop {
        let ended = query(
            "SELECT key, id FROM episodes WHERE key > $1 AND ended_at IS NOT NULL ORDER BY key LIMIT $2",
        )
        .bind(last)
        .bind(CHUNK)
        .fetch_all(&mut *database)
        .await?;
        if ended.is_empty() {
            break;
        }
        for row in ended {
            last = row.try_get("key")?;
            one(database, EpisodeKey(last), row.try_get("id")?, replay).await?;
            done += 1;
            progress(done, of);
        }
    }
    let rows = count(database, "SELECT count(*) FROM results").await?;
    let differing = count(
        database,
        "SELECT count(*) FROM (
             SELECT episode FROM (SELECT * FROM results EXCEPT SELECT * FROM earlier) AS made
             UNION
             SELECT episode FROM (SELECT * FROM earlier EXCEPT SELECT * FROM results) AS lost) AS differing",
    )
    .await?;
    run(database, "DROP TABLE earlier").await?;
    Ok(Rebuilt { rows, differing })
}

/// Recomputes and stores the metrics of all ended games. Each batch is a commit, so an interrupted call keeps its progress.
/// `progress` gets the finished and the total number of games.
pub async fn rebuild_metrics(
    location: impl Into<Location>,
    mut progress: impl FnMut(u64, u64),
) -> Result<u64, RebuildError> {
    let mut database = Alone::open(&location.into()).await?;
    let connection = &mut database.connection;
    let of = count(
        connection,
        "SELECT count(*) FROM episodes e WHERE ended_at IS NOT NULL AND EXISTS (
             SELECT 1 FROM rounds WHERE episode = e.key)",
    )
    .await?;
    let (mut last, mut done) = (i64::MIN, 0);
    loop {
        let ended = query(
            "SELECT key, id FROM episodes e WHERE key > $1 AND ended_at IS NOT NULL AND EXISTS (
                 SELECT 1 FROM rounds WHERE episode = e.key) ORDER BY key LIMIT $2",
        )
        .bind(last)
        .bind(CHUNK)
        .fetch_all(connection)
        .await?;
        if ended.is_empty() {
            break;
        }
        let measure_all = async |connection: &mut Connection| {
            for row in ended {
                last = row.try_get("key")?;
                let row = measured(connection, EpisodeKey(last), row.try_get("id")?).await?;
                metrics::add(connection, &row).await?;
                done += 1;
                progress(done, of);
            }
            Ok::<_, RebuildError>(())
        };
        connection.transaction(Begin::Write, measure_all).await?;
    }
    run(connection, "DELETE FROM unmeasured").await?;
    database.close().await?;
    Ok(done)
}

/// Measures queued games, as a server does in the background.
pub async fn measure_queued(
    location: impl Into<Location>,
    mut progress: impl FnMut(u64, u64),
) -> Result<u64, RebuildError> {
    let mut database = Alone::open(&location.into()).await?;
    let connection = &mut database.connection;
    let of = count(connection, "SELECT count(*) FROM unmeasured").await?;
    let mut done = 0;
    loop {
        let queued = query(
            "SELECT u.number, e.key, e.id FROM unmeasured u JOIN episodes e ON e.key = u.episode
             ORDER BY u.number LIMIT $1",
        )
        .bind(CHUNK)
        .fetch_all(connection)
        .await?;
        if queued.is_empty() {
            break;
        }
        let measure_all = async |connection: &mut Connection| {
            for row in queued {
                let episode = EpisodeKey(row.try_get("key")?);
                let measured = measured(connection, episode, row.try_get("id")?).await?;
                metrics::add(connection, &measured).await?;
                metrics::dequeue(connection, row.try_get("number")?).await?;
                done += 1;
                progress(done, of);
            }
            Ok::<_, RebuildError>(())
        };
        connection.transaction(Begin::Write, measure_all).await?;
    }
    database.close().await?;
    Ok(done)
}

/// Computes the metrics of a game from its journal.
pub(super) async fn measured(
    database: &mut Connection,
    episode: EpisodeKey,
    id: String,
) -> Result<MetricsRow, RebuildError> {
    let row = query(concat!(
        "SELECT ",
        opening!(),
        ", seating, coalesce(fork_round, 0) AS first_round FROM episodes e WHERE key = $1"
    ))
    .bind(episode.0)
    .fetch_one(&mut *database)
    .await?;
    let (opening, seating) = (get(&row, "opening")?, get(&row, "seating")?);
    let (rounds, _) = standing(database, episode).await?.unwrap_or_default();
    let first_round = get(&row, "first_round")?;
    let stored = StoredJournal { episode, opening, first_round, seating, rounds, ending: None };
    let read = |journal| {
        let measured = measure(journal, Options::all(false), |_, _| ());
        measured.map(|(_, metrics)| Measured::of(&metrics)).map_err(|fault| fault.to_string())
    };
    let measured = read_journal(database, &stored, read).await?;
    let measured = measured.map_err(|problem| RebuildError::Journal { episode: id, problem })?;
    Ok(MetricsRow::new(episode, &measured))
}

async fn run(database: &mut Connection, statement: &'static str) -> Result<(), sqlx::Error> {
    query(statement).execute(database).await.map(drop)
}

async fn count(database: &mut Connection, text: &'static str) -> Result<u64, sqlx::Error> {
    query(text).one::<i64>(database).await.map(i64::unsigned_abs)
}

/// Rebuilds the row of an episode, if it has a result.
async fn one(
    database: &mut Connection,
    episode: EpisodeKey,
    id: String,
    replay: bool,
) -> Result<(), RebuildError> {
    let broken = |problem: String| RebuildError::Journal { episode: id.clone(), problem };
    let row = query(concat!(
        "SELECT ",
        opening!(),
        ", seating, ending, head, status FROM episodes e WHERE key = $1"
    ))
    .bind(episode.0)
    .fetch_one(&mut *database)
    .await?;
    let (opening, ending) = (get::<RawRecord>(&row, "opening")?, get::<RawRecord>(&row, "ending")?);
    let seating: Option<RawRecord> = get(&row, "seating")?;
    let seed = match opening.read() {
        Ok(Record::Opening(opening)) if opening.counts() => opening.config.seed,
        Ok(Record::Opening(_)) => return Ok(()),
        Ok(Record::Seats(_) | Record::Round(_) | Record::End(_)) => {
            return Err(broken("its first record is not an opening".to_owned()));
        }
        Err(error) => return Err(broken(error.to_string())),
    };
    let end = match ending.read() {
        Ok(Record::End(end)) => end,
        Ok(Record::Opening(_) | Record::Seats(_) | Record::Round(_)) => {
            return Err(broken("its last record is not an end".to_owned()));
        }
        Err(error) => return Err(broken(error.to_string())),
    };
    let head = get(&row, "head")?;
    if end.status != row.try_get::<String>("status")? {
        return Err(broken("it ended otherwise than its journal says".to_owned()));
    }
    // A layout may have a score before the first round.
    let standing = standing(database, episode).await?.unwrap_or((0, end.score));
    if standing != (end.rounds, end.score) {
        let (rounds, score) = standing;
        let problem = format!(
            "its end says {} rounds and a score of {}, its rounds say {rounds} and {score}",
            end.rounds, end.score
        );
        return Err(broken(problem));
    }
    if replay {
        let ending = Some((ending, head));
        // Forks have no results.
        let (first_round, rounds) = (0, end.rounds);
        let stored = StoredJournal { episode, opening, first_round, seating, rounds, ending };
        replay_stored(database, &stored).await?.map_err(broken)?;
    }
    let tally = tally(database, episode).await?.map_err(broken)?;
    results::add(database, episode, seed, end.score, end.rounds, tally).await?;
    Ok(())
}

/// The number of resolved rounds and the score after them; `None` before the first.
async fn standing(
    database: &mut Connection,
    episode: EpisodeKey,
) -> Result<Option<(u32, f64)>, sqlx::Error> {
    let last = "SELECT round, score FROM rounds WHERE episode = $1 ORDER BY round DESC LIMIT 1";
    let row = query(last).bind(episode.0).fetch_optional(database).await?;
    row.map(|row| Ok((row.try_get::<u32>(0)? + 1, row.try_get(1)?))).transpose()
}

/// Tallies all acts, including those of an unresolved round.
async fn tally(
    database: &mut Connection,
    episode: EpisodeKey,
) -> Result<Result<Tally, String>, sqlx::Error> {
    let mut tally = Tally::default();
    let query = query("SELECT record FROM acts WHERE episode = $1").bind(episode.0);
    let mut acts = query.fetch(database);
    while let Some(row) = acts.try_next().await? {
        match serde_json::from_str::<ActRecord>(row.text(0)?) {
            Ok(act) => tally.add(&act),
            Err(error) => return Ok(Err(format!("an act cannot be read: {error}"))),
        }
    }
    Ok(Ok(tally))
}
