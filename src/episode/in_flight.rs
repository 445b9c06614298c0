//! Limits of acts in flight, by seat.
//!
//! An episode decides its acts one after another. Only a limited number of acts of a seat wait at once, from their arrival until
//! they are answered, so a seat that sends more than its game needs delays nobody but itself.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use swarmbench_engine::AgentId;

/// Acts of one seat that may wait at once, in several calls. One call may hold any number where no other act of the seat waits.
pub const SEAT_ACTS_WAITING_MAX: u32 = 16;

/// Number of waiting acts of each agent.
#[derive(Debug)]
pub(super) struct InFlightLimit(Box<[AtomicU32]>);

impl InFlightLimit {
    pub(super) fn new(agents: u16) -> Arc<Self> {
        Arc::new(Self((0..agents).map(|_| AtomicU32::new(0)).collect()))
    }

    /// Takes a permit for each act of a call. Returns the permits and, sorted, the agents that get none as too many of their acts
    /// wait already.
    pub(super) fn take(
        self: &Arc<Self>,
        acts: impl Iterator<Item = AgentId>,
    ) -> (InFlightPermits, Vec<AgentId>) {
        let mut counts = counted(acts);
        let mut refused = Vec::new();
        counts.retain(|(agent, count)| {
            let fits = |waiting: u32| {
                let all = waiting.saturating_add(*count);
                (waiting == 0 || all <= SEAT_ACTS_WAITING_MAX).then_some(all)
            };
            let waiting = &self.0[agent.index()];
            let taken = waiting.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits).is_ok();
            if !taken {
                refused.push(*agent);
            }
            taken
        });
        (InFlightPermits { limit: Arc::clone(self), counts }, refused)
    }
}

/// Number of times that each agent occurs, sorted by agent.
fn counted(agents: impl Iterator<Item = AgentId>) -> Vec<(AgentId, u32)> {
    let mut agents: Vec<AgentId> = agents.collect();
    agents.sort_unstable();
    let same = agents.chunk_by(|one, next| one == next);
    same.map(|same| (same[0], u32::try_from(same.len()).unwrap_or(u32::MAX))).collect()
}

/// Permits of acts in flight, returned on drop.
#[derive(Debug)]
pub(super) struct InFlightPermits {
    limit: Arc<InFlightLimit>,
    /// Sorted by agent.
    counts: Vec<(AgentId, u32)>,
}

impl InFlightPermits {
    /// Splits off permits for these acts, as far as there are any.
    pub(super) fn split(&mut self, acts: impl Iterator<Item = AgentId>) -> Self {
        let mut counts = counted(acts);
        for (agent, count) in &mut counts {
            let place = self.counts.binary_search_by_key(agent, |(agent, _)| *agent);
            let left = place.map(|place| &mut self.counts[place].1);
            *count = left.map_or(0, |left| {
                let taken = (*count).min(*left);
                *left -= taken;
                taken
            });
        }
        Self { limit: Arc::clone(&self.limit), counts }
    }
}

impl Drop for InFlightPermits {
    fn drop(&mut self) {
        for (agent, count) in &self.counts {
            self.limit.0[agent.index()].fetch_sub(*count, Ordering::AcqRel);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: AgentId = AgentId(0);
    const OTHER: AgentId = AgentId(1);

    fn times(agent: AgentId, count: u32) -> impl Iterator<Item = AgentId> {
        (0..count).map(move |_| agent)
    }

    #[test]
    fn a_seat_fills_its_own_places_and_no_others() {
        let limit = InFlightLimit::new(2);
        let (all, refused) = limit.take(times(ONE, SEAT_ACTS_WAITING_MAX));
        assert!(refused.is_empty());
        let (more, refused) = limit.take([ONE, OTHER].into_iter());
        assert_eq!(refused, [ONE]);
        drop(all);
        // The other seat's permit is still held, and counts for that seat alone.
        let (_, refused) = limit.take(times(ONE, 1).chain(times(OTHER, SEAT_ACTS_WAITING_MAX)));
        assert_eq!(refused, [OTHER]);
        drop(more);
        assert!(limit.take(times(OTHER, SEAT_ACTS_WAITING_MAX)).1.is_empty());
    }

    #[test]
    fn one_call_may_hold_many_acts_and_gives_back_what_it_took() {
        let limit = InFlightLimit::new(2);
        let (mut all, refused) = limit.take(times(ONE, 1024).chain(times(OTHER, 3)));
        assert!(refused.is_empty());
        assert_eq!(limit.take(times(ONE, 1)).1, [ONE]);
        let part = all.split(times(ONE, 1020).chain(times(OTHER, 9)));
        drop(all);
        let counts =
            || limit.0.iter().map(|count| count.load(Ordering::Relaxed)).collect::<Vec<_>>();
        assert_eq!(counts(), [1020, 3]);
        drop(part);
        assert_eq!(counts(), [0, 0]);
    }
}
