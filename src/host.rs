//! Resources of the host besides time and randomness: free space on a disk, memory, and open files.

use std::path::{Component, Path, PathBuf};

/// Raises the limit of open files as far as the host allows, and returns it; `None` means no limit.
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

/// Bytes of memory that this process may use: the machine's, or fewer if its control groups or its address space are limited.
/// `None` if the host does not report it.
pub fn memory_bytes() -> Option<usize> {
    let read = |path: &Path| std::fs::read_to_string(path).ok();
    let machine = read(Path::new("/proc/meminfo")).and_then(|text| total_memory(&text));
    let own_group = read(Path::new("/proc/self/cgroup")).and_then(|text| group_path(&text));
    // A container sees its own group at the root.
    let groups = Path::new("/sys/fs/cgroup");
    let own_group = groups.join(own_group.unwrap_or_default());
    let own_groups = own_group.ancestors().take_while(|path| path.starts_with(groups));
    let limited = own_groups.filter_map(|path| read(&path.join("memory.max"))?.trim().parse().ok());
    let older = read(&groups.join("memory/memory.limit_in_bytes"));
    let older = older.and_then(|text| text.trim().parse().ok());
    let space = rustix::process::getrlimit(rustix::process::Resource::As).current;
    let all = limited.chain(machine).chain(older).chain(space);
    all.min().map(|bytes: u64| usize::try_from(bytes).unwrap_or(usize::MAX))
}

/// Bytes of the machine's memory, from `/proc/meminfo`.
fn total_memory(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Path of the control group (version 2), from `/proc/self/cgroup`.
fn group_path(text: &str) -> Option<PathBuf> {
    let path = text.lines().find_map(|line| line.strip_prefix("0::/"))?;
    Some(PathBuf::from(path))
        .filter(|path| path.components().all(|part| matches!(part, Component::Normal(_))))
}

/// Free bytes with which a disk is not full, however large it is.
pub const DISK_FREE_BYTES_ENOUGH: u64 = 2 << 30;

/// Space of a disk that this process may use, in bytes, without the superuser's reserve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskSpace {
    pub free: u64,
    pub used: u64,
}

impl DiskSpace {
    pub fn free_percent(self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a share needs no more than 53 bits")]
        let (free, used) = (self.free as f64, self.used as f64);
        free * 100.0 / (free + used).max(1.0)
    }

    fn is_full(self, free_percent_min: u32) -> bool {
        self.free < DISK_FREE_BYTES_ENOUGH && self.free_percent() < f64::from(free_percent_min)
    }
}

/// The disk of the database.
pub trait Disk: Send + Sync + 'static {
    /// `None` if the host does not report it.
    fn space(&self) -> Option<DiskSpace>;

    fn is_full(&self, free_percent_min: u32) -> bool {
        self.space().is_some_and(|space| space.is_full(free_percent_min))
    }
}

/// The disk of a directory.
#[derive(Clone, Debug)]
pub struct HostDisk(PathBuf);

impl HostDisk {
    pub fn of(database: &std::path::Path) -> Self {
        let folder = database.parent().filter(|folder| !folder.as_os_str().is_empty());
        Self(folder.map_or_else(|| PathBuf::from("."), PathBuf::from))
    }
}

impl Disk for HostDisk {
    fn space(&self) -> Option<DiskSpace> {
        let disk = rustix::fs::statvfs(&self.0).ok().filter(|disk| disk.f_blocks > 0)?;
        let bytes = |blocks: u64| blocks.saturating_mul(disk.f_frsize);
        let used = bytes(disk.f_blocks.saturating_sub(disk.f_bfree));
        Some(DiskSpace { free: bytes(disk.f_bavail), used })
    }
}

/// The disk of a database on another host, which does not report its space: its operator watches it.
#[derive(Clone, Copy, Debug)]
pub struct OtherHostsDisk;

impl Disk for OtherHostsDisk {
    fn space(&self) -> Option<DiskSpace> {
        None
    }
}

/// Name of this host and this process, for people.
pub fn process_name() -> String {
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    format!("{host}, process {}", std::process::id())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_is_full_by_the_space_that_may_be_used() {
        let full = |free, used| DiskSpace { free, used }.is_full(5);
        assert!(full(4 << 20, 96 << 20) && full(0, 0));
        assert!(!full(5 << 20, 95 << 20));
        assert!(!full(2 << 30, 1 << 40), "a large disk");
        assert!(full((2 << 30) - 1, 1 << 40));
        let space = HostDisk(PathBuf::from("/")).space().expect("a disk");
        assert!(space.used > 0 && space.free_percent() < 100.0, "{space:?}");
    }

    #[test]
    fn limits_of_memory_are_read() {
        let meminfo = "MemTotal:       16316412 kB\nMemFree:  1 kB\n";
        assert_eq!(total_memory(meminfo), Some(16_316_412 * 1024));
        assert_eq!(total_memory("MemFree: 1 kB\n"), None);
        let group = |text: &str| group_path(text).map(|path| path.display().to_string());
        assert_eq!(
            group("0::/system.slice/a.service\n").as_deref(),
            Some("system.slice/a.service")
        );
        assert_eq!(group("1:name=x:/a\n0::/\n").as_deref(), Some(""));
        assert_eq!(group("0::/../../etc\n"), None);
        if cfg!(target_os = "linux") {
            assert!(memory_bytes() > Some(1024 * 1024));
        }
    }
}
