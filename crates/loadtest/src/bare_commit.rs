//! The minimum that a writer does for an act: rows of the server's own tables, in groups of `entries` entries, each
//! group one durable transaction.

use std::path::Path;
use std::time::{Duration, Instant};

use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection};

use super::LoadError;
use super::games::SEATS;

/// Rows per statement: each binds six values, and SQLite allows some thousands.
const ROWS_MAX: usize = 1000;

/// A database like a server's, in a folder of its own that is removed with it.
#[derive(Debug)]
pub struct BareCommit {
    connection: SqliteConnection,
    folder: Folder,
    episodes: usize,
    /// Acts written so far, of all episodes.
    acts: usize,
    /// The record of every act.
    record: String,
}

#[derive(Debug)]
struct Folder(std::path::PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed stays behind.
        drop(std::fs::remove_dir_all(&self.0));
    }
}

/// The work of one turn.
#[derive(Clone, Copy, Debug)]
pub struct Committed {
    /// Committed acts.
    pub acts: u64,
    /// Committed transactions.
    pub commits: u64,
    /// Duration of the turn.
    pub elapsed: Duration,
}

impl BareCommit {
    /// A new database below `dir` with the server's tables, for acts with this `record` of `episodes` episodes.
    ///
    /// # Errors
    /// Where it cannot be created.
    pub async fn open(
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

    /// Commits groups of about `entries` entries for `time`, and at least one: the acts of whole rounds and the rounds,
    /// in the order in which a server stores episodes that are played side by side.
    ///
    /// # Errors
    /// Where a commit fails.
    pub async fn run(&mut self, entries: f64, time: Duration) -> Result<Committed, LoadError> {
        let failed = LoadError::of("the bare writer cannot commit");
        // The fraction left over from a group is added to the next, so that the mean size is `entries`.
        let mut due = 0.0;
        let started = Instant::now();
        let mut done = Committed { acts: 0, commits: 0, elapsed: Duration::ZERO };
        loop {
            // Of 13 entries 12 are acts.
            due += entries * 12.0 / 13.0;
            let acts = floor(due).max(1);
            due -= float(acts);
            self.commit_next(acts).await.map_err(|error| failed(&error))?;
            done.acts += acts as u64;
            done.commits += 1;
            done.elapsed = started.elapsed();
            if done.elapsed >= time {
                return Ok(done);
            }
        }
    }

    /// Commits the next `acts` acts, and the rounds that they complete.
    pub(crate) async fn commit_next(&mut self, acts: usize) -> Result<(), sqlx::Error> {
        self.commit(self.acts, acts).await?;
        self.acts += acts;
        Ok(())
    }

    /// Commits `acts` acts from number `first` on, and the rounds that they complete.
    async fn commit(&mut self, first: usize, acts: usize) -> Result<(), sqlx::Error> {
        let connection = &mut self.connection;
        sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await?;
        let all: Vec<usize> = (first..first + acts).collect();
        for rows in all.chunks(ROWS_MAX) {
            let text = insert("acts (episode, round, agent, waiting_for, at, record)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for act in rows {
                let (round, agent) = (act / SEATS, act % SEATS);
                query = query
                    .bind(number(round % self.episodes))
                    .bind(number(round / self.episodes))
                    .bind(number(agent))
                    .bind(number(SEATS - 1 - agent))
                    .bind(1_700_000_000_000_i64)
                    .bind(&self.record);
            }
            query.execute(&mut *connection).await?;
        }
        let rounds: Vec<usize> = (first / SEATS..(first + acts) / SEATS).collect();
        for rows in rounds.chunks(ROWS_MAX) {
            let text = insert("rounds (episode, round, digest, score, head, at)", rows.len());
            let mut query = sqlx::query(AssertSqlSafe(text));
            for round in rows {
                query = query
                    .bind(number(round % self.episodes))
                    .bind(number(round / self.episodes))
                    .bind(&[0xa5; 32][..])
                    .bind(1.5)
                    .bind(&[0x5a; 32][..])
                    .bind(1_700_000_000_000_i64);
            }
            query.execute(&mut *connection).await?;
        }
        sqlx::query("COMMIT").execute(connection).await?;
        Ok(())
    }

    /// Closes the database and removes it.
    ///
    /// # Errors
    /// Where it cannot be closed.
    pub async fn close(self) -> Result<(), LoadError> {
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

fn number(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

fn float(count: usize) -> f64 {
    super::float(count as u64)
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
    use sqlx::Row;

    use super::*;

    #[tokio::test]
    async fn groups_are_as_large_as_they_are_to_be() {
        let folder = std::env::temp_dir();
        let tables = concat!(env!("CARGO_MANIFEST_DIR"), "/../../migrations");
        let tables = Migrator::new(Path::new(tables)).await.expect("the server's tables");
        let bare = BareCommit::open(&folder, &tables, 3, "{}".to_owned()).await;
        let mut bare = bare.expect("a database");
        // Without time each call makes one commit. Of 19.5 entries 18 are acts.
        for acts in [18, 18] {
            let done = bare.run(19.5, Duration::ZERO).await.expect("a commit");
            assert_eq!((done.acts, done.commits), (acts, 1));
        }
        let connection = &mut bare.connection;
        let count = sqlx::query("SELECT count(*), max(round) FROM acts").fetch_one(connection);
        let row = count.await.expect("a row");
        assert_eq!((row.get::<i64, _>(0), row.get::<i64, _>(1)), (36, 0));
        let path = bare.folder.0.clone();
        bare.close().await.expect("closed");
        assert!(!path.exists());
    }
}
