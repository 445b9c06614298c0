//! SQLite: one file, used by one process.

pub mod backup;
pub(super) mod files;
mod foreign;
pub(super) mod group;
pub(super) mod rows;

use std::path::Path;
use std::time::Duration;

use sqlx::ConnectOptions as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqliteSynchronous};

use super::sql::{Connection, Engine, query};
use super::{OpenError, copy};
use crate::migrations;
use files::{Files, Lock};

/// The oldest version that cannot lose commits when two connections checkpoint at once.
pub(super) const SQLITE_VERSION_MIN: (u32, u32, u32) = (3, 51, 3);

/// Prepared statements cached by the writer's connection: all sizes of chunked inserts, and the others.
const STATEMENTS_KEPT: usize = 256;

/// A database for exclusive use by this process. The lock must be dropped last.
pub(super) struct Opened {
    pub(super) connection: Connection,
    pub(super) options: SqliteConnectOptions,
    pub(super) files: Files,
    pub(super) lock: Lock,
}

/// Opens a database for exclusive use by this process and migrates its tables.
pub(super) async fn open(path: &Path, create: bool) -> Result<Opened, OpenError> {
    let (mut connection, options, lock) = take(path, create).await?;
    copy::refuse_unfinished(&mut connection, &path.into()).await?;
    bring_up_to_date(&mut connection, path).await?;
    let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
    super::prepare(&mut connection).await.map_err(failed)?;
    let files = Files::of(path, &lock)
        .map_err(|source| OpenError::Lock { path: path.to_owned(), source })?;
    files.check()?;
    Ok(Opened { connection, options, files, lock })
}

/// Locks and connects to a database without migrating it. The lock must be dropped last.
pub(super) async fn take(
    path: &Path,
    create: bool,
) -> Result<(Connection, SqliteConnectOptions, Lock), OpenError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(OpenError::Folder(folder.to_owned()));
    }
    let lock = Lock::take(path, create)?;
    if foreign::is_foreign(path).await {
        return Err(OpenError::Foreign(path.to_owned()));
    }
    let failed = |source| OpenError::Sqlite { path: path.to_owned(), source };
    // `Lock::take` has created the file if necessary.
    let options = SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(false)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .busy_timeout(Duration::from_secs(10))
        .statement_cache_capacity(STATEMENTS_KEPT)
        .disable_statement_logging();
    let mut connection = Connection::Sqlite(options.connect().await.map_err(failed)?);
    check_version(&mut connection).await.map_err(failed)??;
    Ok((connection, options, lock))
}

pub(super) async fn bring_up_to_date(
    connection: &mut Connection,
    path: &Path,
) -> Result<(), OpenError> {
    let Engine::Sqlite(raw) = connection.engine() else { unreachable!("it is of SQLite") };
    let migrated = migrations::sqlite().run(raw).await;
    migrated.map_err(|source| OpenError::of_migration(&path.display().to_string(), source))
}

/// Refuses files that are no database of this program, or may lack the last commits.
pub(super) async fn check_readable(path: &Path) -> Result<(), OpenError> {
    if !path.is_file() {
        return Err(OpenError::Missing(path.to_owned()));
    }
    if files::may_lack_log(path) {
        return Err(OpenError::Linked(path.to_owned()));
    }
    if foreign::is_foreign(path).await {
        return Err(OpenError::Foreign(path.to_owned()));
    }
    refuse_unfinished(path).await
}

/// Refuses the target of an interrupted copy. Accepts unreadable files.
pub(super) async fn refuse_unfinished(path: &Path) -> Result<(), OpenError> {
    let Ok(connection) = read_options(path).connect().await else { return Ok(()) };
    let mut connection = Connection::Sqlite(connection);
    let finished = copy::refuse_unfinished(&mut connection, &path.into()).await;
    drop(connection.close().await);
    match finished {
        Err(error @ OpenError::Incomplete { .. }) => Err(error),
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Options of a read-only connection to a database that another process may use.
pub(super) fn read_options(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .read_only(true)
        .busy_timeout(Duration::from_secs(10))
        .disable_statement_logging()
}

async fn check_version(connection: &mut Connection) -> Result<Result<(), OpenError>, sqlx::Error> {
    let version: String = query("SELECT sqlite_version()").one(connection).await?;
    let parts: Vec<u32> = version.split('.').filter_map(|part| part.parse().ok()).collect();
    let safe = matches!(parts[..], [a, b, c, ..] if (a, b, c) >= SQLITE_VERSION_MIN);
    Ok(if safe { Ok(()) } else { Err(OpenError::Version(version)) })
}
