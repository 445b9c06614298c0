//! The memory limit of all worlds and all answers together: `memory_bytes_max`.
//!
//! Bytes of large allocations are reserved first, and released by dropping the [`Reservation`].
//! Small ones always pass, so that running games can finish on a full server.
//!
//! Memory for games is shared between groups as unfinished episodes are ([`episode::quota`](crate::episode::quota)): a group may have as
//! much as is still free afterwards (`memory_of_free_percent_max`). So one group alone gets half, two get a
//! third each, and a new group finds some. The first game of a group may use all free memory.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

use crate::fair::Group;

/// An allocation of up to this size passes even where the budget is used up.
pub const SMALL_BYTES: usize = 64 * 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoMemory {
    #[error("the memory limit of all worlds and answers, {0} bytes, is reached")]
    All(usize),
    #[error(
        "these games have their share of the memory, {used} bytes: a competition, a key or an address may use as much as is free"
    )]
    Share {
        /// Bytes that the group has reserved.
        used: usize,
        /// A group may have reserved this percentage of the free bytes.
        percent: u32,
    },
}

impl NoMemory {
    /// The name of the limit and its value.
    pub const fn limit(self) -> (&'static str, usize) {
        match self {
            Self::All(most) => ("memory_bytes_max", most),
            Self::Share { percent, .. } => ("memory_of_free_percent_max", percent as usize),
        }
    }
}

#[derive(Debug)]
pub struct Budget {
    most: usize,
    of_free_percent: u32,
    used: Mutex<Used>,
}

#[derive(Debug, Default)]
struct Used {
    bytes: usize,
    /// The part of `bytes` that belongs to the games of each group.
    by_group: HashMap<Group, usize>,
}

impl Used {
    fn of(&self, group: Group) -> usize {
        self.by_group.get(&group).copied().unwrap_or(0)
    }

    fn add(&mut self, group: Option<Group>, bytes: usize) {
        self.bytes = self.bytes.saturating_add(bytes);
        if let Some(group) = group {
            *self.by_group.entry(group).or_default() += bytes;
        }
    }

    fn release(&mut self, group: Option<Group>, bytes: usize) {
        self.bytes -= bytes;
        let Some(group) = group else { return };
        let left = self.of(group).saturating_sub(bytes);
        if left == 0 {
            self.by_group.remove(&group);
        } else {
            self.by_group.insert(group, left);
        }
    }
}

impl Budget {
    /// A budget of `most` bytes. A group may use `of_free_percent` percent of the free bytes.
    pub fn new(most: usize, of_free_percent: u32) -> Arc<Self> {
        Arc::new(Self { most, of_free_percent, used: Mutex::default() })
    }
    pub fn unlimited() -> Arc<Self> {
        Self::new(usize::MAX, u32::MAX)
    }

    fn lock(&self) -> MutexGuard<'_, Used> {
        self.used.lock().expect("nothing panics while it holds this")
    }

    /// Reserves bytes if they are free and within the share of the group whose game they are for.
    pub fn reserve(
        self: &Arc<Self>,
        bytes: usize,
        group: Option<Group>,
    ) -> Result<Reservation, NoMemory> {
        let mut used = self.lock();
        self.check(&used, bytes, group)?;
        used.add(group, bytes);
        Ok(self.reservation(bytes, group))
    }
    pub fn has(&self, bytes: usize, group: Option<Group>) -> bool {
        self.check(&self.lock(), bytes, group).is_ok()
    }

    fn check(&self, used: &Used, bytes: usize, group: Option<Group>) -> Result<(), NoMemory> {
        let sum = used.bytes.checked_add(bytes).filter(|sum| *sum <= self.most);
        let free = self.most - sum.ok_or(NoMemory::All(self.most))?;
        // Programs on the server's own machine are not limited to a share.
        let Some(group) = group.filter(|group| *group != Group::Server) else { return Ok(()) };
        let (of_group, percent) = (used.of(group), self.of_free_percent);
        let share = free as u128 * u128::from(percent) / 100;
        if of_group == 0 || (of_group + bytes) as u128 <= share {
            return Ok(());
        }
        Err(NoMemory::Share { used: of_group, percent })
    }

    /// Reserves bytes, free or not.
    pub fn take(self: &Arc<Self>, bytes: usize, group: Option<Group>) -> Reservation {
        self.lock().add(group, bytes);
        self.reservation(bytes, group)
    }

    fn reservation(self: &Arc<Self>, bytes: usize, group: Option<Group>) -> Reservation {
        Reservation { budget: Arc::clone(self), group, bytes: AtomicUsize::new(bytes) }
    }
    pub fn used(&self) -> usize {
        self.lock().bytes
    }
    pub const fn most(&self) -> usize {
        self.most
    }
}

