//! The database: a SQLite file or a PostgreSQL database, written by one task of the process.
//!
//! The writer task (`writer`) commits entries in groups; readers have connections of their own and never wait for it. `model`
//! has the types of entries and answers, `tables` the queries, one file a table, in SQL that both engines accept (`sql`);
//! `sqlite` and `postgres` have what is specific to an engine.

pub mod check;
pub mod copy;
mod error;
mod location;
mod model;
mod postgres;
mod readers;
pub mod rebuild;
mod sql;
mod sqlite;
mod stored_replay;
mod tables;
mod writer;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use sqlx::ConnectOptions as _;

use crate::fair::Party;
use crate::ids::Place;
use crate::migrations;
use entries::Entry;
pub use error::{Stopped, StoreError};
pub use location::{Address, Location, LocationError};
pub use model::{entries, port};
use port::{Committed, Reply};
pub use postgres::cluster::{Beat, Cluster, ClusterSnapshot, JoinError, Joining};
pub use postgres::session::SessionError;
use readers::ReaderOptions;
pub use readers::{patiently, patiently_blocking};
use sql::{Connection, FromRow, SqlRow, Statement, query};
use sqlite::SQLITE_VERSION_MIN;
pub use sqlite::backup;
pub use sqlite::files::Lost;
use sqlite::files::{Files, Lock};
pub use tables::{
    audit, clock, competitions, episodes, exports, games, imports, journals, keys, metrics,
    records, results, runs, seats, tokens,
};
use tables::{forks, templates};
pub use writer::{Blocked, WriterState};

/// The database could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error(
        "the database {0} is in use by another process: stop that one, or name another database with --db"
    )]
    InUse(String),
    /// `path` is the database or the lock file beside it.
    #[error("{path} cannot be opened and locked")]
    Lock { path: PathBuf, source: std::io::Error },
    #[error("there is no folder {0}: create it, or name another file with --db")]
    Folder(PathBuf),
    /// The file is no SQLite database, or one of another program.
    #[error("{0} is not a database of this program: name another file with --db")]
    Foreign(PathBuf),
    /// The file has hard links: its write-ahead log may be beside another name.
    #[error(
        "{0} has several names (hard links), and SQLite finds what was written last by the name that the server uses: \
         remove the other names, or name the one of the server with --db"
    )]
    Linked(PathBuf),
    /// The files were moved or replaced while the database was opened.
    #[error(transparent)]
    Lost(#[from] Lost),
    #[error("there is no database {0}: name the one of the server with --db")]
    Missing(PathBuf),
    /// Opening for reading does not migrate the tables.
    #[error(
        "the tables of {0} are those of another version of this program; `swarmbench serve` of this version brings \
         older ones up to date"
    )]
    Tables(String),
    /// The linked version of SQLite can lose commits.
    #[error("SQLite {0} can lose commits; at least {major}.{minor}.{patch} is needed",
        major = SQLITE_VERSION_MIN.0, minor = SQLITE_VERSION_MIN.1, patch = SQLITE_VERSION_MIN.2)]
    Version(String),
    #[error("the database {path} cannot be opened")]
    Sqlite { path: PathBuf, source: sqlx::Error },
    #[error(transparent)]
    Postgres(#[from] SessionError),
    #[error(transparent)]
    Join(#[from] JoinError),
    #[error(
        "a cluster cannot share the file {0}: name a database of PostgreSQL with --db, or leave out --cluster-address"
    )]
    Alone(PathBuf),
    #[error(transparent)]
    Location(#[from] LocationError),
    /// An earlier copy into the database was interrupted.
    #[error(
        "the database {location} is an unfinished copy: run `swarmbench migrate --from {from} --to {location}` again, which \
         continues where it stopped"
    )]
    Incomplete { location: String, from: String },
    #[error(
        "the tables of {location} are those of a later version of this program (migration {version}): start that version, or name \
         another database with --db. There is no way back for tables; a backup from before has the older ones"
    )]
    Later { location: String, version: i64 },
    #[error("the tables of {location} cannot be brought up to date")]
    Migrate { location: String, source: sqlx::migrate::MigrateError },
}

