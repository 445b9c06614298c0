//! The database: SQLite, one file, one process.
//!
//! All that is written goes through one task that commits in groups (`writer.rs`); readers have
//! connections of their own and never wait for it (WAL).

pub mod audit;
pub mod backup;
pub mod clock;
pub mod competitions;
pub mod episodes;
mod exports;
pub mod imports;
pub mod keys;
pub mod rebuild;
pub mod records;
pub mod results;
pub mod runs;
pub mod seats;
pub mod tokens;
mod writer;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{ConnectOptions, Row};

use crate::journal::{Committed, Entry, JournalError};
pub use writer::WriterState;

/// The oldest SQLite that cannot lose commits where two connections checkpoint at once.
const SQLITE_VERSION_MIN: (u32, u32, u32) = (3, 51, 3);

/// Connections that read at once.
const READERS: u32 = 4;

/// How long somebody waits for a free connection to read.
const READ_PATIENCE: Duration = Duration::from_secs(5);

/// The database could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another process has it.
    #[error(
        "the database {0} is in use by another process: stop that one, or name another file with --db"
    )]
    InUse(PathBuf),
    /// The file beside it that says who has it cannot be used.
    #[error("the lock file {path} cannot be used")]
    Lock {
        /// The lock file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is no such database.
    #[error("there is no database {0}: name the one of the server with --db")]
    Missing(PathBuf),
    /// Its tables are those of another version, and nobody changes them by reading.
    #[error(
        "the tables of {0} are those of another version of this program; `swarmbench serve` of this version brings \
         older ones up to date"
    )]
    Tables(PathBuf),
    /// It is linked with an unsafe version.
    #[error("SQLite {0} can lose commits; at least {major}.{minor}.{patch} is needed",
        major = SQLITE_VERSION_MIN.0, minor = SQLITE_VERSION_MIN.1, patch = SQLITE_VERSION_MIN.2)]
    Version(String),
    /// SQLite refused.
    #[error("the database {path} cannot be opened")]
    Sqlite {
        /// The database.
        path: PathBuf,
        /// Why.
        source: sqlx::Error,
    },
    /// Its tables are those of another version.
    #[error("the tables of {path} cannot be brought up to date")]
    Migrate {
        /// The database.
        path: PathBuf,
        /// Why.
        source: sqlx::migrate::MigrateError,
    },
}

/// An open database. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Store {
    readers: SqlitePool,
    writer: writer::Writer,
    /// Held as long as the database is open; none where it is only read.
    lock: Option<Arc<File>>,
}

impl Store {
    /// Opens a database, creating it where there is none, and takes it for this process alone.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub async fn open(path: &Path) -> Result<Self, OpenError> {
        let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
        let (lock, options, connection) = take(path, true).await?;
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(READ_PATIENCE)
            .connect_with(options.read_only(true).create_if_missing(false))
            .await
            .map_err(failed)?;
        Ok(Self { readers, writer: writer::Writer::spawn(connection), lock: Some(Arc::new(lock)) })
    }

    /// Opens a database only to read it, also while a server has it. What is handed to the writer is
    /// refused.
    ///
    /// # Errors
    /// Where there is none, or its tables are those of another version.
    pub async fn open_to_read(path: &Path) -> Result<Self, OpenError> {
        if !path.is_file() {
            return Err(OpenError::Missing(path.to_owned()));
        }
        let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .read_only(true)
            .busy_timeout(Duration::from_secs(10))
            .disable_statement_logging();
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(READ_PATIENCE)
            .connect_with(options)
            .await
            .map_err(failed)?;
        let newest: Option<i64> = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations")
            .fetch_one(&readers)
            .await
            .map_err(failed)?;
        let known = sqlx::migrate!().iter().map(|migration| migration.version).max();
        if newest != known {
            return Err(OpenError::Tables(path.to_owned()));
        }
        Ok(Self { readers, writer: writer::Writer::none(), lock: None })
    }

    /// Hands entries to the writer; see [`crate::journal::Journal::append`].
    pub fn append(&self, entries: Vec<Entry>, committed: Committed) {
        self.writer.append(entries, committed);
    }

    /// How the writer does.
    #[must_use]
    pub fn writer(&self) -> &WriterState {
        self.writer.state()
    }

    /// Commits what was handed over, and closes the file. The writer is the last to leave, so that
    /// SQLite puts everything into the one file. Then others may have it.
    pub async fn close(self) {
        self.readers.close().await;
        self.writer.stop().await;
        // Actors that have not noticed the end yet hold clones of the store, and so the lock file.
        if let Some(Err(error)) = self.lock.map(|lock| lock.unlock()) {
            tracing::warn!(%error, "the lock of the database is held until the process ends");
        }
    }

    /// Whether the database can be read.
    ///
    /// # Errors
    /// Where it cannot.
    pub async fn ping(&self) -> Result<(), JournalError> {
        sqlx::query("SELECT 1").execute(&self.readers).await.map_err(failure)?;
        Ok(())
    }
}

/// Takes a database for this process alone, and brings its tables up to date.
async fn take(
    path: &Path,
    create: bool,
) -> Result<(File, SqliteConnectOptions, SqliteConnection), OpenError> {
    let lock = lock(path)?;
    let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(create)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .busy_timeout(Duration::from_secs(10))
        .disable_statement_logging();
    let mut connection = options.connect().await.map_err(failed)?;
    check_version(&mut connection).await.map_err(failed)??;
    sqlx::migrate!()
        .run(&mut connection)
        .await
        .map_err(|source| OpenError::Migrate { path: path.to_owned(), source })?;
    Ok((lock, options, connection))
}

fn failure(error: sqlx::Error) -> JournalError {
    match error {
        sqlx::Error::PoolTimedOut => JournalError::busy(),
        error => JournalError(error.to_string().into()),
    }
}

/// Takes the lock of a database: one process owns it.
fn lock(path: &Path) -> Result<File, OpenError> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".lock");
    let lock_path = path.with_file_name(name);
    let failed = |source| OpenError::Lock { path: lock_path.clone(), source };
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&lock_path)
        .map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(OpenError::InUse(path.to_owned())),
        Err(std::fs::TryLockError::Error(source)) => Err(failed(source)),
    }
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
