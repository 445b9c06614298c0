//! Choice of the connection that is evicted when the limit is reached and another client connects.
//!
//! Half of all connections are for parties, which have sent a token; others may use what they leave. In the half that is over its
//! size, the holder with the most connections loses one, if it has more than its fair share. A party's connections count both for
//! the party and for its address, so neither many tokens nor many addresses gain anything. The caller's order decides which of the
//! holder's connections it is.

use std::collections::{BTreeSet, HashMap};
use std::hash::Hash;
use std::net::IpAddr;

use crate::fair::Party;

/// Maximum connections of a holder that are compared to choose one: the oldest.
const COMPARED_MAX: usize = 256;

/// An address by which connections are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Holder {
    /// Address, or /48 network of IPv6, that sent the last request.
    Client(IpAddr),
    /// Clients of this trusted proxy whose connections have not sent a request yet.
    Unknown(IpAddr),
}

/// Holder and party of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Whose {
    pub(super) holder: Holder,
    /// Party of the token that this client sent last.
    pub(super) party: Option<Party>,
}

impl Whose {
    pub(super) const fn client(holder: Holder) -> Self {
        Self { holder, party: None }
    }
}

#[derive(Debug)]
pub(super) struct Holders<T> {
    /// Connections by number, in the order of acceptance.
    connections: HashMap<u64, (Whose, T)>,
    parties: Counts<Party>,
    /// Addresses of connections with a party.
    of_parties: Counts<Holder>,
    /// Addresses of connections without a party.
    others: Counts<Holder>,
}

/// Connections by holder; no set is empty.
#[derive(Debug)]
struct Counts<K> {
    held: HashMap<K, BTreeSet<u64>>,
    by_count: BTreeSet<(usize, K)>,
    sum: usize,
}

impl<K> Default for Counts<K> {
    fn default() -> Self {
        Self { held: HashMap::new(), by_count: BTreeSet::new(), sum: 0 }
    }
}

impl<K: Copy + Ord + Hash> Counts<K> {
    fn change(&mut self, holder: K, change: impl FnOnce(&mut BTreeSet<u64>) -> bool) {
        let held = self.held.entry(holder).or_default();
        let before = held.len();
        change(held);
        let after = held.len();
        self.by_count.remove(&(before, holder));
        if after == 0 {
            self.held.remove(&holder);
        } else {
            self.by_count.insert((after, holder));
        }
        self.sum = self.sum - before + after;
    }

    /// Connections of the holder with the most, if they exceed its fair share of `part` when `newcomers` have a share, too.
    fn largest(&self, part: usize, newcomers: usize) -> Option<&BTreeSet<u64>> {
        let (count, holder) = self.by_count.last()?;
        // Rounded up, or two clients would evict each other's connections again and again.
        let share = part.div_ceil(self.held.len() + newcomers);
        self.held.get(holder).filter(|_| *count > share)
    }
}

impl<T> Default for Holders<T> {
    fn default() -> Self {
        let (of_parties, others) = (Counts::default(), Counts::default());
        Self { connections: HashMap::new(), parties: Counts::default(), of_parties, others }
    }
}

impl<T> Holders<T> {
    pub(super) fn add(&mut self, whose: Whose, number: u64, connection: T) {
        self.connections.insert(number, (whose, connection));
        self.change(whose, |held| held.insert(number));
    }

    /// None if the connection was removed before.
    pub(super) fn remove(&mut self, number: u64) -> Option<T> {
        let (whose, connection) = self.connections.remove(&number)?;
        self.change(whose, |held| held.remove(&number));
        Some(connection)
    }

    fn change(&mut self, whose: Whose, change: impl Fn(&mut BTreeSet<u64>) -> bool) {
        match whose.party {
            Some(party) => {
                self.parties.change(party, &change);
                self.of_parties.change(whose.holder, change);
            }
            None => self.others.change(whose.holder, change),
        }
    }