impl OpenError {
    fn of_migration(location: &str, source: sqlx::migrate::MigrateError) -> Self {
        let location = location.to_owned();
        match source {
            sqlx::migrate::MigrateError::VersionMissing(version) => {
                Self::Later { location, version }
            }
            source => Self::Migrate { location, source },
        }
    }
}

/// An open database. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Store {
    readers: readers::Readers,
    writer: writer::Writer,
    ended_games: Arc<games::EndedGames>,
    files: Files,
    /// Held while a SQLite file is open for writing; `None` for readers and PostgreSQL.
    lock: Arc<Mutex<Option<Lock>>>,
    /// Set in a cluster of servers.
    cluster: Option<Arc<Cluster>>,
}

impl Store {
    /// Opens a database for exclusive use by this process. A missing SQLite file is created.
    pub async fn open(location: impl Into<Location>) -> Result<Self, OpenError> {
        Self::open_as(location.into(), None).await
    }

    /// Opens a database that a cluster of servers shares.
    pub async fn join(location: impl Into<Location>, joining: &Joining) -> Result<Self, OpenError> {
        Self::open_as(location.into(), Some(joining)).await
    }

    async fn open_as(location: Location, joining: Option<&Joining>) -> Result<Self, OpenError> {
        match location {
            Location::File(path) if joining.is_some() => Err(OpenError::Alone(path)),
            Location::File(path) => {
                let failed = |source| OpenError::Sqlite { path: path.clone(), source };
                let sqlite::Opened { connection, options, files, lock } =
                    sqlite::open(&path, true).await?;
                let options = readers::cached(options.read_only(true).create_if_missing(false));
                let options = ReaderOptions::Sqlite(options);
                let readers = readers::Readers::open(options).await.map_err(failed)?;
                let group = writer::Group::Sqlite(connection, files.clone());
                Ok(Self::of(readers, writer::Writer::spawn(group), files, Some(lock)))
            }
            Location::Postgres(address) => {
                let postgres::Opened { committer, readers } =
                    postgres::open(&address, joining).await?;
                let failed =
                    |source| SessionError::Failed { location: address.to_string(), source };
                let readers = ReaderOptions::Postgres(readers);
                let readers = readers::Readers::open(readers).await.map_err(failed)?;
                let cluster = committer.cluster().cloned();
                let group = writer::Group::Postgres(Box::new(committer));
                let store = Self::of(readers, writer::Writer::spawn(group), Files::default(), None);
                Ok(Self { cluster, ..store })
            }
            Location::Unknown(error) => Err(error.into()),
        }
    }

    /// Opens a database for reading only, also while a server uses it. The writer refuses all entries.
    pub async fn open_to_read(location: impl Into<Location>) -> Result<Self, OpenError> {
        let location = location.into();
        let (mut connection, options, known) = read_connection(&location).await?;
        let failed = |source| location.failed(source);
        let newest: Option<i64> = query("SELECT max(version) FROM _sqlx_migrations")
            .one(&mut connection)
            .await
            .map_err(failed)?;
        drop(connection.close().await);
        if newest != known {
            return Err(OpenError::Tables(location.to_string()));
        }
        let readers = readers::Readers::open(options).await.map_err(failed)?;
        Ok(Self::of(readers, writer::Writer::none(), Files::default(), None))
    }

    fn of(
        readers: readers::Readers,
        writer: writer::Writer,
        files: Files,
        lock: Option<Lock>,
    ) -> Self {
        let ended_games = Arc::new(games::EndedGames::new());
        let lock = Arc::new(Mutex::new(lock));
        Self { readers, writer, ended_games, files, lock, cluster: None }
    }

    /// The state of the cluster; `None` for a single server.
    pub fn cluster(&self) -> Option<&Arc<Cluster>> {
        self.cluster.as_ref()
    }

