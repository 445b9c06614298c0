//! Fair shares: who asks for something scarce, and who gets it next.
//!
//! A [`Party`] is a member of a group: an entrant of a competition, the holder of a key, an address. Shares
//! are equal between groups first and between the members of a group second, so that a competition with a
//! thousand free keys gets no more than a single key does. [`FairQueue`] decides who is next, and is pure;
//! [`FairLimit`] hands out permits by it to async code, and [`work`](crate::work) runs jobs by it.

use std::cell::Cell;
use std::collections::hash_map::Entry;
use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use crate::journal::CompetitionKey;
use crate::keys::OwnerKey;

/// Between whom shares are equal first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Group {
    /// The server itself.
    Server,
    /// The entrants of a competition.
    Competition(CompetitionKey),
    /// The holder of a key.
    Owner(OwnerKey),
    /// Clients without a key, by address, or /64 network of IPv6.
    Address(IpAddr),
}

/// For whom something is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Party {
    /// The group.
    pub group: Group,
    /// The member of a competition's group: an entrant's key.
    pub member: Option<OwnerKey>,
}

tokio::task_local! {
    static CURRENT: Cell<Party>;
    static RANK: Rank;
}

impl Party {
    /// The server, which does something of its own accord.
    pub const SERVER: Self = Self::of(Group::Server);

    /// A group that is its own only member.
    #[must_use]
    pub const fn of(group: Group) -> Self {
        Self { group, member: None }
    }

    /// An entrant of a competition.
    #[must_use]
    pub const fn entrant(competition: CompetitionKey, owner: OwnerKey) -> Self {
        Self { group: Group::Competition(competition), member: Some(owner) }
    }

    /// The party of the request that this task handles; the server where it handles none.
    #[must_use]
    pub fn current() -> Self {
        CURRENT.try_with(Cell::get).unwrap_or(Self::SERVER)
    }

    /// Runs a future for this party.
    pub async fn scope<F: Future>(self, future: F) -> F::Output {
        CURRENT.scope(Cell::new(self), future).await
    }

    /// Makes this the party of the rest of the request, once more is known about the caller.
    pub fn refine(self) {
        // Outside of a request nobody asks.
        let _ = CURRENT.try_with(|current| current.set(self));
    }
}

/// What goes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rank {
    /// A running game waits for it. It may use the reserve and goes before everything else.
    Urgent,
    /// Everything else.
    Normal,
}

impl Rank {
    /// The rank of the request that this task handles. What the server does of its own accord, games wait for.
    #[must_use]
    pub fn current() -> Self {
        RANK.try_with(|rank| *rank).unwrap_or(Self::Urgent)
    }

    /// Runs a future with this rank.
    pub async fn scope<F: Future>(self, future: F) -> F::Output {
        RANK.scope(self, future).await
    }
}

/// Runs a future for the party of this task and with its rank, wherever it is spawned.
pub fn inherit<F: Future>(future: F) -> impl Future<Output = F::Output> {
    let Origin { party, rank } = Origin::current();
    rank.scope(party.scope(future))
}

/// For whom a task works, and with which rank: for what goes on outside of it, like the body of an answer.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    party: Party,
    rank: Rank,
}

impl Origin {
    /// That of this task.
    #[must_use]
    pub fn current() -> Self {
        Self { party: Party::current(), rank: Rank::current() }
    }

    /// Does something as that task would.
    pub fn enter<T>(self, work: impl FnOnce() -> T) -> T {
        RANK.sync_scope(self.rank, || CURRENT.sync_scope(Cell::new(self.party), work))
    }
}

/// How much there is, and how much of it one party may use.
#[derive(Clone, Copy, Debug)]
pub struct Shares {
    /// Slots in use at once.
    pub slots: usize,
    /// Of these, slots that only urgent requests may use.
    pub reserve: usize,
    /// Slots of one group at once.
    pub slots_per_group: usize,
    /// Slots of one member of a group at once.
    pub slots_per_member: usize,
    /// Requests of each rank that wait at once.
    pub waiting: usize,
    /// Requests of one group and rank that wait at once.
    pub waiting_per_group: usize,
}