    /// Removes a connection to make room for one of `newcomer`, which has sent no token yet: the least by `key` of the holder that
    /// has too many. None if no holder has.
    pub(super) fn evict<K: Ord>(
        &mut self,
        most: usize,
        newcomer: Holder,
        key: impl Fn(&T) -> K,
    ) -> Option<T> {
        let (parties, others, half) = (self.parties.sum, self.others.sum, most / 2);
        let is_new = usize::from(!self.others.held.contains_key(&newcomer));
        let of_others = |part| self.others.largest(part, is_new);
        let of_parties = |part, newcomers| {
            let largest =
                [self.parties.largest(part, newcomers), self.of_parties.largest(part, newcomers)];
            largest.into_iter().flatten().max_by_key(|held| held.len())
        };
        // If no holder in this part has too many, one in the other part may.
        let held = if parties <= half || others >= half {
            of_others(most - parties.min(half)).or_else(|| of_parties(half, 1))
        } else {
            of_parties(most - others - 1, 0).or_else(|| of_others(most - half))
        }?;
        let connection = |number: &u64| &self.connections[number].1;
        let oldest = held.iter().take(COMPARED_MAX);
        let &number = oldest.min_by_key(|number| key(connection(number)))?;
        self.remove(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fair::Group;
    use crate::keys::OwnerKey;

    fn client(number: u8) -> Holder {
        Holder::Client([192, 0, 2, number].into())
    }

    fn proxy() -> Holder {
        Holder::Unknown([127, 0, 0, 1].into())
    }

    /// Connections by holder. `worth` maps a connection's number to its worth.
    fn holders(counts: &[(Holder, u64)], worth: impl Fn(u64) -> u64) -> Holders<(Holder, u64)> {
        let mut holders = Holders::default();
        let mut number = 0;
        for &(holder, count) in counts {
            for _ in 0..count {
                holders.add(Whose::client(holder), number, (holder, worth(number)));
                number += 1;
            }
        }
        holders
    }

    /// The holder that loses a connection to a client behind the proxy.
    fn loser(counts: &[(Holder, u64)], most: usize) -> Option<Holder> {
        let evicted = holders(counts, |number| number).evict(most, proxy(), |&(_, worth)| worth);
        evicted.map(|(holder, _)| holder)
    }

    #[test]
    fn the_largest_holder_above_its_share_loses_a_connection() {
        for (counts, most, expected) in [
            (&[][..], 10, None),
            (&[(client(1), 10)], 10, Some(client(1))),
            (&[(client(1), 9), (client(2), 1)], 10, Some(client(1))),
            (&[(client(1), 4), (client(2), 6)], 10, Some(client(2))),
            // Clients that have sent nothing are one holder, to which the newcomer belongs.
            (&[(client(1), 4), (proxy(), 6)], 10, Some(proxy())),
            (&[(client(1), 5), (proxy(), 5)], 10, None),
            (&[(proxy(), 10)], 10, None),
            // With the newcomer there are four holders: none has more than three connections.
            (&[(client(1), 3), (client(2), 3), (client(3), 3)], 9, None),
            (&[(client(1), 1), (client(2), 1), (client(3), 1)], 3, None),
            (&[(client(1), 2), (client(2), 1)], 3, Some(client(1))),
        ] {
            assert_eq!(loser(counts, most), expected, "{counts:?} of {most}");
        }
    }

    #[test]
    fn the_least_of_its_oldest_connections_is_closed() {
        let mut held = holders(&[(client(1), 10)], |number| 100 - number % 7);
        let mut evict = || held.evict(4, client(2), |&(_, worth)| worth).map(|(_, worth)| worth);
        assert_eq!([evict(), evict(), evict()], [Some(94), Some(95), Some(96)]);
        let most = COMPARED_MAX as u64;
        let mut many = holders(&[(client(1), 2 * most)], |number| 2 * most - number);
        let (_, worth) = many.evict(1, client(2), |&(_, worth)| worth).expect("one of many");
        assert_eq!(worth, most + 1);
    }

    #[test]
    fn a_client_is_cut_down_to_its_share_and_no_further() {
        let mut held = holders(&[(client(1), 90), (client(2), 10)], |number| number);
        let mut evicted = 0;
        while let Some((holder, _)) = held.evict(100, client(3), |&(_, worth)| worth) {
            assert_eq!(holder, client(1));
            evicted += 1;
        }
        assert_eq!(evicted, 90 - 34);
    }

    /// Address (last byte) and key (0: no token) that lose a connection; `counts` has the number of connections of each pair.
    fn loser_of(counts: &[(u8, i64, u64)], most: usize) -> Option<(u8, i64)> {
        let mut holders = Holders::default();
        let mut number = 0;
        for &(address, key, count) in counts {
            let party = (key > 0).then_some(Party::of(Group::Owner(OwnerKey(key))));
            for _ in 0..count {
                holders.add(Whose { holder: client(address), party }, number, (address, key));
                number += 1;
            }
        }
        holders.evict(most, proxy(), |_| 0)
    }

    #[test]
    fn neither_many_addresses_nor_many_tokens_take_the_connections_of_one_who_plays() {
        let addresses = |key: i64| (2..12).map(move |address| (address, key, 8));
        let keys = (2..12).map(|key| (2, key, 8));
        let honest = [(1, 1, 20)];
        let with = |others: Vec<_>| [honest.to_vec(), others].concat();
        // Without a token, with a shared token, and with many tokens from one address.
        assert_eq!(loser_of(&with(addresses(0).collect()), 100), None);
        assert_eq!(loser_of(&with(addresses(2).collect()), 100).map(|(_, key)| key), Some(2));
        assert_eq!(loser_of(&with(keys.collect()), 100).map(|(address, _)| address), Some(2));
        // A client with many connections in the smaller part loses one if no holder in the larger part has too many.
        let singles =
            |keys: std::ops::Range<i64>| keys.map(|key| (u8::try_from(key).expect("few"), key, 1));
        let hoards: Vec<_> = singles(2..53).chain([(60, 0, 49)]).collect();
        assert_eq!(loser_of(&hoards, 100), Some((60, 0)));
        let crowd: Vec<_> = (2..52).map(|address| (address, 0, 1)).chain([(1, 1, 50)]).collect();
        assert_eq!(loser_of(&crowd, 100), Some((1, 1)));
        let few: Vec<_> = (2..82).map(|address| (address, 0, 1)).chain(honest).collect();
        assert_eq!(loser_of(&few, 100), None);
    }

    #[test]
    fn nothing_is_left_of_connections_that_are_gone() {
        let mut held = holders(&[(client(1), 2), (client(2), 1)], |number| number);
        for number in 0..3 {
            assert!(held.remove(number).is_some());
            assert!(held.remove(number).is_none());
        }
        let others = &held.others;
        assert!(others.held.is_empty() && others.by_count.is_empty() && others.sum == 0);
    }
}