    /// Stops all writes, as another server has taken over this one's places.
    pub fn set_excluded(&self) {
        self.writer
            .state()
            .exclude(&"the other servers have excluded this one, as it was not seen for too long");
    }

    /// Takes a place unless another server owns it; returns whether this server owns it now.
    pub async fn take_place(&self, place: Place) -> Result<bool, StoreError> {
        let Some(cluster) = &self.cluster else { return Ok(true) };
        if cluster.places().has(place) {
            return Ok(true);
        }
        cluster.take(&[place]).await?;
        Ok(cluster.places().has(place))
    }

    /// Whether this server does what is due at a place for which no request has come. Takes a place without an owner where this
    /// server is to keep it.
    pub async fn owns_or_takes(&self, place: Place) -> Result<bool, StoreError> {
        match &self.cluster {
            Some(cluster) if cluster.keeper(place) != Some(cluster.incarnation()) => Ok(false),
            _ => self.take_place(place).await,
        }
    }

    /// Notes the commits of the other servers, so that boards and lists read after this call show them.
    pub async fn catch_up(&self) -> Result<(), StoreError> {
        let Some(cluster) = &self.cluster else { return Ok(()) };
        let changes = self.writer.state().changes();
        cluster.read_changes(|effect| changes.apply(effect), || changes.forget()).await
    }

    /// Waits for a reader connection, on behalf of the current party.
    async fn read(&self) -> Result<readers::Reading, StoreError> {
        self.readers.get().await
    }

    async fn fetch_all<T: FromRow>(&self, query: Statement<'_>) -> Result<Vec<T>, StoreError> {
        Ok(self.rows(query).await?.iter().map(T::from_row).collect::<Result<_, _>>()?)
    }

    async fn fetch_one<T: FromRow>(&self, query: Statement<'_>) -> Result<T, StoreError> {
        let row = self.row(query).await?.ok_or(sqlx::Error::RowNotFound)?;
        Ok(T::from_row(&row)?)
    }

    async fn fetch_optional<T: FromRow>(
        &self,
        query: Statement<'_>,
    ) -> Result<Option<T>, StoreError> {
        Ok(self.row(query).await?.as_ref().map(T::from_row).transpose()?)
    }

    /// Rows of a query: not yet of a type, so that the way to them is compiled once.
    async fn rows(&self, query: Statement<'_>) -> Result<Vec<SqlRow>, StoreError> {
        Ok(query.fetch_all(&mut *self.read().await?).await?)
    }

    async fn row(&self, query: Statement<'_>) -> Result<Option<SqlRow>, StoreError> {
        Ok(query.fetch_optional(&mut *self.read().await?).await?)
    }

    /// Queues entries; see [`EpisodeStore::append`](port::EpisodeStore::append).
    pub fn append(&self, entries: Vec<Entry>, committed: Committed) {
        self.writer.append(entries, None, committed);
    }

    /// Queues entries and waits for their commit; see [`EpisodeStore::keep`](port::EpisodeStore::keep).
    #[must_use = "entries are durable only once it has returned"]
    pub fn keep(&self, entries: Vec<Entry>) -> Reply<'static, ()> {
        // A call without entries is a barrier and belongs to no party.
        let party = (!entries.is_empty()).then(Party::current);
        port::committed(|committed| self.writer.append(entries, party, committed))
    }

    pub fn writer(&self) -> &WriterState {
        self.writer.state()
    }

    /// Commits queued entries, closes the database and releases its lock. The writer's connection is the last to close, so
    /// that SQLite moves the whole write-ahead log into the file.
    pub async fn close(self) {
        self.readers.close().await;
        self.writer.stop().await;
        // Not before SQLite has closed the database, see `files.rs`. Not with the last clone of the store either: actors may
        // drop theirs later, when this process has already opened the database again.
        drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner).take());
    }

    /// Whether the names of the database still lead to the opened files. The writer checks this after each commit, too.
    pub fn check_files(&self) -> Result<(), Lost> {
        self.files.check()
    }

    /// Size of the database in bytes.
    pub async fn bytes(&self) -> Result<u64, StoreError> {
        let mut reading = self.read().await?;
        let size = if reading.is_postgres() {
            "SELECT pg_database_size(current_database())"
        } else {
            "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"
        };
        Ok(query(size).one::<i64>(&mut reading).await?.unsigned_abs())
    }

    /// Runs a trivial query: an error means that the database cannot be read.
    pub async fn ping(&self) -> Result<(), StoreError> {
        query("SELECT 1").execute(&mut *self.read().await?).await?;
        Ok(())
    }
}

