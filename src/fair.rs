//! Fair scheduling of scarce resources between parties.
//!
//! A [`Party`] is a member of a group: an entrant of a competition, the holder of a key, an address. Shares are equal between
//! groups first and between the members of a group second, so that a competition with a thousand free keys gets no more than a
//! single key does. [`FairQueue`] decides which request is next, and is pure; [`FairLimit`] uses it for permits of async code, and
//! [`work`](crate::work) for jobs.

use std::cell::Cell;
use std::collections::{BTreeSet, HashMap, VecDeque};
use std::hash::Hash;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use crate::ids::CompetitionKey;
use crate::keys::OwnerKey;

/// Unit that gets an equal share first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Group {
    Server,
    Competition(CompetitionKey),
    Owner(OwnerKey),
    /// Clients without a key, by address, or by /48 network of IPv6.
    Address(IpAddr),
}

/// Beneficiary of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Party {
    pub group: Group,
    /// The entrant, where the group is a competition.
    pub member: Option<OwnerKey>,
}

tokio::task_local! {
    static CURRENT: Cell<Party>;
    static RANK: Rank;
}

impl Party {
    /// Party of work that no request asked for.
    pub const SERVER: Self = Self::of(Group::Server);

    /// A group that is its own only member.
    pub const fn of(group: Group) -> Self {
        Self { group, member: None }
    }
    pub const fn entrant(competition: CompetitionKey, owner: OwnerKey) -> Self {
        Self { group: Group::Competition(competition), member: Some(owner) }
    }

    /// Party of the request that this task handles; the server if it handles none.
    pub fn current() -> Self {
        CURRENT.try_with(Cell::get).unwrap_or(Self::SERVER)
    }

    pub async fn scope<F: Future>(self, future: F) -> F::Output {
        CURRENT.scope(Cell::new(self), future).await
    }

    /// Changes the party for the rest of the request, once more is known about the caller.
    pub fn refine(self) {
        // Outside of a request there is no caller.
        let _ = CURRENT.try_with(|current| current.set(self));
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rank {
    /// A running game waits for the work: it may use the reserve and is served first.
    Urgent,
    Normal,
}

impl Rank {
    /// Ranks in the order in which they are served.
    const ALL: [Self; 2] = [Self::Urgent, Self::Normal];

    /// Rank of the request that this task handles. Work that no request asked for is urgent, as games wait for it.
    pub fn current() -> Self {
        RANK.try_with(|rank| *rank).unwrap_or(Self::Urgent)
    }

    pub async fn scope<F: Future>(self, future: F) -> F::Output {
        RANK.scope(self, future).await
    }
}

/// Party and rank of a task, for work outside of it, such as the body of an answer.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    party: Party,
    rank: Rank,
}

impl Origin {
    pub fn current() -> Self {
        Self::of(Party::current(), Rank::current())
    }

    pub const fn of(party: Party, rank: Rank) -> Self {
        Self { party, rank }
    }

    /// Runs a future for this party and with this rank.
    pub async fn scope<F: Future>(self, future: F) -> F::Output {
        self.rank.scope(self.party.scope(future)).await
    }

