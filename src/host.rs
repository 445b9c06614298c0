//! What the host has to give beside time and randomness: room on a disk, and open files; and
//! which addresses are its own.

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, Ordering};

/// Lets this process open as many files as the host allows, and says how many that are; none means
/// any number.
#[must_use]
pub fn raise_open_files() -> Option<u64> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::warn!(%error, "the limit of open files cannot be raised");
            current
        }
    }
}

/// The disk on which the database lies.
pub trait Disk: Send + Sync + 'static {
    /// How much of it is free, in percent; none where the host does not tell.
    fn free_percent(&self) -> Option<f64>;

    /// Whether less than so much is free.
    fn is_full(&self, free_percent_min: u32) -> bool {
        self.free_percent().is_some_and(|free| free < f64::from(free_percent_min))
    }
}

/// The host's disk that holds a directory.
#[derive(Clone, Debug)]
pub struct HostDisk(PathBuf);

impl HostDisk {
    /// The disk with the file `database`.
    #[must_use]
    pub fn of(database: &std::path::Path) -> Self {
        let folder = database.parent().filter(|folder| !folder.as_os_str().is_empty());
        Self(folder.map_or_else(|| PathBuf::from("."), PathBuf::from))
    }
}

impl Disk for HostDisk {
    fn free_percent(&self) -> Option<f64> {
        let told = rustix::fs::statvfs(&self.0).ok().filter(|told| told.f_blocks > 0)?;
        #[expect(clippy::cast_precision_loss, reason = "a share needs no more than 53 bits")]
        Some(told.f_bavail as f64 * 100.0 / told.f_blocks as f64)
    }
}

/// A disk of which a test says how full it is.
#[derive(Debug)]
pub struct ManualDisk(AtomicU8);

impl ManualDisk {
    /// A disk with so much free.
    #[must_use]
    pub const fn new(free_percent: u8) -> Self {
        Self(AtomicU8::new(free_percent))
    }

    /// From now on so much is free.
    pub fn set(&self, free_percent: u8) {
        self.0.store(free_percent, Ordering::Relaxed);
    }
}

impl Disk for ManualDisk {
    fn free_percent(&self) -> Option<f64> {
        Some(f64::from(self.0.load(Ordering::Relaxed)))
    }
}

/// Whether an address names this machine: `localhost`, or a loopback address, that of IPv6 with its brackets or without.
#[must_use]
pub fn is_loopback(name: &str) -> bool {
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost")
        || bare.parse::<IpAddr>().is_ok_and(|address| address.to_canonical().is_loopback())
}
