//! A reference for [`FairQueue`](super::FairQueue): the same promises, by a linear search.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use super::{Group, Party, Rank, Shares};
use crate::keys::OwnerKey;

#[derive(Debug, Default)]
struct Account {
    running: usize,
    used: Duration,
    floor: Duration,
    members: BTreeMap<Option<OwnerKey>, Line>,
}

#[derive(Debug, Default)]
struct Line {
    running: usize,
    used: Duration,
    queue: VecDeque<(Rank, u32)>,
}

#[derive(Debug)]
pub(super) struct Linear {
    shares: Shares,
    running: [usize; 2],
    floor: Duration,
    groups: BTreeMap<Group, Account>,
}

impl Account {
    fn requests(&self) -> impl Iterator<Item = &(Rank, u32)> {
        self.members.values().flat_map(|line| &line.queue)
    }
}

fn count<'a>(requests: impl Iterator<Item = &'a (Rank, u32)>, rank: Rank) -> usize {
    requests.filter(|(of, _)| *of == rank).count()
}

impl Linear {
    pub(super) fn new(shares: Shares) -> Self {
        Self { shares, running: [0; 2], floor: Duration::ZERO, groups: BTreeMap::new() }
    }

    pub(super) fn waiting(&self) -> usize {
        self.groups.values().map(|group| group.requests().count()).sum()
    }

    pub(super) fn running(&self) -> usize {
        self.running.iter().sum()
    }

    pub(super) fn push(&mut self, party: Party, rank: Rank, request: u32) -> bool {
        let all = count(self.groups.values().flat_map(Account::requests), rank);
        let group = self.groups.get(&party.group);
        let of_group = group.map_or(0, |group| count(group.requests(), rank));
        let has_room = all < self.shares.waiting && of_group < self.shares.waiting_per_group;
        if has_room {
            self.add(party, rank, request);
        }
        has_room
    }

    pub(super) fn add(&mut self, party: Party, rank: Rank, request: u32) {
        let group = self.groups.entry(party.group).or_default();
        if group.running == 0 && group.requests().next().is_none() {
            group.used = group.used.max(self.floor);
        }
        let line = group.members.entry(party.member).or_default();
        if line.running == 0 && line.queue.is_empty() {
            line.used = line.used.max(group.floor);
        }
        line.queue.push_back((rank, request));
    }

    pub(super) fn pop_of(&mut self, rank: Rank) -> Option<(Party, Rank, u32)> {
        let Shares { slots, reserve, slots_per_group, .. } = self.shares;
        let is_reserved = rank == Rank::Normal && self.running[1] >= slots.saturating_sub(reserve);
        if self.running() >= slots || is_reserved {
            return None;
        }
        let shares = self.shares;
        let may = |group: Group, line: &Line| {
            let most = match group {
                Group::Competition(_) => shares.slots_per_member,
                _ => shares.slots_per_single,
            };
            line.running < most && count(line.queue.iter(), rank) > 0
        };
        let (&name, group) = (self.groups.iter_mut())
            .filter(|(_, group)| group.running < slots_per_group)
            .filter(|(name, group)| group.members.values().any(|line| may(**name, line)))
            .min_by_key(|(name, group)| (group.running, group.used, **name))?;
        let (&member, line) = (group.members.iter_mut())
            .filter(|(_, line)| may(name, line))
            .min_by_key(|(name, line)| (line.running, line.used, **name))?;
        let place = line.queue.iter().position(|(of, _)| *of == rank)?;
        let (_, request) = line.queue.remove(place)?;
        group.floor = group.floor.max(line.used);
        self.floor = self.floor.max(group.used);
        line.running += 1;
        group.running += 1;
        self.running[rank as usize] += 1;
        self.forget();
        Some((Party { group: name, member }, rank, request))
    }

    pub(super) fn done(&mut self, party: Party, rank: Rank, used: Duration) {
        self.running[rank as usize] -= 1;
        let group = self.groups.get_mut(&party.group).expect("it runs");
        group.running -= 1;
        group.used += used;
        let line = group.members.get_mut(&party.member).expect("it runs");
        line.running -= 1;
        line.used += used;
        self.forget();
    }

    pub(super) fn retain(&mut self, is_wanted: impl Fn(&u32) -> bool) {
        for line in self.groups.values_mut().flat_map(|group| group.members.values_mut()) {
            line.queue.retain(|(_, request)| is_wanted(request));
        }
        self.forget();
    }

    /// Forgets idle groups, with their members, with which the others have caught up.
    fn forget(&mut self) {
        let floor = self.floor;
        self.groups.retain(|_, group| {
            group.running > 0 || group.requests().next().is_some() || group.used > floor
        });
    }
}
