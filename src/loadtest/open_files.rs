//! How many connections this process may hold.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files that are open beside connections: the terminal, the runtime, the database of the bare writer.
const RESERVED: u64 = 100;

/// Raises the limit of open files as far as this process may, and returns how many connections it allows.
#[must_use]
pub fn connections_max() -> usize {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit { current: limit.maximum, maximum: limit.maximum };
    // Where it cannot be raised, the old one holds.
    let limit = setrlimit(Resource::Nofile, raised).map_or(limit, |()| raised);
    match limit.current {
        Some(files) => usize::try_from(files.saturating_sub(RESERVED)).unwrap_or(usize::MAX),
        None => usize::MAX,
    }
}