impl Location {
    /// Wraps an error of the engine with the location.
    fn failed(&self, source: sqlx::Error) -> OpenError {
        match self {
            Self::File(path) => OpenError::Sqlite { path: path.clone(), source },
            Self::Postgres(address) => {
                SessionError::Failed { location: address.to_string(), source }.into()
            }
            Self::Unknown(error) => error.clone().into(),
        }
    }
}

/// A read-only connection, the options for further ones, and the newest migration that this program knows.
async fn read_connection(
    location: &Location,
) -> Result<(Connection, ReaderOptions, Option<i64>), OpenError> {
    match location {
        Location::File(path) => {
            sqlite::check_readable(path).await?;
            let options = sqlite::read_options(path);
            let connection = options.connect().await.map_err(|error| location.failed(error))?;
            let known = migrations::newest(&migrations::sqlite());
            Ok((Connection::Sqlite(connection), ReaderOptions::Sqlite(options), known))
        }
        Location::Postgres(address) => {
            let (server, connection) = postgres::open_to_read(address).await?;
            let known = migrations::newest(&migrations::postgres());
            Ok((connection, ReaderOptions::Postgres(server.readers()), known))
        }
        Location::Unknown(error) => Err(error.clone().into()),
    }
}

/// Completes the data after migrations and interrupted forks, before anything is written.
async fn prepare(connection: &mut Connection) -> Result<(), sqlx::Error> {
    competitions::add_missing_looks(connection).await?;
    forks::delete_incomplete(connection).await
}

/// A connection for commands that write while no server uses the database.
struct Alone {
    connection: Connection,
    /// `None` for PostgreSQL. Dropped after the connection.
    _lock: Option<Lock>,
}

impl Alone {
    async fn open(location: &Location) -> Result<Self, OpenError> {
        match location {
            Location::File(path) => {
                if !path.is_file() {
                    return Err(OpenError::Missing(path.clone()));
                }
                let sqlite::Opened { connection, lock, .. } = sqlite::open(path, false).await?;
                Ok(Self { connection, _lock: Some(lock) })
            }
            Location::Postgres(address) => {
                let connection = postgres::open_alone(address).await?;
                Ok(Self { connection, _lock: None })
            }
            Location::Unknown(error) => Err(error.clone().into()),
        }
    }

    /// Locks a database without migrating or checking it: it may be empty or unfinished. A missing SQLite file is created.
    async fn take(location: &Location) -> Result<Self, OpenError> {
        match location {
            Location::File(path) => {
                let (connection, _, lock) = sqlite::take(path, true).await?;
                Ok(Self { connection, _lock: Some(lock) })
            }
            Location::Postgres(address) => {
                let connection = postgres::take(address).await?;
                Ok(Self { connection, _lock: None })
            }
            Location::Unknown(error) => Err(error.clone().into()),
        }
    }

    /// Creates missing tables.
    async fn make_tables(&mut self, location: &Location) -> Result<(), OpenError> {
        match location {
            Location::File(path) => sqlite::bring_up_to_date(&mut self.connection, path).await,
            Location::Postgres(address) => {
                postgres::make_tables(&mut self.connection, address).await
            }
            Location::Unknown(error) => Err(error.clone().into()),
        }
    }

    async fn close(self) -> Result<(), sqlx::Error> {
        self.connection.close().await
    }
}
