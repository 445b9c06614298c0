//! Fair shares: who is next, and who is refused.

use std::collections::HashMap;
use std::net::IpAddr;
use std::time::Duration;

use swarmbench::fair::{Busy, FairLimit, FairQueue, Group, HEAVY_AT_ONCE, Party, Rank, Shares};
use swarmbench::ids::CompetitionKey;
use swarmbench::keys::OwnerKey;

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

/// Serves all waiting requests, one after another, each for its cost in milliseconds. Returns how much of the first `until`
/// milliseconds each party got.
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
fn groups_that_come_once_do_not_stay_before_one_that_comes_back() {
    let mut queue = FairQueue::new(SHARES);
    let guest = |number| Party::of(Group::Address(IpAddr::from([198, 18, 0, number])));
    let (mut next, mut waited) = (0, Vec::new());
    for _ in 0..9 {
        queue.push(owner(9), Rank::Normal, 10).expect("room");
        for turn in 0.. {
            while queue.waiting() < 6 {
                queue.push(guest(next), Rank::Normal, 10).expect("room");
                next += 1;
            }
            let (party, rank, cost) = queue.pop().expect("somebody waits");
            queue.done(party, rank, Duration::from_millis(cost));
            if party == owner(9) {
                waited.push(turn);
                break;
            }
        }
    }
    assert!(waited.iter().all(|turns| *turns <= 12), "{waited:?}");
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
    assert_eq!(queue.pop().map(|(party, rank, _)| (party, rank)), Some((owner(1), Rank::Urgent)));
    queue.push(owner(9), Rank::Urgent, 0).expect("room");
    queue.done(owner(1), Rank::Normal, Duration::ZERO);
    assert_eq!(queue.pop().map(|(party, ..)| party), Some(owner(9)));
    queue.done(owner(1), Rank::Urgent, Duration::ZERO);
    assert_eq!(queue.pop().map(|(party, ..)| party), Some(owner(2)));
}

#[test]
fn an_owner_has_the_slots_of_a_group_and_an_entrant_those_of_a_member() {
    let mut queue = FairQueue::new(Shares { slots: 8, reserve: 0, slots_per_member: 1, ..SHARES });
    for party in [owner(1), entrant(1)] {
        for _ in 0..3 {
            queue.push(party, Rank::Normal, 0).expect("room");
        }
    }
    let mut running: Vec<_> = std::iter::from_fn(|| queue.pop()).map(|(party, ..)| party).collect();
    running.sort_unstable();
    assert_eq!(running, [entrant(1), owner(1), owner(1)]);
}

fn limit(slots: usize) -> FairLimit {
    let shares = Shares { slots, reserve: 0, slots_per_group: slots, waiting: 2, ..SHARES };
    FairLimit::heavy(shares, Duration::from_mins(1))
}

#[tokio::test]
async fn a_permit_is_handed_on_and_given_up_requests_take_no_place() {
    let limit = limit(1);
    let first = limit.acquire(owner(1), Rank::Normal).await.expect("a permit");
    for _ in 0..5 {
        // A request that was polled once, so that it waits, and then dropped.
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
    assert_eq!(refused, Busy { name: HEAVY_AT_ONCE, slots: 1 });
}

#[tokio::test]
async fn a_permit_at_once_passes_nobody_who_waits() {
    let limit = limit(1);
    let first = limit.acquire_at_once(owner(1), Rank::Normal).expect("it is free");
    assert!(limit.acquire_at_once(owner(2), Rank::Normal).is_none());
    let mut waits = Box::pin(limit.acquire(owner(3), Rank::Normal));
    assert!(futures::poll!(&mut waits).is_pending());
    assert!(limit.acquire_at_once(owner(2), Rank::Normal).is_none());
    drop(first);
    assert!(limit.acquire_at_once(owner(2), Rank::Normal).is_none(), "it is promised");
    drop(waits.await.expect("a permit"));
    drop(limit.acquire_at_once(owner(2), Rank::Normal).expect("it is free"));
    assert_eq!(limit.load(), (0, 0));
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
