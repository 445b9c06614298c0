//! Budgets of scarce amounts that are shared fairly: memory of worlds, answers and bodies, event streams, open exports.
//!
//! An amount is reserved before its use, and freed when its [`Reservation`] is dropped. A group may have as much as is free
//! afterwards, as with unfinished episodes ([`episode::quota`](crate::episode::quota)): one group alone gets half, two get a third
//! each, and a new group finds some. An entrant may have as much as its competition could still get. The first reservation of a
//! group may use everything that is free.
//!
//! A reserve on top is for urgent requests: of organizers and judges for streams and exports, with a token for bodies. The reserve
//! of memory is for their exports and for small amounts ([`Budget::squeeze`]), so that running games can finish on a full server.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

use crate::fair::{Group, Party, Rank};

/// Largest amount, in bytes, that may come from the memory reserve where the rest is used up.
pub const SMALL_BYTES: usize = 64 * 1024;

/// Bytes that a party gets from the reserve whatever its group uses: enough for some games of the standard setting.
pub const FIRST_BYTES: usize = 4 * SMALL_BYTES;

/// Reason why an amount is not reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Exhausted {
    #[error("{name}, {most} in all, is used up")]
    All { name: &'static str, most: usize },
    #[error(
        "{used} of {name}, {most} in all, are used here already: a competition, a key or an address may use as much as is free"
    )]
    Share {
        name: &'static str,
        most: usize,
        /// Amount that the party uses.
        used: usize,
    },
}

impl Exhausted {
    /// Name and value of the limit.
    pub const fn limit(self) -> (&'static str, usize) {
        let (Self::All { name, most } | Self::Share { name, most, .. }) = self;
        (name, most)
    }
}

/// A limited amount, with the name of its limit.
#[derive(Debug)]
pub struct Budget {
    name: &'static str,
    most: usize,
    reserve: usize,
    used: Mutex<Used>,
}

/// Reserved amounts.
#[derive(Debug, Default)]
struct Used {
    sum: usize,
    by_group: HashMap<Group, usize>,
    /// Amounts of parties that are members of a group.
    by_member: HashMap<Party, usize>,
}

impl Used {
    fn add(&mut self, party: Option<Party>, amount: usize) {
        self.sum = self.sum.saturating_add(amount);
        let Some(party) = party.filter(|_| amount > 0) else { return };
        *self.by_group.entry(party.group).or_default() += amount;
        if party.member.is_some() {
            *self.by_member.entry(party).or_default() += amount;
        }
    }

    fn of_group(&self, party: Party) -> usize {
        self.by_group.get(&party.group).copied().unwrap_or(0)
    }

    fn of_member(&self, party: Party) -> usize {
        self.by_member.get(&party).copied().unwrap_or(0)
    }

    fn release(&mut self, party: Option<Party>, amount: usize) {
        self.sum -= amount;
        let Some(party) = party else { return };
        release(&mut self.by_group, &party.group, amount);
        release(&mut self.by_member, &party, amount);
    }
}

/// Subtracts an amount from an account, and removes an account with 0.
fn release<K: Eq + Hash>(accounts: &mut HashMap<K, usize>, name: &K, amount: usize) {
    if let Some(used) = accounts.get_mut(name) {
        *used -= amount;
        if *used == 0 {
            accounts.remove(name);
        }
    }
}

impl Budget {
    /// A budget of `most`, with `reserve` on top for urgent requests.
    pub fn new(name: &'static str, most: usize, reserve: usize) -> Arc<Self> {
        Arc::new(Self { name, most, reserve, used: Mutex::default() })
    }

    /// Budget for the memory of worlds and answers, with a reserve for small amounts. Bodies have a budget of their own.
    pub fn memory(bytes: usize) -> Arc<Self> {
        Self::new("memory_bytes_max", bytes, bytes / 4)
    }

    pub fn unlimited() -> Arc<Self> {
        Self::new("memory_bytes_max", usize::MAX, 0)
    }