/// How many requests of each rank wait.
#[derive(Clone, Copy, Debug, Default)]
struct Waiting {
    urgent: usize,
    normal: usize,
}

impl Waiting {
    const fn of(&mut self, rank: Rank) -> &mut usize {
        match rank {
            Rank::Urgent => &mut self.urgent,
            Rank::Normal => &mut self.normal,
        }
    }

    const fn all(self) -> usize {
        self.urgent + self.normal
    }
}

/// Requests that wait for a slot, and who is next.
///
/// Of the groups that wait the one with the fewest slots in use is next; of those with equally many the one
/// that has used slots for the least time. The same holds for the members of the group. A group that comes
/// back after a pause begins at the least time of the others, so that a pause earns nothing.
#[derive(Debug)]
pub struct FairQueue<T> {
    shares: Shares,
    running: usize,
    running_normal: usize,
    waiting: Waiting,
    groups: HashMap<Group, Account<Option<OwnerKey>, T>>,
    /// The usage of the group that was served last: where new groups begin.
    floor: Duration,
}

/// A group: what it uses, and its members.
#[derive(Debug)]
struct Account<K, T> {
    running: usize,
    waiting: Waiting,
    used: Duration,
    floor: Duration,
    members: HashMap<K, Line<T>>,
}

/// A member: what it uses, and its requests in their order.
#[derive(Debug)]
struct Line<T> {
    running: usize,
    used: Duration,
    urgent: VecDeque<T>,
    normal: VecDeque<T>,
}

impl<T> Line<T> {
    const fn new(used: Duration) -> Self {
        Self { running: 0, used, urgent: VecDeque::new(), normal: VecDeque::new() }
    }

    const fn queue(&mut self, rank: Rank) -> &mut VecDeque<T> {
        match rank {
            Rank::Urgent => &mut self.urgent,
            Rank::Normal => &mut self.normal,
        }
    }

    fn is_waiting(&self, rank: Rank) -> bool {
        match rank {
            Rank::Urgent => !self.urgent.is_empty(),
            Rank::Normal => !self.normal.is_empty(),
        }
    }
}

/// As many requests wait as may.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueFull;

impl<T> FairQueue<T> {
    /// Nobody waits.
    #[must_use]
    pub fn new(shares: Shares) -> Self {
        Self {
            shares,
            running: 0,
            running_normal: 0,
            waiting: Waiting::default(),
            groups: HashMap::new(),
            floor: Duration::ZERO,
        }
    }

    /// Requests that wait.
    #[must_use]
    pub const fn waiting(&self) -> usize {
        self.waiting.all()
    }

    /// Slots in use.
    #[must_use]
    pub const fn running(&self) -> usize {
        self.running
    }

    /// Adds a request to the queue of its party.
    ///
    /// # Errors
    /// Where too many of this rank wait, in all or of this group; the request comes back.
    pub fn push(&mut self, party: Party, rank: Rank, request: T) -> Result<(), (QueueFull, T)> {
        let group = self.groups.get(&party.group).map(|group| group.waiting);
        if *self.waiting.of(rank) >= self.shares.waiting
            || *group.unwrap_or_default().of(rank) >= self.shares.waiting_per_group
        {
            return Err((QueueFull, request));
        }
        self.add(party, rank, request);
        Ok(())
    }

    /// Adds a request to the queue of its party, also where too many wait: whoever adds it bounds how many
    /// of its kind there are.
    pub fn add(&mut self, party: Party, rank: Rank, request: T) {
        let floor = self.floor;
        let group = self.groups.entry(party.group).or_insert_with(|| Account {
            running: 0,
            waiting: Waiting::default(),
            used: floor,
            floor: Duration::ZERO,
            members: HashMap::new(),
        });
        if group.running == 0 && group.waiting.all() == 0 {
            group.used = group.used.max(floor);
        }
        let floor = group.floor;
        let line = group.members.entry(party.member).or_insert_with(|| Line::new(floor));
        if line.running == 0 && line.urgent.is_empty() && line.normal.is_empty() {
            line.used = line.used.max(floor);
        }
        line.queue(rank).push_back(request);
        *group.waiting.of(rank) += 1;
        *self.waiting.of(rank) += 1;
    }

