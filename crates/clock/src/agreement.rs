//! Detection of a time of day in doubt.
//!
//! The server's time of day runs on a steady clock, which cannot be set. The host's clock is compared with it: small
//! differences are corrected slowly, and after a jump neither clock is trusted.

use std::fmt;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};

/// Greatest accepted difference between the host's and the server's time of day. Time synchronization changes a host's
/// clock by less at once.
const JUMP_MIN: SignedDuration = SignedDuration::from_secs(1);

/// Divisor of the elapsed time that bounds how fast smaller differences are corrected.
const FOLLOWED_PART: i64 = 100;

/// The reason why the time of day is in doubt. Meanwhile it triggers nothing irreversible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// The host's clock has jumped by this much against the steady one.
    Jumped(SignedDuration),
    /// The host's clock lies behind the newest entry of the database, whose time this is.
    Behind(Timestamp),
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Jumped(by) => write!(
                f,
                "the clock of the host has jumped by {:+.1} s against the time since the start",
                by.as_secs_f64()
            )?,
            Self::Behind(newest) => write!(
                f,
                "the clock of the host lies behind the newest entry of the database, of {newest}"
            )?,
        }
        f.write_str(
            ": nothing is revealed, closed or abandoned and no attempt starts until it is right \
             again, or an organizer confirms it",
        )
    }
}

/// The server's time of day, relative to a steady clock.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// Lead of the server's time of day over the steady clock.
    ahead: SignedDuration,
    /// The steady time of the last comparison with the host's clock.
    compared_at: Timestamp,
    /// An entry of the database that was newer than the host's clock at the start.
    newest: Option<Timestamp>,
}

impl Agreement {
    /// An agreement of both clocks at `now`.
    #[must_use]
    pub fn new(now: Timestamp) -> Self {
        Self { ahead: SignedDuration::ZERO, compared_at: now, newest: None }
    }

    /// Lead of the server's time of day over the steady clock.
    #[must_use]
    pub const fn ahead(&self) -> SignedDuration {
        self.ahead
    }

    /// Compares the steady clock with the host's time of day.
    pub fn compare(&mut self, steady: Timestamp, host: Timestamp) -> Option<Doubt> {
        let difference = host.duration_since(steady);
        if let Some(newest) = self.newest {
            // The host's clock is known to be wrong, and may be corrected without notice. Until then the time of day is
            // at least that of the newest entry: whatever has closed, frozen or expired stays so.
            self.ahead = difference.max(newest.duration_since(steady));
            if host < newest {
                return Some(Doubt::Behind(newest));
            }
            self.newest = None;
        }
        let jump = difference - self.ahead;
        if jump.abs() > JUMP_MIN {
            return Some(Doubt::Jumped(jump));
        }
        let most = millis(steady.duration_since(self.compared_at)) / FOLLOWED_PART;
        if most > 0 {
            let step = millis(jump).clamp(-most, most);
            self.ahead += SignedDuration::from_millis(step);
            self.compared_at = steady;
        }
        None
    }

    /// Accepts the host's time of day.
    pub fn confirm(&mut self, steady: Timestamp, host: Timestamp) {
        *self = Self { ahead: host.duration_since(steady), compared_at: steady, newest: None };
    }

    /// Records the time of the database's newest entry.
    pub fn not_before(&mut self, newest: Timestamp) {
        self.newest = Some(newest);
    }
}

fn millis(duration: SignedDuration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

/// A moment moved by a duration that may be negative.
pub(super) fn moved(at: Timestamp, by: SignedDuration) -> Timestamp {
    at.saturating_add(by).unwrap_or(at)
}

/// A duration that can be subtracted.
pub(super) fn signed(duration: Duration) -> SignedDuration {
    SignedDuration::try_from(duration).unwrap_or(SignedDuration::MAX)
}
