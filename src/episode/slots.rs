//! Slots of all episodes. The sweep of every minute visits only awake and due episodes, so any number of unfinished episodes
//! without requests costs the same.

use std::collections::hash_map::Entry;
use std::collections::{BTreeSet, HashMap, HashSet};

use jiff::Timestamp;

use super::slot::Slot;
use crate::ids::EpisodeId;

#[derive(Default)]
pub(super) struct Slots {
    by_id: HashMap<EpisodeId, Slot>,
    /// Episodes in memory, and episodes requested since they were evicted. All others rest.
    awake: HashSet<EpisodeId>,
    /// Ends of resting episodes, as in the `listed_at` of their slots. Ends of episodes that were requested since then are out of
    /// date.
    ends: BTreeSet<(Timestamp, EpisodeId)>,
}

impl Slots {
    pub(super) fn get(&self, id: &EpisodeId) -> Option<&Slot> {
        self.by_id.get(id)
    }

    pub(super) fn get_mut(&mut self, id: &EpisodeId) -> Option<&mut Slot> {
        self.by_id.get_mut(id)
    }

    /// Marks an episode as awake, as it may be in memory from now on. Returns its slot, if it has one.
    pub(super) fn wake(&mut self, id: &EpisodeId) -> Option<&mut Slot> {
        let slot = self.by_id.get_mut(id)?;
        if !self.awake.contains(id) {
            self.awake.insert(id.clone());
        }
        Some(slot)
    }

    /// Like [`Slots::wake`], but inserts a slot if the episode has none.
    pub(super) fn wake_or_insert(&mut self, id: &EpisodeId, now: Timestamp) -> &mut Slot {
        self.awake.insert(id.clone());
        self.by_id.entry(id.clone()).or_insert_with(|| Slot::empty(now))
    }

    /// Adds an unfinished episode that is not in memory and whose end is not known. Returns whether it is new.
    pub(super) fn add_unfinished(&mut self, id: &EpisodeId, now: Timestamp, clocked: bool) -> bool {
        let (slot, is_new) = match self.by_id.entry(id.clone()) {
            Entry::Occupied(slot) => (slot.into_mut(), false),
            Entry::Vacant(free) => (free.insert(Slot::empty(now)), true),
        };
        slot.clocked = clocked;
        slot.in_line = clocked;
        self.set_end(id, now);
        is_new
    }

    /// Sets the end of a resting episode.
    pub(super) fn set_end(&mut self, id: &EpisodeId, at: Timestamp) {
        if let Some(slot) = self.by_id.get_mut(id) {
            slot.ends_at = Some(at);
            list(&mut self.ends, id, slot);
        }
    }

    /// Removes an unused slot, of an episode that is neither in memory nor known to be unfinished.
    pub(super) fn remove_unused(&mut self, id: &EpisodeId) {
        let slot = self.by_id.get(id);
        if slot.is_some_and(|slot| {
            !slot.is_held() && !slot.handle.initialized() && slot.ends_at.is_none()
        }) {
            self.remove(id);
        }
    }

    pub(super) fn remove(&mut self, id: &EpisodeId) {
        self.awake.remove(id);
        if let Some(slot) = self.by_id.remove(id) {
            unlist(&mut self.ends, id, &slot);
        }
    }

    pub(super) fn all(&self) -> impl Iterator<Item = (&EpisodeId, &Slot)> {
        self.by_id.iter()
    }

    pub(super) fn awake(&self) -> impl Iterator<Item = (&EpisodeId, &Slot)> {
        self.awake.iter().filter_map(|id| Some((id, self.by_id.get(id)?)))
    }

    /// Visits the awake slots, and removes those for which `visit` returns false. Evicted episodes rest afterwards.
    pub(super) fn visit_awake(&mut self, mut visit: impl FnMut(&mut Slot) -> bool) {
        let Self { by_id, awake, ends } = self;
        awake.retain(|id| {
            let Some(slot) = by_id.get_mut(id) else { return false };
            if !visit(slot) {
                unlist(ends, id, slot);
                by_id.remove(id);
                return false;
            }
            if slot.rests() {
                list(ends, id, slot);
                return false;
            }
            true
        });
    }

