//! Backup: a consistent copy of a database, also while a server owns it.
//!
//! The backup runs in a process of its own that only reads. `VACUUM INTO` copies what was committed when it began; in WAL
//! mode it neither waits for the writer nor blocks it.

use std::fs::{File, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::statvfs;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection, Row};

use super::files::{MODE, may_lack_log};
use super::refuse_unfinished;
use crate::store::OpenError;

/// Interval of progress reports.
const TICK: Duration = Duration::from_millis(100);

#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    #[error("there is no database {0}: name the one of the server with --db")]
    NoDatabase(PathBuf),
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Backups never overwrite a file.
    #[error("{0} exists and is not overwritten: name another file, or move that one away")]
    Exists(PathBuf),
    #[error("another backup is being written to {0}: wait for it, or name another file")]
    InUse(PathBuf),
    #[error(
        "{folder} has {free} bytes left and the backup may take {needed}: make room, or name a file on another disk"
    )]
    NoSpace {
        folder: PathBuf,
        /// Bytes available to this user.
        free: u64,
        /// Upper bound of the backup's size in bytes.
        needed: u64,
    },
    #[error("{path} cannot be used")]
    File {
        /// A file or folder.
        path: PathBuf,
        source: io::Error,
    },
    #[error("the database {path} cannot be copied")]
    Sqlite { path: PathBuf, source: sqlx::Error },
    /// The copy failed its integrity check.
    #[error("the copy in {path} is not sound: {problem}")]
    Unsound { path: PathBuf, problem: String },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backup {
    pub episodes: u64,
    pub acts: u64,
    pub rounds: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// Copies a database to `target`, which must not exist. The copy is written to `target` plus `.partial`, checked, synced to
/// disk, and only then renamed. `progress` gets the bytes written and an upper bound of the final size, every 100 ms.
pub async fn back_up(
    database: &Path,
    target: &Path,
    progress: impl Fn(u64, u64),
) -> Result<Backup, BackupError> {
    let failed = |source| BackupError::Sqlite { path: database.to_owned(), source };
    if !database.is_file() {
        return Err(BackupError::NoDatabase(database.to_owned()));
    }
    if may_lack_log(database) {
        return Err(OpenError::Linked(database.to_owned()).into());
    }
    refuse_unfinished(database).await?;
    let partial = Partial::create(target)?;
    let options = SqliteConnectOptions::new()
        .filename(database)
        .read_only(true)
        .busy_timeout(Duration::from_secs(10))
        .disable_statement_logging();
    let mut source = options.connect().await.map_err(failed)?;
    let size = size(&mut source).await.map_err(failed)?;
    check_space(partial.folder(), size)?;
    copy(&mut source, &partial, |written| progress(written, size)).await.map_err(failed)?;
    source.close().await.map_err(failed)?;
    partial.sync()?;
    let backup = check(&partial).await?;
    partial.finish()?;
    Ok(backup)
}

/// Size of a database in bytes: an upper bound for its copy, which has no free pages.
async fn size(database: &mut SqliteConnection) -> Result<u64, sqlx::Error> {
    let size = "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size";
    sqlx::query(size).fetch_one(database).await?.try_get(0).map(i64::unsigned_abs)
}

fn check_space(folder: &Path, needed: u64) -> Result<(), BackupError> {
    let system = statvfs(folder)
        .map_err(|source| BackupError::File { path: folder.to_owned(), source: source.into() })?;
    let free = system.f_bavail.saturating_mul(system.f_frsize);
    if free < needed {
        return Err(BackupError::NoSpace { folder: folder.to_owned(), free, needed });
    }
    Ok(())
}

async fn copy(
    source: &mut SqliteConnection,
    target: &Partial,
    progress: impl Fn(u64),
) -> Result<(), sqlx::Error> {
    let path = target.path.to_str().ok_or_else(|| {
        sqlx::Error::Configuration(format!("{} is not UTF-8", target.path.display()).into())
    })?;
    let copying = sqlx::query("VACUUM INTO ?").bind(path).execute(source);
    let mut copying = std::pin::pin!(copying);
    let mut ticks = tokio::time::interval(TICK);
    loop {
        tokio::select! {
            copied = copying.as_mut() => return copied.map(drop),
            _ = ticks.tick() => progress(target.file.metadata().map_or(0, |file| file.len())),
        }
    }
}

/// Checks the integrity of the whole copy and counts its rows.
async fn check(copy: &Partial) -> Result<Backup, BackupError> {
    let failed = |problem: sqlx::Error| BackupError::Unsound {
        path: copy.path.clone(),
        problem: problem.to_string(),
    };
    // No other process uses the copy, and an immutable file is read without creating files beside it.
    let options = SqliteConnectOptions::new()
        .filename(&copy.path)
        .immutable(true)
        .read_only(true)
        .disable_statement_logging();
    let mut connection = options.connect().await.map_err(failed)?;
    let said = sqlx::query_scalar::<_, String>("PRAGMA integrity_check")
        .fetch_all(&mut connection)
        .await
        .map_err(failed)?;
    if said != ["ok"] {
        let problem = said.join("; ");
        return Err(BackupError::Unsound { path: copy.path.clone(), problem });
    }
    let mut counts = [0; 3];
    let queries = [
        "SELECT count(*) FROM episodes",
        "SELECT count(*) FROM acts",
        "SELECT count(*) FROM rounds",
    ];
    for (count, query) in counts.iter_mut().zip(queries) {
        let counted = sqlx::query_scalar::<_, i64>(query).fetch_one(&mut connection).await;
        *count = counted.map_err(failed)?.unsigned_abs();
    }
    let bytes = size(&mut connection).await.map_err(failed)?;
    connection.close().await.map_err(failed)?;
    let [episodes, acts, rounds] = counts;
    Ok(Backup { episodes, acts, rounds, bytes })
}

/// A backup before its rename. The file is locked during the lifetime of this value.
struct Partial {
    path: PathBuf,
    target: PathBuf,
    file: File,
}

impl Partial {
    /// Creates an empty file, or empties one that an earlier attempt left.
    fn create(target: &Path) -> Result<Self, BackupError> {
        let failed = |path: &Path, source| BackupError::File { path: path.to_owned(), source };
        // SQLite may resolve a relative name differently.
        let target = std::path::absolute(target).map_err(|error| failed(target, error))?;
        let mut name = target.file_name().unwrap_or_default().to_owned();
        name.push(".partial");
        let path = target.with_file_name(name);
        let exists = || target.symlink_metadata().is_ok();
        if exists() {
            return Err(BackupError::Exists(target));
        }
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(MODE)
            .open(&path)
            .map_err(|error| failed(&path, error))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(BackupError::InUse(target)),
            Err(TryLockError::Error(error)) => return Err(failed(&path, error)),
        }
        // The previous holder of the lock may just have renamed this very file.
        if exists() {
            return Err(BackupError::Exists(target));
        }
        file.set_len(0).map_err(|error| failed(&path, error))?;
        // The file of an earlier attempt may have another mode.
        let mode = Permissions::from_mode(MODE);
        file.set_permissions(mode).map_err(|error| failed(&path, error))?;
        // SQLite must not apply the rollback journal of an earlier attempt to this one.
        let mut journal = path.clone().into_os_string();
        journal.push("-journal");
        match std::fs::remove_file(&journal) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(failed(Path::new(&journal), error))
            }
            _ => Ok(Self { path, target, file }),
        }
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("/"))
    }

    fn sync(&self) -> Result<(), BackupError> {
        let failed = |source| BackupError::File { path: self.path.clone(), source };
        self.file.sync_all().map_err(failed)
    }

    /// Renames the file durably.
    fn finish(self) -> Result<(), BackupError> {
        let failed = |source| BackupError::File { path: self.target.clone(), source };
        std::fs::rename(&self.path, &self.target).map_err(failed)?;
        let folder = File::open(self.folder()).map_err(failed)?;
        folder.sync_all().map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_found_out_before_anything_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(check_space(folder.path(), 1).is_ok());
        let refused = check_space(folder.path(), u64::MAX).expect_err("too much").to_string();
        assert!(refused.contains(&u64::MAX.to_string()) && refused.contains("make room"));
    }

    #[test]
    fn only_one_process_writes_a_backup() {
        let folder = tempfile::tempdir().expect("a folder");
        let target = folder.path().join("copy.db");
        let first = Partial::create(&target).expect("it is free");
        assert!(matches!(Partial::create(&target), Err(BackupError::InUse(_))));
        first.finish().expect("a name");
        assert!(matches!(Partial::create(&target), Err(BackupError::Exists(_))));
    }
}
