//! The files of a database: one process has them, only its user reads them, and they stay where they are.
//!
//! The lock is on the database file itself, so that every path to it (a symbolic or hard link, another relative path)
//! meets the same lock. It is a `flock`, which on Linux does not touch the byte-range locks that SQLite takes on the
//! same file. But **closing any descriptor of a file gives up all byte-range locks that the process has on it**. So the
//! descriptor here is opened before SQLite opens the file and closed after SQLite has closed it, and nothing else in a
//! process with an open database may open that file; to look at it there is `stat`.

use std::collections::BTreeSet;
use std::fs::{File, Metadata, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::store::OpenError;

/// What the files of a database may be used for: by their owner alone, as hashes of tokens and sealed seeds are in them.
pub(in crate::store) const MODE: u32 = 0o600;

/// The databases that this process has taken. Another path to one of them is found here, before the file is opened.
static TAKEN: Mutex<BTreeSet<Identity>> = Mutex::new(BTreeSet::new());

fn taken() -> MutexGuard<'static, BTreeSet<Identity>> {
    TAKEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The database is taken for this process as long as this exists.
#[derive(Debug)]
pub(in crate::store) struct Lock {
    database: Identity,
    /// The database itself, and the file beside it by which versions before this one keep each other out.
    files: [File; 2],
}

impl Drop for Lock {
    fn drop(&mut self) {
        taken().remove(&self.database);
        for file in &self.files {
            // Closing is not enough: a process that was just forked has a copy of the descriptor until it runs its program.
            if let Err(error) = file.unlock() {
                tracing::warn!(%error, "a lock of the database is held until the process ends");
            }
        }
    }
}

impl Lock {
    /// Takes a database, whatever path leads to it. With `create` an empty file is made where there is none.
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

/// Whether what was written last may be missing where a database is read by this name: SQLite finds its log by the name,
/// and a file with several names (hard links) may have its log beside another one.
pub(in crate::store) fn may_lack_log(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| about.nlink() > 1)
        && path.canonicalize().is_ok_and(|path| !beside(&path, "-wal").exists())
}

/// The name of a file that SQLite keeps beside a database.
fn beside(database: &Path, end: &str) -> PathBuf {
    let mut name = database.to_owned().into_os_string();
    name.push(end);
    name.into()
}

/// Opens one of the files of the database `path` and locks it.
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

/// The mode of a file that was there before is the operator's to change.
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

/// A file of an open database is not where it was. What is written from now on would be lost.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    /// Nothing has its name.
    #[error("{0} was removed or renamed while the server uses it")]
    Gone(PathBuf),
    /// Another file has its name.
    #[error("{0} was replaced by another file while the server uses it")]
    Replaced(PathBuf),
}

/// The files that SQLite has open, by their names and what these stood for when they were opened.
#[derive(Clone, Debug, Default)]
pub(in crate::store) struct Files(Arc<Watched>);

#[derive(Debug, Default)]
struct Watched {
    files: Vec<(PathBuf, Identity)>,
    was_logged: AtomicBool,
}

/// Tells files of one machine apart.
type Identity = (u64, u64);

fn identity(path: &Path) -> io::Result<Identity> {
    path.metadata().map(|about| (about.dev(), about.ino()))
}

impl Files {
    /// Those of a database that SQLite has opened. `lock` was taken before; another file may have got the name since.
    pub(in crate::store) fn of(path: &Path, lock: &Lock) -> io::Result<Self> {
        // SQLite follows symbolic links, too, and puts its files beside the database itself.
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

    /// Whether all of them are where they were. Where one is not, that is logged once.
    pub(in crate::store) fn check(&self) -> Result<(), Lost> {
        let lost = self.0.files.iter().find_map(|(path, opened)| match identity(path) {
            Ok(now) if now == *opened => None,
            Ok(_) => Some(Lost::Replaced(path.clone())),
            Err(error) if is_gone(&error) => Some(Lost::Gone(path.clone())),
            // Whether it is there is not known; nothing is concluded from that.
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
