//! The minimal writer of acts: rows like the server's, in groups of `entries` entries, each group one durable
//! transaction, on the engine of the server that it is compared with.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use sqlx::migrate::Migrator;

use super::LoadError;
use super::games::SEATS;

pub(crate) mod postgres;
mod sqlite;

/// The place where a bare writer creates its database. It has no `Debug`, as it may contain a password.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) enum BareLocation {
    /// A new folder below this one, for SQLite.
    Folder(PathBuf),
    /// A new database on the server of this URL, for PostgreSQL.
    Postgres(String),
}

impl BareLocation {
    /// The name of the engine, for people.
    pub(crate) const fn engine(&self) -> &'static str {
        match self {
            Self::Folder(_) => "SQLite",
            Self::Postgres(_) => "PostgreSQL",
        }
    }
}

/// The server's tables, for both engines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tables<'a> {
    /// The tables of SQLite.
    pub(crate) sqlite: &'a Migrator,
    /// The tables of PostgreSQL.
    pub(crate) postgres: &'a Migrator,
}

/// A database like a server's, which is removed on drop.
pub(crate) struct BareCommit {
    engine: Engine,
    episodes: usize,
    /// Acts written so far in all episodes.
    acts: usize,
    /// The record of every act.
    record: String,
}

enum Engine {
    Sqlite(sqlite::Writer),
    Postgres(Box<postgres::Writer>),
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

/// The rows of one commit: acts and the rounds that they complete, in the order in which a server stores concurrent
/// episodes.
#[derive(Clone, Copy)]
struct Group<'a> {
    /// The index of the first act.
    first: usize,
    acts: usize,
    episodes: usize,
    record: &'a str,
}

struct Act {
    episode: i64,
    round: i32,
    agent: i16,
    waiting_for: i16,
}

struct Round {
    episode: i64,
    round: i32,
}

const DIGEST: &[u8] = &[0xa5; 32];
const HEAD: &[u8] = &[0x5a; 32];
const SCORE: f64 = 1.5;
const AT_MS: i64 = 1_700_000_000_000;

impl Group<'_> {
    fn acts(self) -> impl ExactSizeIterator<Item = Act> {
        (self.first..self.first + self.acts).map(move |act| {
            let Round { episode, round } = self.round(act / SEATS);
            let agent = number(act % SEATS);
            Act { episode, round, agent, waiting_for: number::<i16>(SEATS) - 1 - agent }
        })
    }

    fn rounds(self) -> impl ExactSizeIterator<Item = Round> {
        let completed = self.first / SEATS..(self.first + self.acts) / SEATS;
        completed.map(move |round| self.round(round))
    }

    fn round(self, round: usize) -> Round {
        Round { episode: number(round % self.episodes), round: number(round / self.episodes) }
    }
}

impl BareCommit {
    /// Creates a database at `place` with the server's `tables`, for acts with this `record` in `episodes` episodes.
    pub(crate) async fn open(
        place: &BareLocation,
        tables: Tables<'_>,
        episodes: usize,
        record: String,
    ) -> Result<Self, LoadError> {
        let failed = LoadError::of("the database of the bare writer cannot be created");
        let engine = match place {
            BareLocation::Folder(folder) => {
                Engine::Sqlite(sqlite::Writer::open(folder, tables.sqlite).await?)
            }
            BareLocation::Postgres(url) => {
                let writer = postgres::Writer::open(url, tables.postgres).await;
                Engine::Postgres(Box::new(writer.map_err(|error| failed(&error))?))
            }
        };
        Ok(Self { engine, episodes: episodes.max(1), acts: 0, record })
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
        let Self { episodes, record, .. } = self;
        let group = Group { first: self.acts, acts, episodes: *episodes, record };
        match &mut self.engine {
            Engine::Sqlite(writer) => writer.commit(group).await?,
            Engine::Postgres(writer) => writer.commit(group).await?,
        }
        self.acts += acts;
        Ok(())
    }

    /// Closes the database and removes it.
    pub(crate) async fn close(self) -> Result<(), LoadError> {
        let closed = match self.engine {
            Engine::Sqlite(writer) => writer.close().await,
            Engine::Postgres(writer) => writer.close().await,
        };
        closed.map_err(|error| LoadError::of("the bare writer cannot be closed")(&error))
    }
}

/// A count in the type of a column.
fn number<T: TryFrom<usize>>(count: usize) -> T {
    T::try_from(count).unwrap_or_else(|_| panic!("{count} is no value of the column"))
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
    use std::path::Path;

    use sqlx::Row as _;
    use swarmbench_testkit::needs;

    use super::*;

    async fn open(place: &BareLocation) -> BareCommit {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../migrations"));
        let read =
            async |name| Migrator::new(folder.join(name)).await.expect("the server's tables");
        let (sqlite, postgres) = (read("sqlite").await, read("postgres").await);
        let tables = Tables { sqlite: &sqlite, postgres: &postgres };
        BareCommit::open(place, tables, 3, "{}".to_owned()).await.expect("a database")
    }

    /// Writes two groups by two calls without time, each of which makes one commit. Of 19.5 entries 18 are acts.
    async fn write_two_groups(bare: &mut BareCommit) {
        for acts in [18, 18] {
            let done = bare.run(19.5, Duration::ZERO).await.expect("a commit");
            assert_eq!((done.acts, done.commits), (acts, 1));
        }
    }

    const COUNTS: &str = "SELECT (SELECT count(*) FROM acts), (SELECT max(round) FROM acts), (SELECT count(*) FROM rounds)";

    #[tokio::test]
    async fn groups_are_as_large_as_they_are_to_be() {
        let mut bare = open(&BareLocation::Folder(std::env::temp_dir())).await;
        write_two_groups(&mut bare).await;
        let Engine::Sqlite(writer) = &mut bare.engine else { panic!("it is SQLite") };
        let row = sqlx::query(COUNTS).fetch_one(&mut writer.connection).await.expect("a row");
        assert_eq!((row.get::<i64, _>(0), row.get::<i64, _>(1), row.get::<i64, _>(2)), (36, 0, 3));
        let path = writer.folder().to_owned();
        bare.close().await.expect("closed");
        assert!(!path.exists());
    }

    #[needs(postgres)]
    #[tokio::test]
    async fn groups_of_postgres_are_the_same() {
        let url = swarmbench_testkit::postgres::server().expect("a server for tests");
        let place = BareLocation::Postgres(url.clone());
        let mut bare = open(&place).await;
        write_two_groups(&mut bare).await;
        let Engine::Postgres(writer) = &mut bare.engine else { panic!("it is PostgreSQL") };
        let row = sqlx::query(COUNTS).fetch_one(writer.connection()).await.expect("a row");
        assert_eq!((row.get::<i64, _>(0), row.get::<i32, _>(1), row.get::<i64, _>(2)), (36, 0, 3));
        assert_eq!(
            postgres::count_fenced(writer).await,
            0,
            "a writer whose row is gone writes nothing"
        );
        let closed = writer.database().to_owned();
        bare.close().await.expect("closed");
        // Dropped without a close, as after an error or in an aborted task.
        let dropped = open(&place).await;
        let Engine::Postgres(writer) = &dropped.engine else { panic!("it is PostgreSQL") };
        let names = [closed, writer.database().to_owned()];
        drop(dropped);
        assert_eq!(postgres::databases(&url, &names).await, 0);
    }
}
