//! The slot of an episode in the registry: where the episode is, and when it leaves memory.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::OnceCell;
use tokio_util::sync::CancellationToken;

use super::actor::{Handle, Times};
use crate::ids::{EpisodeKey, Place};
use swarmbench_clock::after;

/// How long an episode whose actor has ended by a fault is left alone before it is recovered once more:
/// what has failed at once may fail at once again.
const REVIVED_AFTER: Duration = Duration::from_secs(1);

/// The slot of an episode: of all that have not ended, and of those that were requested lately.
pub(super) struct Slot {
    /// Empty as long as the episode is not in memory.
    pub(super) handle: Arc<OnceCell<Handle>>,
    pub(super) used_at: Timestamp,
    /// When an episode that has not ended and is not in memory has to be recovered, if there is no
    /// request for it earlier: then it is abandoned, or closed.
    pub(super) ends_at: Option<Timestamp>,
    /// Whether it advances by itself: then it is recovered whenever it is not in memory.
    pub(super) clocked: bool,
    /// The actor that was evicted. It may still have something to do, and an episode never has
    /// two of them.
    pub(super) leaving: Option<CancellationToken>,
    /// Of an episode that is being created: cancelled when its actor has been started, or never will be. Until then nobody
    /// recovers it, as it would get a second actor.
    pub(super) starting: Option<CancellationToken>,
    /// When it was last emptied as its actor had ended by a fault.
    revived_at: Option<Timestamp>,
    /// Whether it is queued for recovery.
    pub(super) in_line: bool,
    /// Under which end it is listed, see [`Slots`](super::slots::Slots).
    pub(super) listed_at: Option<Timestamp>,
    /// Of an episode that was in memory since the start of the server. The time of day may have been set
    /// since then, so the journal does not know them.
    pub(super) times: Option<Arc<Times>>,
    /// Where the episode is played, and its number, as far as that is known.
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

    /// Empties the slot if the actor has ended though the episode has not, so that the next request
    /// recovers the episode. Others may still hold the dead handle: nothing is done through it.
    pub(super) fn empty_if_dead(&mut self, now: Timestamp) {
        let is_early = self.revived_at.is_some_and(|at| after(at, REVIVED_AFTER) > now);
        let Some(handle) = self.handle.get().filter(|handle| handle.is_dead() && !is_early) else {
            return;
        };
        tracing::warn!(episode = %handle.id, "its actor has ended: it is recovered from the journal");
        metrics::counter!("swarmbench_episodes_revived_total").increment(1);
        self.revived_at = Some(now);
        self.vacate(now);
    }

    /// Whether there are handles to the episode, or soon will be.
    pub(super) fn is_held(&self) -> bool {
        Arc::strong_count(&self.handle) > 1 || self.handle.get().is_some_and(Handle::is_shared)
    }

    /// Whether it waits for a request or for the end of its episode: that has not ended, is not in memory, and nobody recovers
    /// it now.
    pub(super) fn rests(&self) -> bool {
        !self.handle.initialized() && Arc::strong_count(&self.handle) == 1 && self.ends_at.is_some()
    }

    /// Whether the episode has no handles and no requests for so long.
    pub(super) fn is_idle(&self, now: Timestamp, stays: Duration) -> bool {
        !self.is_held() && after(self.used_at, stays) <= now
    }

    /// Whether it goes on without requests, or soon will.
    pub(super) fn advances(&self) -> bool {
        let advances = |handle: &Handle| {
            handle.spec.advances_by_itself() && !handle.snapshot().status.is_over()
        };
        self.in_line || self.handle.get().map_or(self.clocked, advances)
    }

    /// Evicts an idle episode, unless it has a running clock; false where it needs no slot any
    /// more.
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

    /// Evicts the episode, until there is a request for it or it is `ends_at`.
    fn vacate(&mut self, ends_at: Timestamp) {
        let place = std::mem::take(&mut self.handle);
        let Some(handle) = place.get() else { return };
        self.ends_at = Some(ends_at);
        self.clocked = handle.spec.advances_by_itself();
        self.leaving = Some(handle.gone());
        self.times = Some(handle.times());
    }
}
