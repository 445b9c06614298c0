//! The files of a database: exclusive use, permissions, and detection of moved files.
//!
//! The lock is on the database file itself, so that every path to it (a symbolic or hard link, another relative path) meets
//! the same lock. It is a `flock`, which on Linux does not touch the byte-range locks that SQLite takes on the same file. But
//! **closing any descriptor of a file gives up all byte-range locks that the process has on it**. So the lock's descriptor is
//! opened before SQLite opens the file and closed after SQLite has closed it, and nothing else in a process with an open
//! database may open that file; `stat` is the way to look at it.

use std::collections::BTreeSet;
use std::fs::{File, Metadata, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::store::OpenError;

/// Mode of the database's files: only the owner may read them, as they contain hashes of tokens and sealed seeds.
pub(in crate::store) const MODE: u32 = 0o600;

/// Databases in use by this process: another path to one of them is recognized before the file is opened.
static TAKEN: Mutex<BTreeSet<Identity>> = Mutex::new(BTreeSet::new());

fn taken() -> MutexGuard<'static, BTreeSet<Identity>> {
    TAKEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Exclusive use of a database by this process during the lifetime of this value.
#[derive(Debug)]
pub(in crate::store) struct Lock {
    database: Identity,
    /// The database, and the file beside it that earlier versions of this program lock.
    files: [File; 2],
}

impl Drop for Lock {
    fn drop(&mut self) {
        taken().remove(&self.database);
        for file in &self.files {
            // Closing is not enough: a child process has a copy of the descriptor between `fork` and `exec`.
            if let Err(error) = file.unlock() {
                tracing::warn!(%error, "a lock of the database is held until the process ends");
            }
        }
    }
}

impl Lock {
    /// Locks a database by any of its paths. `create` makes an empty file if there is none.
    pub(in crate::store) fn take(path: &Path, create: bool) -> Result<Self, OpenError> {
        if identity(path).is_ok_and(|database| taken().contains(&database)) {
            return Err(OpenError::InUse(path.display().to_string()));
        }
        let beside = lock(path, &beside(path, ".lock"), true)?;
        let file = lock(path, path, create)?;
        let about =
            file.metadata().map_err(|source| OpenError::Lock { path: path.to_owned(), source })?;
        warn_if_open_to_others(path, &about);
        if about.nlink() > 1 {
            return Err(OpenError::Linked(path.to_owned()));
        }
        let database = (about.dev(), about.ino());
        taken().insert(database);
        Ok(Self { database, files: [file, beside] })
    }
}

/// Whether the last commits may be invisible under this name: SQLite finds the write-ahead log by the name, and that of a
/// file with several names (hard links) may be beside another one.
pub(in crate::store) fn may_lack_log(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| about.nlink() > 1)
        && path.canonicalize().is_ok_and(|path| !beside(&path, "-wal").exists())
}

/// Path of a file that SQLite keeps beside a database.
fn beside(database: &Path, end: &str) -> PathBuf {
    let mut name = database.to_owned().into_os_string();
    name.push(end);
    name.into()
}

/// Opens and locks a file of the database `path`.
fn lock(path: &Path, file_path: &Path, create: bool) -> Result<File, OpenError> {
    let failed = |source| OpenError::Lock { path: file_path.to_owned(), source };
    let file = File::options()
        .create(create)
        .truncate(false)
        .read(true)
        .write(true)
        .mode(MODE)
        .open(file_path)
        .map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(OpenError::InUse(path.display().to_string())),
        Err(TryLockError::Error(source)) => Err(failed(source)),
    }
}

/// Warns instead of changing the mode of an existing file, which is up to the operator.
fn warn_if_open_to_others(path: &Path, about: &Metadata) {
    let mode = about.permissions().mode() & 0o777;
    if mode & 0o007 != 0 {
        tracing::warn!(
            database = %path.display(),
            mode = format!("{mode:03o}"),
            "other users of this machine can read the database: chmod 600 it, and the files beside it"
        );
    }
}

/// A file of an open database was moved or replaced: further writes would be lost.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    #[error("{0} was removed or renamed while the server uses it")]
    Gone(PathBuf),
    #[error("{0} was replaced by another file while the server uses it")]
    Replaced(PathBuf),
}

/// Paths of the files that SQLite has open, with their identities at that time.
#[derive(Clone, Debug, Default)]
pub(in crate::store) struct Files(Arc<Watched>);

#[derive(Debug, Default)]
struct Watched {
    files: Vec<(PathBuf, Identity)>,
    was_logged: AtomicBool,
}

/// Device and inode: identifies a file of a machine.
type Identity = (u64, u64);

fn identity(path: &Path) -> io::Result<Identity> {
    path.metadata().map(|about| (about.dev(), about.ino()))
}

impl Files {
    /// Records the files of a database opened by SQLite. `lock` is older, so a replacement of the file since then is noticed.
    pub(in crate::store) fn of(path: &Path, lock: &Lock) -> io::Result<Self> {
        // SQLite follows symbolic links as well, and puts its files beside the database itself.
        let path = path.canonicalize()?;
        let beside = ["-wal", "-shm"].map(|end| beside(&path, end));
        let mut files = vec![(path, lock.database)];
        for path in beside {
            match identity(&path) {
                Ok(identity) => files.push((path, identity)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Self(Arc::new(Watched { files, was_logged: AtomicBool::new(false) })))
    }

    /// Checks that all paths lead to the recorded files; logs the first failure.
    pub(in crate::store) fn check(&self) -> Result<(), Lost> {
        let lost = self.0.files.iter().find_map(|(path, opened)| match identity(path) {
            Ok(now) if now == *opened => None,
            Ok(_) => Some(Lost::Replaced(path.clone())),
            Err(error) if is_gone(&error) => Some(Lost::Gone(path.clone())),
            // Other errors do not prove that the file is gone.
            Err(_) => None,
        });
        let Some(lost) = lost else { return Ok(()) };
        if !self.0.was_logged.swap(true, Ordering::AcqRel) {
            metrics::gauge!("swarmbench_database_lost").set(1.0);
            tracing::error!(%lost, "nothing is acknowledged until a restart over the right files");
        }
        Err(lost)
    }
}

fn is_gone(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}