    fn lock(&self) -> MutexGuard<'_, Used> {
        self.used.lock().expect("nothing panics while it holds this")
    }

    /// Reserves an amount if it is free, and within the share of the party if one is named.
    pub fn reserve(
        self: &Arc<Self>,
        amount: usize,
        party: Option<Party>,
        rank: Rank,
    ) -> Result<Reservation, Exhausted> {
        let reservation = self.take(0, party);
        reservation.grow(amount, rank)?;
        Ok(reservation)
    }

    /// Whether this amount could be reserved now.
    pub fn has(&self, amount: usize, party: Option<Party>) -> bool {
        self.check(&self.lock(), amount, party, Rank::Normal).is_ok()
    }

    fn check(
        &self,
        used: &Used,
        amount: usize,
        party: Option<Party>,
        rank: Rank,
    ) -> Result<(), Exhausted> {
        let &Self { name, most, reserve, .. } = self;
        let all = if rank == Rank::Urgent { most.saturating_add(reserve) } else { most };
        let sum = used.sum.checked_add(amount).filter(|sum| *sum <= all);
        let free = all - sum.ok_or(Exhausted::All { name, most })?;
        // Programs on the server's own machine are not limited to a share.
        let Some(party) = party.filter(|party| party.group != Group::Server) else {
            return Ok(());
        };
        let of_group = used.of_group(party);
        let exceeds = |used: usize, share: usize| used > 0 && used + amount > share;
        if exceeds(of_group, free) {
            return Err(Exhausted::Share { name, most, used: of_group });
        }
        let of_member = used.of_member(party);
        // The share of a member is as much as the group could still get.
        if exceeds(of_member, free.saturating_sub(of_group + amount) / 2 + amount) {
            return Err(Exhausted::Share { name, most, used: of_member });
        }
        Ok(())
    }

    /// Reserves an amount from the reserve, if that has enough. Beyond [`FIRST_BYTES`] a party gets no more than its share.
    pub fn squeeze(
        self: &Arc<Self>,
        amount: usize,
        party: Option<Party>,
    ) -> Result<Reservation, Exhausted> {
        let mut used = self.lock();
        let of_party = party.map_or(0, |party| match party.member {
            Some(_) => used.of_member(party),
            None => used.of_group(party),
        });
        let shares = party.filter(|_| of_party + amount > FIRST_BYTES);
        self.check(&used, amount, shares, Rank::Urgent)?;
        used.add(party, amount);
        Ok(self.reservation(amount, party))
    }

    /// Reserves an amount, free or not.
    pub fn take(self: &Arc<Self>, amount: usize, party: Option<Party>) -> Reservation {
        self.lock().add(party, amount);
        self.reservation(amount, party)
    }

    fn reservation(self: &Arc<Self>, amount: usize, party: Option<Party>) -> Reservation {
        Reservation { budget: Arc::clone(self), party, amount: AtomicUsize::new(amount) }
    }

    pub fn used(&self) -> usize {
        self.lock().sum
    }

    pub const fn most(&self) -> usize {
        self.most
    }
}

/// An amount that is reserved until this is dropped.
#[derive(Debug)]
#[must_use]
pub struct Reservation {
    budget: Arc<Budget>,
    party: Option<Party>,
    amount: AtomicUsize,
}

impl Reservation {
    /// Changes the reserved amount, free or not: memory that is already in use cannot be refused.
    pub fn resize(&self, amount: usize) {
        let mut used = self.budget.lock();
        let before = self.amount.swap(amount, Ordering::AcqRel);
        used.add(self.party, amount);
        used.release(self.party, before);
    }

    /// Reserves more, within the same bounds as a first reservation.
    pub fn grow(&self, more: usize, rank: Rank) -> Result<(), Exhausted> {
        let mut used = self.budget.lock();
        self.budget.check(&used, more, self.party, rank)?;
        self.amount.fetch_add(more, Ordering::AcqRel);
        used.add(self.party, more);
        Ok(())
    }

    pub fn amount(&self) -> usize {
        self.amount.load(Ordering::Acquire)
    }

