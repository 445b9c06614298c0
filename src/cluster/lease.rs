//! A server's right to answer.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Time after its last beat for which a server answers. Less than [`super::TAKEN_OVER_AFTER`], so that it never answers for
/// places of another owner.
pub const ANSWERS_FOR: Duration = Duration::from_millis(4500);

/// The lease of a server, which its beats renew. All times are since one moment of the process, of a clock that also runs while
/// the process is stopped.
#[derive(Debug, Default)]
pub struct Lease {
    /// End of the lease, in milliseconds.
    until: AtomicU64,
}

impl Lease {
    /// Renews the lease by a beat that was answered. `sent` is the time at which the beat was sent: the database may have counted
    /// from then.
    pub fn renew(&self, sent: Duration) {
        let until = (sent + ANSWERS_FOR).as_millis();
        self.until.store(u64::try_from(until).unwrap_or(u64::MAX), Ordering::Release);
    }

    /// Time left at `now`; zero once the lease has ended.
    #[must_use]
    pub fn left(&self, now: Duration) -> Duration {
        Duration::from_millis(self.until.load(Ordering::Acquire)).saturating_sub(now)
    }
}
