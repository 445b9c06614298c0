//! The disk of the database, filled by hand.

use std::sync::atomic::{AtomicU8, Ordering};

use swarmbench::host::{Disk, DiskSpace};

/// A disk of 100 MiB that a test fills.
#[derive(Debug)]
pub(crate) struct ManualDisk(AtomicU8);

impl ManualDisk {
    pub(crate) const fn new(free_percent: u8) -> Self {
        Self(AtomicU8::new(free_percent))
    }

    pub(crate) fn set(&self, free_percent: u8) {
        self.0.store(free_percent, Ordering::Relaxed);
    }
}

impl Disk for ManualDisk {
    fn space(&self) -> Option<DiskSpace> {
        let free = u64::from(self.0.load(Ordering::Relaxed)).min(100);
        Some(DiskSpace { free: free << 20, used: (100 - free) << 20 })
    }
}