    /// Runs `work` for this party and with this rank.
    pub fn enter<T>(self, work: impl FnOnce() -> T) -> T {
        RANK.sync_scope(self.rank, || CURRENT.sync_scope(Cell::new(self.party), work))
    }
}

/// Requests of one kind of heavy work that run at once: large answers, large bodies, parts of journals and exports, reads of the
/// database, rounds of hosted players. Each kind has its own [`FairLimit`].
pub const HEAVY_AT_ONCE_MAX: usize = 4;

/// Name of the limit [`HEAVY_AT_ONCE_MAX`].
pub const HEAVY_AT_ONCE: &str = "heavy_at_once_max";

/// Replays and recoveries that run at once; each may take as much memory as some rounds have text.
pub const REPLAYS_MAX: usize = 16;

/// Requests of each rank that may wait for one scarce resource.
pub const WAITING_MAX: usize = 4096;

/// Requests of one group among them.
pub const WAITING_PER_GROUP_MAX: usize = WAITING_MAX / 4;

/// Number of slots, and limits of how many one party may use.
#[derive(Clone, Copy, Debug)]
pub struct Shares {
    /// Slots in use at once.
    pub slots: usize,
    /// Slots among them that only urgent requests may use.
    pub reserve: usize,
    pub slots_per_group: usize,
    /// Slots of each member, in a group with members: each entrant of a competition.
    pub slots_per_member: usize,
    /// Slots of a group that is its own only member, such as the owner of a key.
    pub slots_per_single: usize,
    /// Requests of each rank that may wait at once.
    pub waiting: usize,
    /// Requests of one group and rank that may wait at once.
    pub waiting_per_group: usize,
}

impl Shares {
    const fn slots_of_member(&self, group: Group) -> usize {
        match group {
            Group::Competition(_) => self.slots_per_member,
            _ => self.slots_per_single,
        }
    }

    /// Shares without limits for a party, and with the usual number of waiting requests.
    pub const fn of(slots: usize) -> Self {
        Self {
            slots,
            reserve: 0,
            slots_per_group: slots,
            slots_per_member: slots,
            slots_per_single: slots,
            waiting: WAITING_MAX,
            waiting_per_group: WAITING_PER_GROUP_MAX,
        }
    }