/// Bytes that are reserved until this is dropped.
#[derive(Debug)]
#[must_use]
pub struct Reservation {
    budget: Arc<Budget>,
    group: Option<Group>,
    bytes: AtomicUsize,
}

impl Reservation {
    /// Changes the number of reserved bytes, free or not: memory that is already in use cannot be refused.
    pub fn resize(&self, bytes: usize) {
        let mut used = self.budget.lock();
        let before = self.bytes.swap(bytes, Ordering::AcqRel);
        used.add(self.group, bytes);
        used.release(self.group, before);
    }
    pub fn bytes(&self) -> usize {
        self.bytes.load(Ordering::Acquire)
    }
    pub const fn group(&self) -> Option<Group> {
        self.group
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        let bytes = *self.bytes.get_mut();
        self.budget.lock().release(self.group, bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::OwnerKey;

    const ONE: Option<Group> = Some(Group::Owner(OwnerKey(1)));
    const TWO: Option<Group> = Some(Group::Owner(OwnerKey(2)));

    #[test]
    fn what_was_reserved_is_free_again_when_it_is_dropped() {
        let budget = Budget::new(100, 100);
        let first = budget.reserve(60, None).expect("free");
        assert_eq!(budget.reserve(41, None).err(), Some(NoMemory::All(100)));
        let second = budget.reserve(40, None).expect("free");
        drop(first);
        assert_eq!(budget.used(), 40);
        second.resize(90);
        assert_eq!((budget.used(), second.bytes()), (90, 90));
        second.resize(10);
        let beyond = budget.take(200, ONE);
        assert_eq!(budget.used(), 210);
        assert_eq!(budget.reserve(1, None).err(), Some(NoMemory::All(100)));
        drop((second, beyond));
        assert_eq!((budget.used(), budget.lock().by_group.len()), (0, 0));
    }

    #[test]
    fn a_sum_that_is_too_large_for_a_number_does_not_fit() {
        let budget = Budget::new(usize::MAX - 1, 100);
        let _some = budget.reserve(10, None).expect("free");
        assert!(budget.reserve(usize::MAX, None).is_err());
    }

    fn fill(budget: &Arc<Budget>, group: Option<Group>) -> (Vec<Reservation>, NoMemory) {
        let mut games = Vec::new();
        loop {
            match budget.reserve(10, group) {
                Ok(game) => games.push(game),
                Err(refused) => return (games, refused),
            }
        }
    }

    #[test]
    fn groups_share_memory_as_they_share_places() {
        let budget = Budget::new(1000, 100);
        let (games, refused) = fill(&budget, ONE);
        assert_eq!((games.len(), refused), (50, NoMemory::Share { used: 500, percent: 100 }));
        assert_eq!(refused.limit(), ("memory_of_free_percent_max", 100));
        let (others, _) = fill(&budget, TWO);
        assert_eq!(others.len(), 25);
        // Answers, and programs on the server's machine, take what is free.
        assert!(
            budget.reserve(100, None).is_ok() && budget.reserve(100, Some(Group::Server)).is_ok()
        );
        drop(games);
        assert_eq!(fill(&budget, TWO).0.len(), 25);
    }

    #[test]
    fn the_first_game_of_a_group_gets_what_is_free() {
        let budget = Budget::new(100, 100);
        let large = budget.reserve(80, ONE).expect("it is free");
        assert!(budget.reserve(1, ONE).is_err() && budget.reserve(20, TWO).is_ok());
        drop(large);
        assert!(budget.reserve(30, ONE).is_ok());
    }
}
