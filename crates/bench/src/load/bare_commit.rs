//! The minimal writer of acts: rows like the server's, in groups of `entries` entries, each group one durable
//! transaction of SQLite.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};

use super::LoadError;
use super::games::SEATS;

/// Rows per statement: each binds six values, and SQLite allows some thousands.
const ROWS_MAX: usize = 1000;

const DIGEST: &[u8] = &[0xa5; 32];
const HEAD: &[u8] = &[0x5a; 32];
const SCORE: f64 = 1.5;
const AT_MS: i64 = 1_700_000_000_000;

/// A database like a server's, which is removed on drop.
pub(crate) struct BareCommit {
    connection: SqliteConnection,
    folder: Folder,
    episodes: usize,
    /// Acts written so far in all episodes.
    acts: usize,
    /// The record of every act.
    record: String,
}

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed stays behind.
        drop(std::fs::remove_dir_all(&self.0));
    }
}

/// The work of one turn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Committed {
    /// Committed acts.
    pub(crate) acts: u64,
    /// Committed transactions.
    pub(crate) commits: u64,
    /// Duration of the turn.
    pub(crate) elapsed: Duration,
}

impl BareCommit {
    /// Creates a database in `dir` with the server's `tables`, for acts with this `record` in `episodes` episodes.
    pub(crate) async fn open(
        dir: &Path,
        tables: &Migrator,
        episodes: usize,
        record: String,
    ) -> Result<Self, LoadError> {
        let failed = LoadError::of("the database of the bare writer cannot be created");
        let folder = Folder(dir.join(format!("swarmbench-loadtest-{}", std::process::id())));
        std::fs::create_dir_all(&folder.0).map_err(|error| failed(&error))?;
        let options = SqliteConnectOptions::new()
            .filename(folder.0.join("bare.db"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .disable_statement_logging();
        let mut connection = options.connect().await.map_err(|error| failed(&error))?;
        tables.run(&mut connection).await.map_err(|error| failed(&error))?;
        Ok(Self { connection, folder, episodes: episodes.max(1), acts: 0, record })
    }

    /// Commits groups of about `entries` entries for `time`, and at least one group. An entry is an act or a round.
    pub(crate) async fn run(
        &mut self,
        entries: f64,
        time: Duration,
    ) -> Result<Committed, LoadError> {
        let failed = LoadError::of("the bare writer cannot commit");
        // The fraction left over from a group goes into the next one, so that the mean size is `entries`.
        let mut due = 0.0;
        let started = Instant::now();
        let mut done = Committed { acts: 0, commits: 0, elapsed: Duration::ZERO };
        loop {
            // Of 13 entries 12 are acts.
            due += entries * 12.0 / 13.0;
            let acts = floor(due).max(1);
            due -= super::float(acts as u64);
            self.commit_next(acts).await.map_err(|error| failed(&error))?;
            done.acts += acts as u64;
            done.commits += 1;
            done.elapsed = started.elapsed();
            if done.elapsed >= time {
                return Ok(done);
            }
        }
    }

    /// Commits the next `acts` acts, and the rounds that they complete, in the order in which a server stores concurrent
    /// episodes.
    pub(crate) async fn commit_next(&mut self, acts: usize) -> Result<(), sqlx::Error> {
        let Self { connection, episodes, record, acts: first, .. } = self;
        let place =
            |round: usize| -> (i64, i32) { (number(round % *episodes), number(round / *episodes)) };
        let (from, to) = (*first, *first + acts);
        sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await?;
        for begin in (from..to).step_by(ROWS_MAX) {
            let rows = begin..to.min(begin + ROWS_MAX);
            let text = insert("acts (episode, round, agent, waiting_for, at, record)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for act in rows {
                let ((episode, round), agent) = (place(act / SEATS), number::<i16>(act % SEATS));
                let waiting_for = number::<i16>(SEATS) - 1 - agent;
                query = query.bind(episode).bind(round).bind(agent).bind(waiting_for);
                query = query.bind(AT_MS).bind(&*record);
            }
            query.execute(&mut *connection).await?;
        }
        let (from, to) = (from / SEATS, to / SEATS);
        for begin in (from..to).step_by(ROWS_MAX) {
            let rows = begin..to.min(begin + ROWS_MAX);
            let text = insert("rounds (episode, round, digest, score, head, at)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for (episode, round) in rows.map(place) {
                query = query.bind(episode).bind(round);
                query = query.bind(DIGEST).bind(SCORE).bind(HEAD).bind(AT_MS);
            }
            query.execute(&mut *connection).await?;
        }
        sqlx::query("COMMIT").execute(connection).await?;
        self.acts += acts;
        Ok(())
    }

    /// Closes the database and removes it.
    pub(crate) async fn close(self) -> Result<(), LoadError> {
        let closed = self.connection.close().await;
        drop(self.folder);
        closed.map_err(|error| LoadError::of("the bare writer cannot be closed")(&error))
    }
}

/// An `INSERT` of `rows` rows of six values.
fn insert(into: &str, rows: usize) -> String {
    let values = vec!["(?, ?, ?, ?, ?, ?)"; rows].join(", ");
    format!("INSERT INTO {into} VALUES {values}")
}

/// A count in the type of a column.
fn number<T: TryFrom<usize>>(count: usize) -> T {
    T::try_from(count).unwrap_or_else(|_| panic!("{count} is no value of the column"))
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "sizes of groups are small and not negative"
)]
fn floor(number: f64) -> usize {
    number.max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use sqlx::Row as _;

    use super::*;

    #[tokio::test]
    async fn groups_are_as_large_as_they_are_to_be() {
        let dir = std::env::temp_dir();
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../migrations/sqlite"));
        let tables = Migrator::new(folder).await.expect("the server's tables");
        let mut bare =
            BareCommit::open(&dir, &tables, 3, "{}".to_owned()).await.expect("a database");
        // A call without time makes one commit. Of 19.5 entries 18 are acts.
        for acts in [18, 18] {
            let done = bare.run(19.5, Duration::ZERO).await.expect("a commit");
            assert_eq!((done.acts, done.commits), (acts, 1));
        }
        let counts = "SELECT (SELECT count(*) FROM acts), (SELECT max(round) FROM acts), (SELECT count(*) FROM rounds)";
        let row = sqlx::query(counts).fetch_one(&mut bare.connection).await.expect("a row");
        assert_eq!((row.get::<i64, _>(0), row.get::<i64, _>(1), row.get::<i64, _>(2)), (36, 0, 3));
        let path = bare.folder.0.clone();
        bare.close().await.expect("closed");
        assert!(!path.exists());
    }
}