    /// Takes the next request that may have a slot. The slot is in use until [`FairQueue::done`].
    pub fn pop(&mut self) -> Option<(Party, Rank, T)> {
        [Rank::Urgent, Rank::Normal].into_iter().find_map(|rank| self.pop_of(rank))
    }

    /// Takes the next request of this rank that may have a slot, as [`FairQueue::pop`] does.
    pub fn pop_of(&mut self, rank: Rank) -> Option<(Party, Rank, T)> {
        let Shares { slots, reserve, slots_per_group, slots_per_member, .. } = self.shares;
        let is_free = match rank {
            Rank::Urgent => self.running < slots,
            Rank::Normal => {
                self.running < slots && self.running_normal < slots.saturating_sub(reserve)
            }
        };
        if !is_free {
            return None;
        }
        let may = |line: &Line<T>| line.is_waiting(rank) && line.running < slots_per_member;
        let (name, group) = (self.groups.iter_mut())
            .filter(|(_, group)| group.waiting.all() > 0 && group.running < slots_per_group)
            .filter(|(_, group)| group.members.values().any(may))
            .min_by_key(|(name, group)| (group.running, group.used, **name))?;
        let (member, line) = (group.members.iter_mut())
            .filter(|(_, line)| may(line))
            .min_by_key(|(name, line)| (line.running, line.used, **name))?;
        let request = line.queue(rank).pop_front()?;
        let party = Party { group: *name, member: *member };
        line.running += 1;
        group.floor = group.floor.max(line.used);
        group.running += 1;
        *group.waiting.of(rank) -= 1;
        self.floor = self.floor.max(group.used);
        *self.waiting.of(rank) -= 1;
        self.running += 1;
        self.running_normal += usize::from(rank == Rank::Normal);
        Some((party, rank, request))
    }

    /// Frees the slot of a request that used it for so long.
    pub fn done(&mut self, party: Party, rank: Rank, used: Duration) {
        self.running -= 1;
        self.running_normal -= usize::from(rank == Rank::Normal);
        let Entry::Occupied(mut entry) = self.groups.entry(party.group) else { return };
        let group = entry.get_mut();
        group.running -= 1;
        group.used += used;
        if let Some(line) = group.members.get_mut(&party.member) {
            line.running -= 1;
            line.used += used;
        }
        // A group that neither waits nor runs is forgotten once the others have caught up with it.
        let (floor, own_floor) = (self.floor, group.floor);
        group.members.retain(|_, line| {
            line.running > 0
                || !line.urgent.is_empty()
                || !line.normal.is_empty()
                || line.used > own_floor
        });
        if group.running == 0 && group.waiting.all() == 0 && group.used <= floor {
            entry.remove();
        }
    }

    /// Drops requests that nobody waits for any more.
    pub fn retain(&mut self, mut is_wanted: impl FnMut(&T) -> bool) {
        for group in self.groups.values_mut() {
            for line in group.members.values_mut() {
                for rank in [Rank::Urgent, Rank::Normal] {
                    let queue = line.queue(rank);
                    let before = queue.len();
                    queue.retain(&mut is_wanted);
                    let dropped = before - queue.len();
                    *group.waiting.of(rank) -= dropped;
                    *self.waiting.of(rank) -= dropped;
                }
            }
        }
    }

    /// Forgets parties that use nothing and wait for nothing, and their usage; to be called now and then.
    pub fn prune(&mut self) {
        self.groups.retain(|_, group| group.running > 0 || group.waiting.all() > 0);
    }
}

/// Does blocking work for a party, on a thread of its own.
pub fn blocking<T>(party: Party, rank: Rank, work: impl FnOnce() -> T) -> T {
    RANK.sync_scope(rank, || CURRENT.sync_scope(Cell::new(party), work))
}

/// As many use something, or wait for it, as may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("as many requests use this, or wait for it, as may ({name} is {slots})")]
pub struct Busy {
    /// The name of the limit.
    pub name: &'static str,
    /// Its value.
    pub slots: usize,
}

type Waiters = FairQueue<oneshot::Sender<Permit>>;

