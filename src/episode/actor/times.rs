//! Moments of an episode by the running time.

use std::sync::atomic::{AtomicI64, Ordering};

use jiff::Timestamp;

use crate::store::port::StoredEpisode;
use swarmbench_clock::Clock;

/// Moments of an episode by the running time. The journal has them only by the time of day, which may have been set since.
pub(in super::super) struct Times {
    pub(in super::super) created_at: Timestamp,
    /// Time of a player's last durable act, or else of the start or the creation, in milliseconds.
    last_act_at: AtomicI64,
}

impl Times {
    pub(in super::super) fn new(created_at: Timestamp) -> Self {
        Self { created_at, last_act_at: AtomicI64::new(created_at.as_millisecond()) }
    }

    /// Times of a stored episode, as far as the time of day tells.
    pub(in super::super) fn stored(stored: &StoredEpisode, clock: &dyn Clock) -> Self {
        let times = Self::new(clock.running_at(stored.created_at));
        if let Some(at) = stored.last_act_at {
            times.note_act(clock.running_at(at));
        }
        times
    }

    pub(in super::super) fn last_act_at(&self) -> Timestamp {
        let at = Timestamp::from_millisecond(self.last_act_at.load(Ordering::Acquire));
        at.unwrap_or(self.created_at)
    }

    pub(super) fn note_act(&self, at: Timestamp) {
        self.last_act_at.store(at.as_millisecond(), Ordering::Release);
    }
}
