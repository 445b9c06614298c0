//! Bulk inserts of a group's acts and rounds: with arrays, a thousand rows take PostgreSQL as long as a few single ones.

use sqlx::postgres::PgArguments;
use sqlx::{Arguments as _, Row as _};

use super::group::CommitPosition;
use crate::store::entries::{ActRow, Entry, RoundRow, source_code};
use crate::store::sql::{Connection, Engine};
use swarmbench_journal::record::RawRecord;

#[derive(Default)]
struct Acts<'r> {
    episode: Vec<i64>,
    round: Vec<i32>,
    agent: Vec<i16>,
    waiting_for: Vec<i16>,
    source: Vec<i16>,
    at: Vec<i64>,
    record: Vec<&'r str>,
    brief: Vec<Option<&'r str>>,
}

#[derive(Default)]
struct Rounds<'r> {
    episode: Vec<i64>,
    round: Vec<i32>,
    digest: Vec<&'r [u8]>,
    score: Vec<f64>,
    head: Vec<&'r [u8]>,
    at: Vec<i64>,
}

/// The inserts into both tables, with parameters from `$1` on.
macro_rules! inserts {
    ($from:literal) => {
        concat!(
            "a AS (INSERT INTO acts (episode, round, agent, waiting_for, source, at, record, brief)
                   SELECT t.* FROM ",
            $from,
            "unnest($1::bigint[], $2::integer[], $3::smallint[], $4::smallint[], $5::smallint[], $6::bigint[],
                               $7::text[], $8::text[]) AS t),
             r AS (INSERT INTO rounds (episode, round, digest, score, head, at)
                   SELECT t.* FROM ",
            $from,
            "unnest($9::bigint[], $10::integer[], $11::bytea[], $12::double precision[], $13::bytea[],
                               $14::bigint[]) AS t)"
        )
    };
}

/// Inserts rows in the open transaction.
const INSERT: &str = concat!("WITH ", inserts!(""), " SELECT 1");

/// Inserts rows and counts the commit, if this server's row has the expected counter; returns 0 if nothing was written.
const APPEND: &str = concat!(
    "WITH me AS (UPDATE nodes SET committed = committed + 1 WHERE incarnation = $15 AND committed = $16 RETURNING 1), ",
    inserts!("me, "),
    " SELECT count(*) FROM me"
);

/// Inserts acts and rounds in the open transaction.
pub(in crate::store) async fn insert(
    connection: &mut Connection,
    acts: &[&ActRow],
    rounds: &[&RoundRow],
) -> Result<(), sqlx::Error> {
    if acts.is_empty() && rounds.is_empty() {
        return Ok(());
    }
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("this is the writer of PostgreSQL")
    };
    let arguments = arguments(acts, rounds).map_err(sqlx::Error::Encode)?;
    sqlx::query_with(INSERT, arguments).execute(connection).await.map(drop)
}

/// Commits acts and rounds by a single statement; false if `place` was not next.
pub(in crate::store) async fn append(
    connection: &mut Connection,
    place: CommitPosition,
    entries: impl Iterator<Item = &Entry>,
) -> Result<bool, sqlx::Error> {
    let (mut acts, mut rounds) = (Vec::new(), Vec::new());
    for entry in entries {
        match entry {
            Entry::Act(row) => acts.push(row),
            Entry::Round(row) => rounds.push(row),
            _ => unreachable!("only acts and rounds are appended"),
        }
    }
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("this is the writer of PostgreSQL")
    };
    let mut arguments = arguments(&acts, &rounds).map_err(sqlx::Error::Encode)?;
    arguments.add(place.incarnation).map_err(sqlx::Error::Encode)?;
    arguments.add(place.before).map_err(sqlx::Error::Encode)?;
    let counted = sqlx::query_with(APPEND, arguments).fetch_one(connection).await?;
    Ok(counted.try_get::<i64, _>(0)? == 1)
}

fn arguments(
    acts: &[&ActRow],
    rounds: &[&RoundRow],
) -> Result<PgArguments, sqlx::error::BoxDynError> {
    let mut of_acts = Acts::default();
    for act in acts {
        of_acts.episode.push(act.episode.0);
        of_acts.round.push(i32::try_from(act.round)?);
        of_acts.agent.push(i16::try_from(act.agent.0)?);
        of_acts.waiting_for.push(i16::try_from(act.waiting_for)?);
        of_acts.source.push(i16::from(source_code(act.source)));
        of_acts.at.push(act.at.as_millisecond());
        of_acts.record.push(act.record.as_str());
        of_acts.brief.push(act.brief.as_ref().map(RawRecord::as_str));
    }
    let mut of_rounds = Rounds::default();
    for round in rounds {
        of_rounds.episode.push(round.episode.0);
        of_rounds.round.push(i32::try_from(round.round)?);
        of_rounds.digest.push(&round.digest);
        of_rounds.score.push(round.score);
        of_rounds.head.push(&round.head.0);
        of_rounds.at.push(round.at.as_millisecond());
    }
    let mut arguments = PgArguments::default();
    arguments.add(of_acts.episode)?;
    arguments.add(of_acts.round)?;
    arguments.add(of_acts.agent)?;
    arguments.add(of_acts.waiting_for)?;
    arguments.add(of_acts.source)?;
    arguments.add(of_acts.at)?;
    arguments.add(of_acts.record)?;
    arguments.add(of_acts.brief)?;
    arguments.add(of_rounds.episode)?;
    arguments.add(of_rounds.round)?;
    arguments.add(of_rounds.digest)?;
    arguments.add(of_rounds.score)?;
    arguments.add(of_rounds.head)?;
    arguments.add(of_rounds.at)?;
    Ok(arguments)
}
