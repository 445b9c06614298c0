//! The database: SQLite, one file, one process.
//!
//! All that is written goes through one task that commits in groups (`writer.rs`); readers have
//! connections of their own and never wait for it (WAL).

mod again;
pub mod audit;
pub mod backup;
pub mod check;
pub mod clock;
pub mod competitions;
pub mod entries;
pub mod episodes;
mod error;
pub mod exports;
mod files;
mod foreign;
mod forks;
pub mod games;
pub mod imports;
pub mod journals;
pub mod keys;
pub mod metrics;
pub mod port;
mod readers;
pub mod rebuild;
pub mod records;
pub mod results;
mod rows;
pub mod runs;
pub mod seats;
mod templates;
pub mod tokens;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{ConnectOptions, Row as _};

use crate::migrations::migrator;
use entries::Entry;
pub use error::{Stopped, StoreError};
pub use files::Lost;
use files::{Files, Lock};
use port::{Committed, Reply};
pub use readers::{
    READERS_MAX, READERS_WAITING_MAX, READERS_WAITING_PER_GROUP_MAX, patiently, patiently_blocking,
};
pub use writer::WriterState;

/// The oldest SQLite that cannot lose commits where two connections checkpoint at once.
const SQLITE_VERSION_MIN: (u32, u32, u32) = (3, 51, 3);

/// The database could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another process has it.
    #[error(
        "the database {0} is in use by another process: stop that one, or name another file with --db"
    )]
    InUse(PathBuf),
    /// The database, or the lock file beside it, cannot be opened or locked.
    #[error("{path} cannot be opened and locked")]
    Lock { path: PathBuf, source: std::io::Error },
    /// Its folder does not exist.
    #[error("there is no folder {0}: create it, or name another file with --db")]
    Folder(PathBuf),
    /// It is no database, or one of another program.
    #[error("{0} is not a database of this program: name another file with --db")]
    Foreign(PathBuf),
    /// It has hard links, so that its log may be beside another name.
    #[error(
        "{0} has several names (hard links), and SQLite finds what was written last by the name that the server uses: \
         remove the other names, or name the one of the server with --db"
    )]
    Linked(PathBuf),
    /// Its files changed while it was opened.
    #[error(transparent)]
    Lost(#[from] Lost),
    /// There is no such database.
    #[error("there is no database {0}: name the one of the server with --db")]
    Missing(PathBuf),
    /// Its tables are those of another version, and reading does not migrate them.
    #[error(
        "the tables of {0} are those of another version of this program; `swarmbench serve` of this version brings \
         older ones up to date"
    )]
    Tables(PathBuf),
    /// It is linked with an unsafe version.
    #[error("SQLite {0} can lose commits; at least {major}.{minor}.{patch} is needed",
        major = SQLITE_VERSION_MIN.0, minor = SQLITE_VERSION_MIN.1, patch = SQLITE_VERSION_MIN.2)]
    Version(String),
    #[error("the database {path} cannot be opened")]
    Sqlite { path: PathBuf, source: sqlx::Error },
    /// Its tables are those of another version.
    #[error("the tables of {path} cannot be brought up to date")]
    Migrate { path: PathBuf, source: sqlx::migrate::MigrateError },
}

/// An open database. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Store {
    readers: readers::Readers,
    writer: writer::Writer,
    ended_games: Arc<games::EndedGames>,
    files: Files,
    /// Held as long as the database is open; none where it is only read.
    lock: Arc<Mutex<Option<Lock>>>,
}

impl Store {
    /// Opens a database, creating it where there is none, and takes it for this process alone.
    pub async fn open(path: &Path) -> Result<Self, OpenError> {
        let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
        let OpenedDatabase { lock, files, options, connection } =
            open_exclusively(path, true).await?;
        let options = readers::cached(options.read_only(true).create_if_missing(false));
        let readers = readers::Readers::open(options).await.map_err(failed)?;
        let writer = writer::Writer::spawn(connection, files.clone());
        let ended_games = Arc::new(games::EndedGames::new());
        Ok(Self { readers, writer, ended_games, files, lock: Arc::new(Mutex::new(Some(lock))) })
    }