    /// Shares with at most half of the slots for a group, and for a member.
    pub const fn halved(slots: usize) -> Self {
        let half = slots.div_ceil(2);
        Self {
            slots_per_group: half,
            slots_per_member: half,
            slots_per_single: half,
            ..Self::of(slots)
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ranked<T> {
    urgent: T,
    normal: T,
}

impl<T> Ranked<T> {
    const fn of(&self, rank: Rank) -> &T {
        match rank {
            Rank::Urgent => &self.urgent,
            Rank::Normal => &self.normal,
        }
    }

    const fn of_mut(&mut self, rank: Rank) -> &mut T {
        match rank {
            Rank::Urgent => &mut self.urgent,
            Rank::Normal => &mut self.normal,
        }
    }
}

impl Ranked<usize> {
    const fn all(self) -> usize {
        self.urgent + self.normal
    }
}

/// Requests of a member, or of all members of a group.
trait Requests {
    /// Whether a request of this rank may have a slot, as far as the members' shares allow.
    fn is_ready(&self, rank: Rank) -> bool;
    fn is_empty(&self) -> bool;
}

/// Requests of a member, in order.
#[derive(Debug)]
struct Line<T>(Ranked<VecDeque<T>>);

impl<T> Requests for Line<T> {
    fn is_ready(&self, rank: Rank) -> bool {
        !self.0.of(rank).is_empty()
    }

    fn is_empty(&self) -> bool {
        self.0.urgent.is_empty() && self.0.normal.is_empty()
    }
}

impl<T> Line<T> {
    /// Drops unwanted requests, and returns their number.
    fn retain(&mut self, is_wanted: &mut impl FnMut(&T) -> bool) -> Ranked<usize> {
        let mut dropped = Ranked::default();
        for rank in Rank::ALL {
            let queue = self.0.of_mut(rank);
            let before = queue.len();
            queue.retain(&mut *is_wanted);
            *dropped.of_mut(rank) = before - queue.len();
        }
        dropped
    }
}

#[derive(Debug)]
struct Members<T> {
    waiting: Ranked<usize>,
    accounts: Accounts<Option<OwnerKey>, Line<T>>,
    /// Number of idle members at the last count.
    idle: usize,
}

impl<T> Requests for Members<T> {
    fn is_ready(&self, rank: Rank) -> bool {
        !self.accounts.order.ready.of(rank).is_empty()
    }

    fn is_empty(&self) -> bool {
        self.waiting.all() == 0
    }
}

impl<T> Members<T> {
    fn new(slots_per_member: usize) -> Self {
        let accounts = Accounts::new(slots_per_member);
        Self { waiting: Ranked::default(), accounts, idle: 0 }
    }

    fn retain(&mut self, is_wanted: &mut impl FnMut(&T) -> bool) -> Ranked<usize> {
        let mut dropped = Ranked::default();
        for name in self.accounts.waiting() {
            let of_member = self.accounts.change(name, |line| line.requests.retain(is_wanted));
            for rank in Rank::ALL {
                *dropped.of_mut(rank) += of_member.of(rank);
                *self.waiting.of_mut(rank) -= of_member.of(rank);
            }
        }
        dropped
    }
}

/// Use and requests of a group or a member.
#[derive(Debug)]
struct Account<R> {
    running: usize,
    used: Duration,
    /// Number of the account that began to wait, among all that did.
    since: u64,
    requests: R,
}

impl<R: Requests> Account<R> {
    fn is_idle(&self) -> bool {
        self.running == 0 && self.requests.is_empty()
    }
}

/// Accounts of groups, or of the members of one group.
#[derive(Debug)]
struct Accounts<K, R> {
    /// Slots of each account at once.
    slots: usize,
    known: HashMap<K, Account<R>>,
    order: Order<K>,
    /// Usage with which new accounts start: at least that of the account that was served last, and what each account would have used
    /// if those that wait or run had shared all usage equally. So accounts that come only once do not stay before one that comes back.
    floor: Duration,
    /// Accounts that have begun to wait so far.
    arrivals: u64,
}

/// Order in which accounts are served. Reading the first takes constant time, a change logarithmic time.
#[derive(Debug, PartialEq)]
struct Order<K> {
    /// Accounts that may have a slot: by slots in use, then by usage, then as they came.
    ready: Ranked<BTreeSet<(usize, Duration, u64, K)>>,
    /// Accounts without requests, waiting or running, by usage.
    idle: BTreeSet<(Duration, K)>,
}

impl<K: Copy + Ord> Order<K> {
    fn add<R: Requests>(&mut self, name: K, account: &Account<R>, slots: usize) {
        let Account { running, used, since, ref requests } = *account;
        for rank in Rank::ALL {
            if running < slots && requests.is_ready(rank) {
                self.ready.of_mut(rank).insert((running, used, since, name));
            }
        }
        if account.is_idle() {
            self.idle.insert((used, name));
        }
    }

    fn remove<R>(&mut self, name: K, account: &Account<R>) {
        for rank in Rank::ALL {
            self.ready.of_mut(rank).remove(&(account.running, account.used, account.since, name));
        }
        self.idle.remove(&(account.used, name));
    }
}

impl<K: Copy + Ord + Hash, R: Requests> Accounts<K, R> {
    fn new(slots: usize) -> Self {
        let ready = Ranked { urgent: BTreeSet::new(), normal: BTreeSet::new() };
        let order = Order { ready, idle: BTreeSet::new() };
        Self { slots, known: HashMap::new(), order, floor: Duration::ZERO, arrivals: 0 }
    }

    /// Changes a known account, and its place in the order.
    fn change<T>(&mut self, name: K, change: impl FnOnce(&mut Account<R>) -> T) -> T {
        let account = self.known.get_mut(&name).expect("an account that waits or runs is known");
        self.order.remove(name, account);
        let result = change(account);
        self.order.add(name, account, self.slots);
        result
    }

    /// Adds a request to an account, which may be new. A known account has used at least as much as a new one starts with: it is
    /// forgotten once the others have caught up with it.
    fn add(&mut self, name: K, new: impl FnOnce() -> R, add: impl FnOnce(&mut R)) {
        let (floor, since) = (self.floor, self.arrivals);
        self.arrivals += 1;
        let begin = || Account { running: 0, used: floor, since, requests: new() };
        self.known.entry(name).or_insert_with(begin);
        self.change(name, |account| {
            if account.requests.is_empty() {
                account.since = since;
            }
            add(&mut account.requests);
        });
    }

    /// Gives a slot to the next account, and takes one of its requests.
    fn pop<T>(&mut self, rank: Rank, take: impl FnOnce(&mut R) -> T) -> Option<(K, T)> {
        let (_, used, _, name) = *self.order.ready.of(rank).first()?;
        self.floor = self.floor.max(used);
        let request = self.change(name, |account| {
            account.running += 1;
            take(&mut account.requests)
        });
        Some((name, request))
    }

    /// Frees a slot of an account.
    fn done(&mut self, name: K, used: Duration, then: impl FnOnce(&mut R)) {
        let active = self.known.len() - self.order.idle.len();
        self.floor += used / u32::try_from(active).unwrap_or(u32::MAX);
        self.change(name, |account| {
            account.running -= 1;
            account.used += used;
            then(&mut account.requests);
        });
    }

    fn waiting(&self) -> Vec<K> {
        let waiting = |(_, account): &(&K, &Account<R>)| !account.requests.is_empty();
        self.known.iter().filter(waiting).map(|(name, _)| *name).collect()
    }

    /// Forgets the idle account with the least usage.
    fn forget(&mut self) -> Option<R> {
        let (_, name) = self.order.idle.pop_first()?;
        self.known.remove(&name).map(|account| account.requests)
    }

    /// Forgets an idle account with which the others have caught up: a new one would start with the same usage.
    fn forget_caught_up(&mut self) -> Option<R> {
        let is_behind = self.order.idle.first().is_some_and(|(used, _)| *used <= self.floor);
        if is_behind { self.forget() } else { None }
    }
}

/// Idle groups and members, together, whose usage is remembered. Beyond this number the one with the least usage is forgotten, and
/// starts like a new one when it comes back.
pub const PARTIES_REMEMBERED_MAX: usize = 16_384;

/// A queue of requests for slots, in the order in which they get one.
///
/// The next group is the one with the fewest slots in use, among equals the one that has used slots for the least time, and among
/// equals the one that came first. The same holds for the members of the group. A group that returns after a pause starts at what
/// each of the others has used since, so that a pause gives no advantage.
///
/// Every operation except [`FairQueue::retain`] takes time logarithmic in the number of groups and members.
#[derive(Debug)]
pub struct FairQueue<T> {
    shares: Shares,
    running: usize,
    running_normal: usize,
    waiting: Ranked<usize>,
    groups: Accounts<Group, Members<T>>,
    /// Idle members of all groups.
    idle_members: usize,
}

impl<T> FairQueue<T> {
    pub fn new(shares: Shares) -> Self {
        Self {
            shares,
            running: 0,
            running_normal: 0,
            waiting: Ranked::default(),
            groups: Accounts::new(shares.slots_per_group),
            idle_members: 0,
        }
    }

    /// Number of waiting requests.
    pub const fn waiting(&self) -> usize {
        self.waiting.all()
    }

    /// Number of slots in use.
    pub const fn running(&self) -> usize {
        self.running
    }

    /// Adds a request to the queue of its party, or returns it if too many of this rank wait, in all or of this group.
    pub fn push(&mut self, party: Party, rank: Rank, request: T) -> Result<(), T> {
        let group = self.groups.known.get(&party.group);
        let of_group = group.map_or(0, |group| *group.requests.waiting.of(rank));
        // Without slots nothing may wait, as it would wait for ever.
        if self.shares.slots == 0
            || *self.waiting.of(rank) >= self.shares.waiting
            || of_group >= self.shares.waiting_per_group
        {
            return Err(request);
        }
        self.add(party, rank, request);
        Ok(())
    }

    /// Adds a request to the queue of its party, even if too many wait: the caller bounds the number of such requests.
    pub fn add(&mut self, party: Party, rank: Rank, request: T) {
        let new_line = || Line(Ranked { urgent: VecDeque::new(), normal: VecDeque::new() });
        let add = |line: &mut Line<T>| line.0.of_mut(rank).push_back(request);
        let slots = self.shares.slots_of_member(party.group);
        let new_group = || Members::new(slots);
        self.groups.add(party.group, new_group, |group| {
            *group.waiting.of_mut(rank) += 1;
            group.accounts.add(party.member, new_line, add);
        });
        *self.waiting.of_mut(rank) += 1;
        self.settle(party.group);
    }

    /// Takes the next request that may have a slot. The slot is in use until [`FairQueue::done`].
    pub fn pop(&mut self) -> Option<(Party, Rank, T)> {
        Rank::ALL.into_iter().find_map(|rank| self.pop_of(rank))
    }

    /// Takes the next request of this rank that may have a slot, like [`FairQueue::pop`].
    pub fn pop_of(&mut self, rank: Rank) -> Option<(Party, Rank, T)> {
        let Shares { slots, reserve, .. } = self.shares;
        let is_free = match rank {
            Rank::Urgent => self.running < slots,
            Rank::Normal => {
                self.running < slots && self.running_normal < slots.saturating_sub(reserve)
            }
        };
        if !is_free {
            return None;
        }
        let (group, (member, request)) = self.groups.pop(rank, |group| {
            *group.waiting.of_mut(rank) -= 1;
            let first = |line: &mut Line<T>| line.0.of_mut(rank).pop_front();
            let (member, request) =
                group.accounts.pop(rank, first).expect("a group is ready when a member is");
            (member, request.expect("a member is ready when it has a request"))
        })?;
        *self.waiting.of_mut(rank) -= 1;
        self.running += 1;
        self.running_normal += usize::from(rank == Rank::Normal);
        self.settle(group);
        Some((Party { group, member }, rank, request))
    }

    /// Frees the slot of a request, which was in use for the time `used`.
    pub fn done(&mut self, party: Party, rank: Rank, used: Duration) {
        self.running -= 1;
        self.running_normal -= usize::from(rank == Rank::Normal);
        self.groups.done(party.group, used, |group| {
            group.accounts.done(party.member, used, |_| ());
        });
        self.settle(party.group);
    }

    /// Drops unwanted requests.
    pub fn retain(&mut self, mut is_wanted: impl FnMut(&T) -> bool) {
        for name in self.groups.waiting() {
            let dropped = self.groups.change(name, |group| group.requests.retain(&mut is_wanted));
            for rank in Rank::ALL {
                *self.waiting.of_mut(rank) -= dropped.of(rank);
            }
            self.settle(name);
        }
    }

    /// Forgets accounts with which the others have caught up, and idle accounts beyond [`PARTIES_REMEMBERED_MAX`]. Has to be
    /// called after every change of a group.
    fn settle(&mut self, changed: Group) {
        self.change_idle(changed, |members| while members.forget_caught_up().is_some() {});
        while let Some(group) = self.groups.forget_caught_up() {
            self.idle_members -= group.idle;
        }
        while self.remembered() > PARTIES_REMEMBERED_MAX {
            // Members of the changed group are forgotten first, so that others are hardly affected.
            if self.change_idle(changed, Accounts::forget).flatten().is_some() {
                continue;
            }
            let Some(group) = self.groups.forget() else { return };
            self.idle_members -= group.idle;
        }
    }

    /// Number of idle groups and members.
    fn remembered(&self) -> usize {
        self.groups.order.idle.len() + self.idle_members
    }

    /// Changes the idle members of a group, if the group is known, and counts them.
    fn change_idle<R>(
        &mut self,
        name: Group,
        change: impl FnOnce(&mut Accounts<Option<OwnerKey>, Line<T>>) -> R,
    ) -> Option<R> {
        let Members { accounts, idle, .. } = &mut self.groups.known.get_mut(&name)?.requests;
        let changed = change(accounts);
        self.idle_members -= *idle;
        *idle = accounts.order.idle.len();
        self.idle_members += *idle;
        Some(changed)
    }
}

/// All slots are in use, and the maximum of requests waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("as many requests use this, or wait for it, as may ({name} is {slots})")]
pub struct Busy {
    pub name: &'static str,
    pub slots: usize,
}

type Waiters = FairQueue<oneshot::Sender<Permit>>;

/// Permits for a scarce resource, shared fairly. Clones share them.
#[derive(Clone, Debug)]
pub struct FairLimit {
    name: &'static str,
    slots: usize,
    patience: Duration,
    queue: Arc<Mutex<Waiters>>,
}

/// A slot in use, freed on drop.
#[derive(Debug)]
#[must_use]
pub struct Permit {
    queue: Arc<Mutex<Waiters>>,
    party: Party,
    rank: Rank,
    since: Instant,
}

impl FairLimit {
    /// Permits for a kind of heavy work; a request waits for one no longer than `patience`.
    pub fn heavy(shares: Shares, patience: Duration) -> Self {
        Self::new(HEAVY_AT_ONCE, shares, patience)
    }

    /// Permits for replays: a group has no more than half of them.
    pub fn replays(slots: usize, patience: Duration) -> Self {
        Self::new("replays_max", Shares::halved(slots), patience)
    }

    fn new(name: &'static str, shares: Shares, patience: Duration) -> Self {
        let queue = Arc::new(Mutex::new(FairQueue::new(shares)));
        Self { name, slots: shares.slots, patience, queue }
    }

    /// Waits for a permit. Fails if too many requests wait, or none becomes free in time.
    pub async fn acquire(&self, party: Party, rank: Rank) -> Result<Permit, Busy> {
        let busy = Busy { name: self.name, slots: self.slots };
        let (grant, granted) = oneshot::channel();
        {
            let mut queue = lock(&self.queue);
            if let Err(grant) = queue.push(party, rank, grant) {
                queue.retain(|waiting| !waiting.is_closed());
                queue.push(party, rank, grant).map_err(|_| busy)?;
            }
        }
        dispatch(&self.queue);
        match tokio::time::timeout(self.patience, granted).await {
            Ok(Ok(permit)) => Ok(permit),
            Ok(Err(_)) | Err(_) => Err(busy),
        }
    }

    /// Returns a permit if no request waits, and the party's share has one.
    pub fn acquire_at_once(&self, party: Party, rank: Rank) -> Option<Permit> {
        let (grant, mut granted) = oneshot::channel();
        {
            let mut queue = lock(&self.queue);
            if queue.waiting() > 0 {
                return None;
            }
            queue.push(party, rank, grant).ok()?;
        }
        dispatch(&self.queue);
        // Where the party's share is used up, the abandoned request is passed over.
        granted.try_recv().ok()
    }

    /// Waits for a permit, however many requests wait and however long it takes: for requests whose number is bounded elsewhere.
    pub async fn acquire_always(&self, party: Party, rank: Rank) -> Permit {
        let (grant, granted) = oneshot::channel();
        lock(&self.queue).add(party, rank, grant);
        dispatch(&self.queue);
        granted.await.expect("a request stays in the queue until it is granted")
    }

    /// Numbers of slots in use and of waiting requests.
    pub fn load(&self) -> (usize, usize) {
        let queue = lock(&self.queue);
        (queue.running(), queue.waiting())
    }
}

fn lock(queue: &Mutex<Waiters>) -> MutexGuard<'_, Waiters> {
    queue.lock().expect("nothing panics while it holds this")
}

/// Gives free slots to the next requests.
fn dispatch(queue: &Arc<Mutex<Waiters>>) {
    loop {
        let mut waiters = lock(queue);
        let Some((party, rank, grant)) = waiters.pop() else { return };
        if grant.is_closed() {
            waiters.done(party, rank, Duration::ZERO);
            continue;
        }
        drop(waiters);
        let permit = Permit { queue: Arc::clone(queue), party, rank, since: Instant::now() };
        // If the request was cancelled meanwhile, the permit is dropped and freed here.
        drop(grant.send(permit));
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        lock(&self.queue).done(self.party, self.rank, self.since.elapsed());
        dispatch(&self.queue);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SHARES: Shares = Shares {
        slots: 2,
        reserve: 1,
        slots_per_group: 2,
        slots_per_member: 2,
        slots_per_single: 2,
        waiting: 100,
        waiting_per_group: 60,
    };

    fn owner(number: i64) -> Party {
        Party::of(Group::Owner(OwnerKey(number)))
    }

    fn entrant(number: i64) -> Party {
        Party::entrant(CompetitionKey(1), OwnerKey(number))
    }

    #[test]
    fn one_group_fills_its_own_places_and_is_forgotten_when_it_has_gone() {
        let mut queue = FairQueue::new(Shares { slots: 8, reserve: 0, ..SHARES });
        for _ in 0..60 {
            queue.push(owner(1), Rank::Normal, 0).expect("room");
        }
        assert!(queue.push(owner(1), Rank::Normal, 0).is_err());
        queue.push(owner(2), Rank::Normal, 0).expect("another group has room");
        queue.push(owner(1), Rank::Urgent, 0).expect("each rank has room of its own");
        queue.retain(|_| true);
        assert_eq!(queue.pop_of(Rank::Urgent).map(|(party, ..)| party), Some(owner(1)));
        queue.done(owner(1), Rank::Urgent, Duration::ZERO);
        assert!(queue.pop().is_some() && queue.pop().is_some());
        let third = queue.pop().map(|(party, ..)| party);
        assert_eq!(third, Some(owner(1)), "the second slot was the other group's");
        assert!(queue.pop().is_none(), "two slots a group");
        queue.retain(|_| false);
        assert_eq!(queue.waiting(), 0);
        for _ in 0..2 {
            queue.done(owner(1), Rank::Normal, Duration::from_millis(1));
        }
        // The account's usage is remembered until others have caught up.
        assert_eq!((queue.running(), queue.remembered(), queue.groups.known.len()), (1, 1, 2));
        queue.done(owner(2), Rank::Normal, Duration::from_millis(1));
        assert!(queue.groups.known.is_empty());
    }

    #[test]
    fn idle_groups_and_members_are_remembered_up_to_their_bound() {
        type Of = fn(i64) -> Party;
        for (party, groups) in [(owner as Of, PARTIES_REMEMBERED_MAX / 2), (entrant as Of, 1)] {
            let mut queue = FairQueue::new(Shares::of(40_000));
            for number in 0..40_000 {
                queue.push(party(number), Rank::Normal, 0).expect("room");
                let served = queue.pop().map(|(party, ..)| party);
                assert_eq!(served, Some(party(number)));
            }
            // While most are served, nobody has caught up with those that are done.
            for number in 0..17_000 {
                let used = if number == 0 { 9 } else { 1 };
                queue.done(party(number), Rank::Normal, Duration::from_millis(used));
                assert!(queue.remembered() <= PARTIES_REMEMBERED_MAX);
            }
            assert_eq!(queue.remembered(), PARTIES_REMEMBERED_MAX);
            assert!(queue.groups.known.len() >= groups);
            // Accounts with the highest usage are remembered longest.
            let first = &queue.groups.known[&party(0).group].requests.accounts;
            assert!(groups > 1 || first.known.contains_key(&party(0).member));
        }
    }

    #[derive(Clone, Debug)]
    enum Step {
        Push(Party, Rank),
        Add(Party, Rank),
        Pop,
        PopOf(Rank),
        Done { which: usize, millis: u64 },
        Retain { of: u32 },
    }

    fn step() -> impl Strategy<Value = Step> {
        let rank = || prop_oneof![Just(Rank::Urgent), Just(Rank::Normal)];
        let member =
            |(competition, owner)| Party::entrant(CompetitionKey(competition), OwnerKey(owner));
        let party =
            || prop_oneof![(0..6_i64).prop_map(owner), (0..3_i64, 0..5_i64).prop_map(member)];
        prop_oneof![
            6 => (party(), rank()).prop_map(|(party, rank)| Step::Push(party, rank)),
            1 => (party(), rank()).prop_map(|(party, rank)| Step::Add(party, rank)),
            4 => Just(Step::Pop),
            2 => rank().prop_map(Step::PopOf),
            5 => (0..8_usize, 0..20_u64).prop_map(|(which, millis)| Step::Done { which, millis }),
            1 => (2..6_u32).prop_map(|of| Step::Retain { of }),
        ]
    }

    fn shares() -> impl Strategy<Value = Shares> {
        let of_parties = (1..4_usize, 1..4_usize, 1..4_usize);
        (1..7_usize, 0..3_usize, of_parties, 1..30_usize, 1..10_usize).prop_map(
            |(slots, reserve, of_parties, waiting, waiting_per_group)| {
                let (slots_per_group, slots_per_member, slots_per_single) = of_parties;
                Shares {
                    slots,
                    reserve,
                    slots_per_group,
                    slots_per_member,
                    slots_per_single,
                    waiting,
                    waiting_per_group,
                }
            },
        )
    }

    proptest! {
        #[test]
        fn the_order_and_the_counts_are_those_of_the_accounts(
            shares in shares(),
            steps in proptest::collection::vec(step(), 0..300),
        ) {
            let mut queue = FairQueue::new(shares);
            let (mut running, mut served) = (Vec::new(), HashMap::new());
            for (number, step) in (0..).zip(steps) {
                let mut popped = None;
                match step {
                    Step::Push(party, rank) => drop(queue.push(party, rank, number)),
                    Step::Add(party, rank) => queue.add(party, rank, number),
                    Step::Pop => popped = queue.pop(),
                    Step::PopOf(rank) => popped = queue.pop_of(rank),
                    Step::Done { which, millis } => {
                        if which < running.len() {
                            let (party, rank) = running.swap_remove(which);
                            queue.done(party, rank, Duration::from_millis(millis));
                        }
                    }
                    Step::Retain { of } => queue.retain(|request| request % of > 0),
                }
                if let Some((party, rank, number)) = popped {
                    // Requests of one party and rank are served as they came.
                    let before = served.insert((party, rank == Rank::Urgent), number);
                    prop_assert!(before.is_none_or(|before: u32| before < number));
                    running.push((party, rank));
                }
                let normal = running.iter().filter(|(_, rank)| *rank == Rank::Normal).count();
                prop_assert_eq!((queue.running, queue.running_normal), (running.len(), normal));
                prop_assert!(running.len() <= shares.slots);
                prop_assert!(normal <= shares.slots.saturating_sub(shares.reserve));
                in_order(&queue.groups);
                let (mut waiting, mut idle) = (Ranked::default(), 0);
                for (name, group) in &queue.groups.known {
                    let Members { waiting: of_group, accounts, .. } = &group.requests;
                    in_order(accounts);
                    let lines = || accounts.known.values().map(|line| &line.requests.0);
                    for rank in Rank::ALL {
                        let sum = lines().map(|line| line.of(rank).len()).sum::<usize>();
                        prop_assert_eq!(*of_group.of(rank), sum);
                        *waiting.of_mut(rank) += sum;
                    }
                    idle += accounts.order.idle.len();
                    let of_members = accounts.known.values().map(|line| line.running).sum::<usize>();
                    prop_assert_eq!(group.running, of_members);
                    prop_assert!(group.running <= shares.slots_per_group);
                    let most = shares.slots_of_member(*name);
                    prop_assert!(accounts.known.values().all(|line| line.running <= most));
                }
                prop_assert_eq!((queue.waiting, queue.idle_members), (waiting, idle));
            }
        }
    }

    /// The order of accounts is the one that follows from each of them, and has nobody with whom the others have caught up.
    fn in_order<K: Copy + Ord + Hash + std::fmt::Debug, R: Requests>(accounts: &Accounts<K, R>) {
        let mut expected = Accounts::<K, R>::new(accounts.slots).order;
        for (name, account) in &accounts.known {
            expected.add(*name, account, accounts.slots);
        }
        assert_eq!(accounts.order, expected);
        assert!(accounts.order.idle.first().is_none_or(|(used, _)| *used > accounts.floor));
    }
}