    pub const fn party(&self) -> Option<Party> {
        self.party
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        let amount = *self.amount.get_mut();
        self.budget.lock().release(self.party, amount);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::CompetitionKey;
    use crate::keys::OwnerKey;

    const ONE: Option<Party> = Some(Party::of(Group::Owner(OwnerKey(1))));
    const TWO: Option<Party> = Some(Party::of(Group::Owner(OwnerKey(2))));

    fn entrant(number: i64) -> Party {
        Party::entrant(CompetitionKey(1), OwnerKey(number))
    }

    fn all(most: usize) -> Exhausted {
        Exhausted::All { name: "things_max", most }
    }

    #[test]
    fn what_was_reserved_is_free_again_when_it_is_dropped() {
        let budget = Budget::new("things_max", 100, 0);
        let first = budget.reserve(60, None, Rank::Normal).expect("free");
        assert_eq!(budget.reserve(41, None, Rank::Normal).err(), Some(all(100)));
        let second = budget.reserve(40, None, Rank::Normal).expect("free");
        drop(first);
        assert_eq!(budget.used(), 40);
        second.resize(90);
        assert_eq!((budget.used(), second.amount()), (90, 90));
        second.resize(10);
        let beyond = budget.take(200, Some(entrant(1)));
        assert_eq!(budget.used(), 210);
        assert_eq!(budget.reserve(1, None, Rank::Normal).err(), Some(all(100)));
        drop((second, beyond));
        let used = budget.lock();
        assert_eq!((used.sum, used.by_group.len(), used.by_member.len()), (0, 0, 0));
    }

    #[test]
    fn a_sum_that_is_too_large_for_a_number_does_not_fit() {
        let budget = Budget::new("things_max", usize::MAX - 1, 0);
        let _some = budget.reserve(10, None, Rank::Normal).expect("free");
        assert!(budget.reserve(usize::MAX, None, Rank::Normal).is_err());
    }

    #[test]
    fn the_reserve_is_for_urgent_requests_and_for_what_is_small() {
        let budget = Budget::new("things_max", 100, 20);
        let _most = budget.reserve(100, ONE, Rank::Normal).expect("free");
        assert_eq!(budget.reserve(1, TWO, Rank::Normal).err(), Some(all(100)));
        let _urgent = budget.reserve(12, TWO, Rank::Urgent).expect("the reserve");
        let small = budget.squeeze(8, ONE).expect("the rest of it");
        assert_eq!(budget.squeeze(1, ONE).err(), Some(all(100)));
        drop(small);
        assert!(budget.reserve(8, TWO, Rank::Urgent).is_err(), "a share of what is free");
    }

    #[test]
    fn small_amounts_beyond_the_first_are_shared_in_the_reserve_too() {
        let budget = Budget::memory(8 * FIRST_BYTES);
        let _most = budget.take(8 * FIRST_BYTES, ONE);
        let refused =
            |party| matches!(budget.squeeze(SMALL_BYTES, party), Err(Exhausted::Share { .. }));
        assert!(refused(ONE));
        let first = [(); 4].map(|()| budget.squeeze(SMALL_BYTES, TWO).expect("its first"));
        assert!(refused(TWO), "another one gets as much");
        drop(first);
        assert!(!refused(TWO));
    }

    fn fill(budget: &Arc<Budget>, party: Option<Party>) -> (Vec<Reservation>, Exhausted) {
        let mut games = Vec::new();
        loop {
            match budget.reserve(10, party, Rank::Normal) {
                Ok(game) => games.push(game),
                Err(refused) => return (games, refused),
            }
        }
    }

    #[test]
    fn groups_share_memory_as_they_share_places() {
        let budget = Budget::memory(1000);
        let (games, refused) = fill(&budget, ONE);
        assert_eq!((games.len(), refused.limit()), (50, ("memory_bytes_max", 1000)));
        let (others, _) = fill(&budget, TWO);
        assert_eq!(others.len(), 25);
        // Answers, and programs on the server's machine, take what is free.
        let server = Some(Party::SERVER);
        assert!([None, server].map(|party| budget.has(100, party)).into_iter().all(|has| has));
        drop(games);
        assert_eq!(fill(&budget, TWO).0.len(), 25);
    }

    #[test]
    fn the_members_of_a_group_share_its_part() {
        let budget = Budget::new("things_max", 1000, 0);
        let counts: Vec<_> = (0..3).map(|number| fill(&budget, Some(entrant(number))).0).collect();
        let counts: Vec<_> = counts.iter().map(Vec::len).collect();
        assert_eq!(counts, [25, 13, 6]);
        assert!(budget.has(500, ONE), "another group gets half of what is left");
    }

    #[test]
    fn the_first_game_of_a_group_gets_what_is_free() {
        let budget = Budget::memory(100);
        let large = budget.reserve(80, ONE, Rank::Normal).expect("it is free");
        assert!(!budget.has(1, ONE) && budget.has(20, TWO));
        drop(large);
        assert!(budget.has(30, ONE));
    }
}
