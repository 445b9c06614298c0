//! The writer of SQLite: a group of jobs is a transaction.

use std::time::{Duration, Instant};

use super::files::Files;
use crate::store::StoreError;
use crate::store::entries::Entry;
use crate::store::sql::{Connection, Statement, query};
use crate::store::writer::{self, Blocked, Failure, Outcome, WriterState};
use crate::telemetry;

/// SQLite's own timeout for the lock of the database, after which it reports `BUSY`.
const BUSY_TIMEOUT: Duration = Duration::from_secs(1);

/// First and longest pause between attempts to begin a transaction.
const BEGIN_PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(1));

/// Primary result codes of SQLite after which the state of the file or of the transaction is unknown: `NOMEM`, `READONLY`,
/// `IOERR`, `CORRUPT`, `FULL`, `CANTOPEN`, `PROTOCOL`, `MISUSE` and `NOTADB`.
const FATAL_CODES: [u32; 9] = [7, 8, 10, 11, 13, 14, 15, 21, 26];

/// `BUSY` and `LOCKED`.
const BUSY_CODES: [u32; 2] = [5, 6];

/// Classifies an error by what it means for its transaction.
pub(in crate::store) fn failure(error: sqlx::Error) -> Failure {
    let is_refusal = match &error {
        sqlx::Error::Database(_) => !has_code(&error, &FATAL_CODES),
        sqlx::Error::Encode(_)
        | sqlx::Error::Decode(_)
        | sqlx::Error::ColumnDecode { .. }
        | sqlx::Error::RowNotFound => true,
        _ => false,
    };
    if is_refusal { Failure::Refused(error) } else { Failure::Fatal(error.into()) }
}

/// Whether an error has one of these primary result codes, possibly as an extended code.
fn has_code(error: &sqlx::Error, codes: &[u32]) -> bool {
    let code = error.as_database_error().and_then(|error| error.code()?.parse::<u32>().ok());
    code.is_some_and(|code| codes.contains(&(code & 0xff)))
}

/// Sets the writer's timeout for the lock.
pub(in crate::store) async fn set_up(connection: &mut Connection) {
    let busy_timeout = format!("PRAGMA busy_timeout = {}", BUSY_TIMEOUT.as_millis());
    if let Err(error) = Statement::of(busy_timeout).execute(connection).await {
        tracing::warn!(%error, "the timeout for a locked database cannot be set");
    }
}