/// Permits for something scarce, shared fairly. Cloning shares them.
#[derive(Clone, Debug)]
pub struct FairLimit {
    name: &'static str,
    slots: usize,
    patience: Duration,
    queue: Arc<Mutex<Waiters>>,
}

/// A slot that is in use until this is dropped.
#[derive(Debug)]
pub struct Permit {
    queue: Arc<Mutex<Waiters>>,
    party: Party,
    rank: Rank,
    since: Instant,
}

impl FairLimit {
    /// Permits of this name; a request waits for one at most so long.
    #[must_use]
    pub fn new(name: &'static str, shares: Shares, patience: Duration) -> Self {
        let queue = Arc::new(Mutex::new(FairQueue::new(shares)));
        Self { name, slots: shares.slots, patience, queue }
    }

    /// A permit for the party, once it is its turn.
    ///
    /// # Errors
    /// Where too many wait, or none is free in time.
    pub async fn acquire(&self, party: Party, rank: Rank) -> Result<Permit, Busy> {
        let busy = Busy { name: self.name, slots: self.slots };
        let (grant, granted) = oneshot::channel();
        {
            let mut queue = lock(&self.queue);
            if let Err((_, grant)) = queue.push(party, rank, grant) {
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

    /// A permit for the party, however many wait and however long it takes: for requests whose number is
    /// bounded elsewhere.
    pub async fn acquire_always(&self, party: Party, rank: Rank) -> Permit {
        let (grant, granted) = oneshot::channel();
        lock(&self.queue).add(party, rank, grant);
        dispatch(&self.queue);
        granted.await.expect("a request stays in the queue until it is granted")
    }

    /// Forgets parties that have gone; to be called now and then.
    pub fn prune(&self) {
        lock(&self.queue).prune();
    }

    /// Slots in use, and requests that wait.
    #[must_use]
    pub fn load(&self) -> (usize, usize) {
        let queue = lock(&self.queue);
        (queue.running(), queue.waiting())
    }
}

fn lock(queue: &Mutex<Waiters>) -> MutexGuard<'_, Waiters> {
    queue.lock().expect("nothing panics while it holds this")
}

/// Hands free slots to those whose turn it is.
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
        // A request that was given up at this moment gives its permit back here.
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
    use super::*;

    const SHARES: Shares = Shares {
        slots: 2,
        reserve: 1,
        slots_per_group: 2,
        slots_per_member: 2,
        waiting: 100,
        waiting_per_group: 60,
    };

    fn owner(number: i64) -> Party {
        Party::of(Group::Owner(OwnerKey(number)))
    }

    fn entrant(number: i64) -> Party {
        Party::entrant(CompetitionKey(1), OwnerKey(number))
    }

    /// Serves everything that waits, one after another, each for its cost in milliseconds; by party,
    /// how much of the first `until` milliseconds it got.
    fn serve(queue: &mut FairQueue<u64>, until: u64) -> HashMap<Party, u64> {
        let (mut now, mut got) = (0, HashMap::new());
        while now < until
            && let Some((party, rank, cost)) = queue.pop()
        {
            queue.done(party, rank, Duration::from_millis(cost));
            now += cost;
            *got.entry(party).or_default() += cost;
        }
        got
    }

    #[test]
    fn groups_share_time_equally_whatever_their_requests_cost() {
        let mut queue = FairQueue::new(SHARES);
        for _ in 0..20 {
            queue.push(owner(1), Rank::Normal, 50).expect("room");
        }
        for _ in 0..50 {
            queue.push(owner(2), Rank::Normal, 5).expect("room");
        }
        let got = serve(&mut queue, 500);
        let (one, two) = (got[&owner(1)], got[&owner(2)]);
        assert!(one.abs_diff(two) <= 50, "{one} ms and {two} ms");
    }

    #[test]
    fn a_group_of_many_members_gets_no_more_than_a_group_of_one() {
        let mut queue = FairQueue::new(SHARES);
        for number in 10..60 {
            queue.push(entrant(number), Rank::Normal, 10).expect("room");
        }
        for _ in 0..30 {
            queue.push(owner(1), Rank::Normal, 10).expect("room");
        }
        let got = serve(&mut queue, 200);
        assert_eq!(got[&owner(1)], 100);
        // The members of the other group have shared their half: ten of them had one turn each.
        assert_eq!(got.len(), 11);
    }

    #[test]
    fn a_pause_earns_nothing() {
        let mut queue = FairQueue::new(SHARES);
        for round in 0..20 {
            queue.push(owner(1), Rank::Normal, 10).expect("room");
            if round == 0 {
                queue.push(owner(2), Rank::Normal, 10).expect("room");
            }
            serve(&mut queue, 1000);
        }
        for _ in 0..20 {
            queue.push(owner(1), Rank::Normal, 10).expect("room");
            queue.push(owner(2), Rank::Normal, 10).expect("room");
        }
        let got = serve(&mut queue, 200);
        assert!(got[&owner(1)].abs_diff(got[&owner(2)]) <= 20, "{got:?}");
    }

    #[test]
    fn urgent_requests_have_the_reserve_and_go_first() {
        let mut queue = FairQueue::new(SHARES);
        for number in 1..4 {
            queue.push(owner(number), Rank::Normal, 0).expect("room");
        }
        assert_eq!(queue.pop().map(|(party, ..)| party), Some(owner(1)));
        assert!(queue.pop().is_none(), "the second slot is reserved");
        queue.push(owner(1), Rank::Urgent, 0).expect("room");
        assert_eq!(
            queue.pop().map(|(party, rank, _)| (party, rank)),
            Some((owner(1), Rank::Urgent))
        );
        queue.push(owner(9), Rank::Urgent, 0).expect("room");
        queue.done(owner(1), Rank::Normal, Duration::ZERO);
        assert_eq!(queue.pop().map(|(party, ..)| party), Some(owner(9)));
        queue.done(owner(1), Rank::Urgent, Duration::ZERO);
        assert_eq!(queue.pop().map(|(party, ..)| party), Some(owner(2)));
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
        for (party, rank) in
            [(owner(1), Rank::Normal); 2].into_iter().chain([(owner(2), Rank::Normal)])
        {
            queue.done(party, rank, Duration::from_millis(1));
        }
        queue.prune();
        assert!(queue.groups.is_empty() && queue.running() == 0);
    }

    fn limit(slots: usize) -> FairLimit {
        let shares = Shares { slots, reserve: 0, slots_per_group: slots, waiting: 2, ..SHARES };
        FairLimit::new("things_max", shares, Duration::from_mins(1))
    }

    #[tokio::test]
    async fn a_permit_is_handed_on_and_given_up_requests_take_no_place() {
        let limit = limit(1);
        let first = limit.acquire(owner(1), Rank::Normal).await.expect("a permit");
        for _ in 0..5 {
            // Polled once, so that it waits, and given up.
            let mut waits = Box::pin(limit.acquire(owner(1), Rank::Normal));
            assert!(futures::poll!(&mut waits).is_pending());
        }
        let mut second = Box::pin(limit.acquire(owner(2), Rank::Normal));
        assert!(futures::poll!(&mut second).is_pending());
        drop(first);
        let second = second.await.expect("a permit");
        assert_eq!(limit.load().0, 1);
        drop(second);
        assert_eq!(limit.load(), (0, 0));
    }

    #[tokio::test]
    async fn too_many_waiting_requests_are_refused_by_name() {
        let limit = limit(1);
        let _first = limit.acquire(owner(1), Rank::Normal).await.expect("a permit");
        let mut waits: Vec<_> =
            (2..4).map(|number| Box::pin(limit.acquire(owner(number), Rank::Normal))).collect();
        for wait in &mut waits {
            assert!(futures::poll!(wait).is_pending());
        }
        let refused = limit.acquire(owner(5), Rank::Normal).await.expect_err("no place to wait");
        assert_eq!(refused, Busy { name: "things_max", slots: 1 });
    }

    #[tokio::test]
    async fn the_party_of_a_request_can_be_refined() {
        assert_eq!(Party::current(), Party::SERVER);
        owner(1)
            .scope(async {
                assert_eq!(Party::current(), owner(1));
                entrant(7).refine();
                assert_eq!(Party::current(), entrant(7));
            })
            .await;
        assert_eq!(Party::current(), Party::SERVER);
    }
}