    /// Resting episodes that end by `now` and are wanted, earliest end first, and whether each advances by itself.
    pub(super) fn due(
        &mut self,
        now: Timestamp,
        is_wanted: impl Fn(&Slot) -> bool,
    ) -> Vec<(EpisodeId, bool)> {
        let (mut due, mut outdated) = (Vec::new(), Vec::new());
        for (at, id) in self.ends.iter().take_while(|(at, _)| *at <= now) {
            let slot = self.by_id.get(id);
            match slot.filter(|slot| !slot.handle.initialized() && slot.ends_at == Some(*at)) {
                Some(slot) if is_wanted(slot) => due.push((id.clone(), slot.clocked)),
                Some(_) => {}
                None => outdated.push((*at, id.clone())),
            }
        }
        for end in outdated {
            if let Some(slot) = self.by_id.get_mut(&end.1) {
                slot.listed_at = None;
            }
            self.ends.remove(&end);
        }
        due
    }
}

/// Lists the end of an episode, in place of an earlier one.
fn list(ends: &mut BTreeSet<(Timestamp, EpisodeId)>, id: &EpisodeId, slot: &mut Slot) {
    if slot.listed_at != slot.ends_at {
        unlist(ends, id, slot);
        ends.extend(slot.ends_at.map(|at| (at, id.clone())));
        slot.listed_at = slot.ends_at;
    }
}

fn unlist(ends: &mut BTreeSet<(Timestamp, EpisodeId)>, id: &EpisodeId, slot: &Slot) {
    if let Some(at) = slot.listed_at {
        ends.remove(&(at, id.clone()));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    fn id(number: u32) -> EpisodeId {
        EpisodeId::from_text(format!("ep_{number}"))
    }

    fn second(second: i64) -> Timestamp {
        Timestamp::from_second(second).expect("a time")
    }

    /// Episodes due at a second, and the number of ends listed then.
    fn due(slots: &mut Slots, at: i64) -> (Vec<EpisodeId>, usize) {
        let due = slots.due(second(at), |slot| !slot.in_line);
        (due.into_iter().map(|(id, _)| id).collect(), slots.ends.len())
    }

    #[test]
    fn resting_episodes_are_due_at_their_ends_and_not_visited() {
        let mut slots = Slots::default();
        for number in 0..3 {
            assert!(slots.add_unfinished(&id(number), second(0), number == 2));
        }
        assert!(!slots.add_unfinished(&id(0), second(0), false));
        assert_eq!(due(&mut slots, 0), (vec![id(0), id(1)], 3), "the third is in line");
        slots.set_end(&id(0), second(10));
        slots.set_end(&id(1), second(5));
        slots.visit_awake(|_| panic!("all of them rest"));
        assert_eq!(due(&mut slots, 4), (vec![], 3));
        assert_eq!(due(&mut slots, 10), (vec![id(1), id(0)], 3));
        slots.remove(&id(1));
        assert_eq!(due(&mut slots, 10), (vec![id(0)], 2));
    }

    #[test]
    fn a_requested_episode_is_awake_until_nobody_asks_for_it() {
        let mut slots = Slots::default();
        slots.add_unfinished(&id(0), second(10), false);
        let requested = Arc::clone(&slots.wake(&id(0)).expect("it has a slot").handle);
        let mut visits = 0;
        let mut visit = |slots: &mut Slots| {
            slots.visit_awake(|_| {
                visits += 1;
                true
            });
            visits
        };
        assert_eq!((visit(&mut slots), visit(&mut slots)), (1, 2));
        drop(requested);
        assert_eq!((visit(&mut slots), visit(&mut slots)), (3, 3));
        // A later end replaces the one that is listed.
        slots.wake(&id(0)).expect("it has a slot").ends_at = Some(second(20));
        visit(&mut slots);
        assert_eq!(due(&mut slots, 10), (vec![], 1));
        assert_eq!(due(&mut slots, 20), (vec![id(0)], 1));
        // An ended episode stays listed until then at the latest.
        slots.wake(&id(0)).expect("it has a slot").ends_at = None;
        assert_eq!(due(&mut slots, 20), (vec![], 0));
        slots.visit_awake(|_| false);
        assert!(slots.get(&id(0)).is_none() && slots.awake.is_empty());
    }
}
