//! The slot of an episode in the registry: where the episode is, and when it leaves memory.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::OnceCell;
use tokio_util::sync::CancellationToken;

use super::actor::{Handle, Times};
use crate::ids::{EpisodeKey, Place};
use swarmbench_clock::after;

/// Minimum time between two recoveries of an episode after faults of its actor, as a fault may repeat at once.
const REVIVED_AFTER: Duration = Duration::from_secs(1);

/// Slot of an episode. Every unfinished episode has one, and so has every episode that was requested lately.
pub(super) struct Slot {
    /// Empty while the episode is not in memory.
    pub(super) handle: Arc<OnceCell<Handle>>,
    pub(super) used_at: Timestamp,
    /// Time at which an unfinished episode outside memory is recovered without a request, as it is abandoned or closed then.
    pub(super) ends_at: Option<Timestamp>,
    /// Whether the episode advances by itself: it is then recovered whenever it is not in memory.
    pub(super) clocked: bool,
    /// Cancelled when the evicted actor has ended. It may still have something to do, and an episode never has two actors.
    pub(super) leaving: Option<CancellationToken>,
    /// For an episode in creation: cancelled when its actor has been started, or never will be. Until then nobody recovers the
    /// episode, as it would get a second actor.
    pub(super) starting: Option<CancellationToken>,
    /// Time when the slot was last emptied after a fault of the actor.
    revived_at: Option<Timestamp>,
    /// Whether the episode is queued for recovery.
    pub(super) in_line: bool,
    /// End under which [`Slots`](super::slots::Slots) lists the episode.
    pub(super) listed_at: Option<Timestamp>,
    /// Times of an episode that was in memory since the start of the server. The journal does not know them, as the time of day
    /// may have been set since then.
    pub(super) times: Option<Arc<Times>>,
    /// Place and number of the episode, once known.
    pub(super) place: Option<(Place, EpisodeKey)>,
}

impl Slot {
    pub(super) fn empty(now: Timestamp) -> Self {
        Self {
            handle: Arc::default(),
            used_at: now,
            ends_at: None,
            clocked: false,
            leaving: None,
            starting: None,
            revived_at: None,
            in_line: false,
            listed_at: None,
            times: None,
            place: None,
        }
    }

    /// Empties the slot if the actor has ended before the episode, so that the next request recovers the episode. Others may still
    /// hold the dead handle: nothing is done through it.
    pub(super) fn empty_if_dead(&mut self, now: Timestamp) {
        let is_early = self.revived_at.is_some_and(|at| after(at, REVIVED_AFTER) > now);
        let Some(handle) = self.handle.get().filter(|handle| handle.is_dead() && !is_early) else {
            return;
        };
        tracing::warn!(episode = %handle.id, "the actor of an episode has ended: the episode is recovered from the journal");
        metrics::counter!("swarmbench_episodes_revived_total").increment(1);
        self.revived_at = Some(now);
        self.vacate(now);
    }

    /// Whether handles to the episode exist, or soon will.
    pub(super) fn is_held(&self) -> bool {
        Arc::strong_count(&self.handle) > 1 || self.handle.get().is_some_and(Handle::is_shared)
    }

    /// Whether the slot waits for a request or for the end of its episode: the episode has not ended, is not in memory, and nobody
    /// recovers it now.
    pub(super) fn rests(&self) -> bool {
        !self.handle.initialized() && Arc::strong_count(&self.handle) == 1 && self.ends_at.is_some()
    }

    /// Whether the episode has had no handles and no requests for `stays`.
    pub(super) fn is_idle(&self, now: Timestamp, stays: Duration) -> bool {
        !self.is_held() && after(self.used_at, stays) <= now
    }

    /// Whether the episode advances without requests, or soon will.
    pub(super) fn advances(&self) -> bool {
        let advances = |handle: &Handle| {
            handle.spec.advances_by_itself() && !handle.snapshot().status.is_over()
        };
        self.in_line || self.handle.get().map_or(self.clocked, advances)
    }

    /// Evicts an idle episode, unless it has a running clock. False where the slot is no longer needed.
    pub(super) fn leave(&mut self, now: Timestamp) -> bool {
        let Some(handle) = self.handle.get() else { return self.ends_at.is_some() };
        if handle.snapshot().status.is_over() {
            return false;
        }
        if handle.is_dead() {
            self.vacate(now);
        } else if !handle.spec.advances_by_itself() {
            self.vacate(handle.ends_at());
        }
        true
    }

    /// Evicts the episode until a request comes, or until `ends_at`.
    fn vacate(&mut self, ends_at: Timestamp) {
        let place = std::mem::take(&mut self.handle);
        let Some(handle) = place.get() else { return };
        self.ends_at = Some(ends_at);
        self.clocked = handle.spec.advances_by_itself();
        self.leaving = Some(handle.gone());
        self.times = Some(handle.times());
    }
}