/// Writes jobs in one transaction, which must begin before the deadline; returns their outcomes in order.
pub(in crate::store) async fn keep(
    connection: &mut Connection,
    files: &Files,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Vec<Outcome> {
    let all = |outcome: &Outcome| jobs.iter().map(|_| outcome.clone()).collect();
    if state.has_failed() {
        return all(&Err(StoreError::Failed));
    }
    let kept = if jobs.iter().any(|job| state.continues_broken(job)) {
        commit_each(connection, state, jobs, deadline).await
    } else {
        match commit_all(connection, state, jobs, deadline).await {
            Err(Failure::Refused(_)) => commit_each(connection, state, jobs, deadline).await,
            committed => committed.map(|()| all(&Ok(()))),
        }
    };
    // Commits into a removed file are lost, whatever SQLite reports.
    let kept = kept.and_then(|outcomes| match files.check() {
        Ok(()) => Ok(outcomes),
        Err(lost) => Err(Failure::Fatal(lost.into())),
    });
    match kept {
        Ok(outcomes) => outcomes,
        Err(Failure::Fatal(error)) => {
            state.fail(&error);
            all(&Err(StoreError::Database(error.to_string().into())))
        }
        // Nothing was written: all senders get the error and may retry.
        Err(Failure::Refused(error) | Failure::Away(error)) => {
            let error = StoreError::from(error);
            jobs.iter().map(|job| writer::refuse(state, job, error.clone())).collect()
        }
    }
}

/// Writes all jobs, or nothing if a statement is refused.
async fn commit_all(
    connection: &mut Connection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Result<(), Failure> {
    let started = Instant::now();
    let entries = || jobs.iter().flatten();
    let count = entries().count();
    if count == 0 {
        // A barrier: everything queued before is durable by now.
        return Ok(());
    }
    begin(connection, state, deadline).await?;
    if let Err(error) = writer::write(connection, entries()).await {
        return Err(roll_back(connection, failure(error)).await);
    }
    commit(connection, count, started).await
}

/// Writes jobs one by one behind savepoints: refused jobs leave no trace, the others are committed.
async fn commit_each(
    connection: &mut Connection,
    state: &WriterState,
    jobs: &[Vec<Entry>],
    deadline: Instant,
) -> Result<Vec<Outcome>, Failure> {
    let started = Instant::now();
    begin(connection, state, deadline).await?;
    let mut outcomes = Vec::with_capacity(jobs.len());
    for job in jobs {
        match writer::write_alone(connection, state, job, failure).await {
            Ok(outcome) => outcomes.push(outcome),
            Err(fatal) => return Err(roll_back(connection, fatal).await),
        }
    }
    let count = jobs.iter().map(Vec::len).sum();
    commit(connection, count, started).await?;
    Ok(outcomes)
}

/// Executes a statement that controls the transaction.
async fn execute(connection: &mut Connection, statement: &'static str) -> Result<(), Failure> {
    query(statement)
        .execute(connection)
        .await
        .map(|_| ())
        .map_err(|error| Failure::Fatal(error.into()))
}

/// Begins a transaction; retries until the deadline while another program holds the lock.
async fn begin(
    connection: &mut Connection,
    state: &WriterState,
    deadline: Instant,
) -> Result<(), Failure> {
    let (mut pause, longest) = BEGIN_PAUSES;
    let begun = loop {
        let Err(error) = query("BEGIN IMMEDIATE").execute(connection).await else {
            break Ok(());
        };
        if !has_code(&error, &BUSY_CODES) {
            break Err(failure(error));
        }
        metrics::counter!("swarmbench_begin_retries_total").increment(1);
        state.set_blocked(Blocked::LockedOut, &error);
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break Err(Failure::Refused(error));
        }
        tokio::time::sleep(pause.min(left)).await;
        pause = (pause * 2).min(longest);
    };
    if begun.is_ok() {
        state.set_unblocked();
    }
    begun
}

/// Rolls a transaction back; returns the failure to report.
async fn roll_back(connection: &mut Connection, failure: Failure) -> Failure {
    match execute(connection, "ROLLBACK").await {
        Ok(()) => failure,
        // SQLite has rolled back by itself or cannot: nothing more is written.
        Err(fatal) => match failure {
            Failure::Fatal(_) => failure,
            Failure::Refused(_) | Failure::Away(_) => fatal,
        },
    }
}

async fn commit(
    connection: &mut Connection,
    entries: usize,
    started: Instant,
) -> Result<(), Failure> {
    if let Err(fatal) = execute(connection, "COMMIT").await {
        return Err(roll_back(connection, fatal).await);
    }
    telemetry::note_commit(entries, started.elapsed());
    Ok(())
}

#[cfg(test)]
mod tests {
    use sqlx::ConnectOptions as _;

    use super::*;
    use crate::store::Store;
    use crate::store::writer::tests::act;

    #[tokio::test]
    async fn jobs_are_refused_at_their_deadline_while_another_program_holds_the_lock() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(folder.path().join("a.db")).await.expect("it opens");
        store.close().await;
        let path = folder.path().join("a.db");
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&path);
        let options = options.busy_timeout(Duration::ZERO);
        let mut other = Connection::Sqlite(options.connect().await.expect("it opens"));
        let mut own = Connection::Sqlite(options.connect().await.expect("it opens"));
        let files = Files::default();
        let state = WriterState::default();
        execute(&mut other, "BEGIN IMMEDIATE").await.unwrap_or_else(|_| panic!("it is free"));
        let (started, patience) = (Instant::now(), Duration::from_secs(1));
        let jobs = [vec![act(1, 0)], vec![act(2, 0)]];
        let kept = keep(&mut own, &files, &state, &jobs, started + patience).await;
        assert!(
            kept.iter().all(Result::is_err)
                && state.blocked() == Some(Blocked::LockedOut)
                && !state.has_failed()
        );
        let waited = started.elapsed();
        assert!(patience <= waited && waited < patience * 19 / 10, "{waited:?}");
        execute(&mut other, "ROLLBACK").await.unwrap_or_else(|_| panic!("it was begun"));
        let jobs = [vec![act(3, 0)]];
        let kept = keep(&mut own, &files, &state, &jobs, Instant::now() + patience).await;
        assert!(kept.iter().all(Result::is_ok) && state.blocked().is_none());
    }
}