    /// Opens a database only to read it, also while a server has it. What is handed to the writer is
    /// refused.
    pub async fn open_to_read(path: &Path) -> Result<Self, OpenError> {
        if !path.is_file() {
            return Err(OpenError::Missing(path.to_owned()));
        }
        if files::may_lack_log(path) {
            return Err(OpenError::Linked(path.to_owned()));
        }
        if foreign::is_foreign(path).await {
            return Err(OpenError::Foreign(path.to_owned()));
        }
        let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .read_only(true)
            .busy_timeout(Duration::from_secs(10))
            .disable_statement_logging();
        let mut connection = options.connect().await.map_err(failed)?;
        let newest: Option<i64> = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations")
            .fetch_one(&mut connection)
            .await
            .map_err(failed)?;
        let readers = readers::Readers::open(options).await.map_err(failed)?;
        let known = migrator().iter().map(|migration| migration.version).max();
        if newest != known {
            return Err(OpenError::Tables(path.to_owned()));
        }
        let writer = writer::Writer::none();
        let ended_games = Arc::new(games::EndedGames::new());
        Ok(Self { readers, writer, ended_games, files: Files::default(), lock: Arc::default() })
    }

    /// A connection that reads, for the party of this task.
    async fn read(&self) -> Result<readers::Reading, StoreError> {
        self.readers.get().await
    }

    /// Hands entries to the writer; see [`crate::store::port::EpisodeStore::append`].
    pub fn append(&self, entries: Vec<Entry>, committed: Committed) {
        self.writer.append(entries, committed);
    }

    /// Keeps entries; see [`EpisodeStore::keep`](port::EpisodeStore::keep).
    #[must_use = "entries are durable only once it has returned"]
    pub fn keep(&self, entries: Vec<Entry>) -> Reply<'static, ()> {
        port::committed(|committed| self.append(entries, committed))
    }

    pub fn writer(&self) -> &WriterState {
        self.writer.state()
    }

    /// Commits what was handed over, and closes the file. The writer is the last to leave, so that
    /// SQLite puts everything into the one file. Then others may have it.
    pub async fn close(self) {
        self.readers.close().await;
        self.writer.stop().await;
        // Not before SQLite has closed the database, see `files.rs`; and not later, when actors that have not noticed
        // the end drop their clones of the store: this process may have opened the database again by then.
        drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner).take());
    }

    /// Whether the files of the database are still those that were opened. The writer looks after every commit, too.
    pub fn check_files(&self) -> Result<(), Lost> {
        self.files.check()
    }

    /// Whether the database can be read.
    pub async fn ping(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT 1").execute(&mut *self.read().await?).await?;
        Ok(())
    }
}

/// A database that only this process uses. The lock has to be dropped last.
struct OpenedDatabase {
    connection: SqliteConnection,
    options: SqliteConnectOptions,
    files: Files,
    lock: Lock,
}

/// Opens a database for this process alone, and brings its tables up to date.
async fn open_exclusively(path: &Path, create: bool) -> Result<OpenedDatabase, OpenError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(OpenError::Folder(folder.to_owned()));
    }
    let lock = Lock::take(path, create)?;
    if foreign::is_foreign(path).await {
        return Err(OpenError::Foreign(path.to_owned()));
    }
    let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
    // The file was made with its lock, if it had to be.
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(false)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .busy_timeout(Duration::from_secs(10))
        .statement_cache_capacity(rows::STATEMENTS_KEPT)
        .disable_statement_logging();
    let mut connection = options.connect().await.map_err(failed)?;
    check_version(&mut connection).await.map_err(failed)??;
    migrator()
        .run(&mut connection)
        .await
        .map_err(|source| OpenError::Migrate { path: path.to_owned(), source })?;
    competitions::add_missing_looks(&mut connection).await.map_err(failed)?;
    forks::delete_incomplete(&mut connection).await.map_err(failed)?;
    let files = Files::of(path, &lock)
        .map_err(|source| OpenError::Lock { path: path.to_owned(), source })?;
    files.check()?;
    Ok(OpenedDatabase { connection, options, files, lock })
}

async fn check_version(
    connection: &mut SqliteConnection,
) -> Result<Result<(), OpenError>, sqlx::Error> {
    let version: String =
        sqlx::query("SELECT sqlite_version()").fetch_one(connection).await?.try_get(0)?;
    let parts: Vec<u32> = version.split('.').filter_map(|part| part.parse().ok()).collect();
    let safe = matches!(parts[..], [a, b, c, ..] if (a, b, c) >= SQLITE_VERSION_MIN);
    Ok(if safe { Ok(()) } else { Err(OpenError::Version(version)) })
}
