//! Which connection is evicted when the limit is reached and another client connects.
//!
//! Half of all connections are for parties, who have sent a token; what they do not use is for others. Within its part, the
//! holder with the most connections loses one, as long as it has more than its fair share of them. Which one of its
//! connections that is, the caller's order decides.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::net::IpAddr;

use crate::fair::Party;

/// Connections of one client that are compared to choose one of them: the oldest ones.
const COMPARED_MAX: usize = 256;

/// For whom connections are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Holder {
    /// The address, or the /48 network of IPv6, that sent the last request.
    Client(IpAddr),
    /// The clients of this trusted proxy whose connections have not sent a request yet.
    Unknown(IpAddr),
    /// The party whose token came last.
    Party(Party),
}

#[derive(Debug)]
pub(super) struct Holders<T> {
    /// By the order in which they were accepted; no entry is empty.
    held: HashMap<Holder, BTreeMap<u64, T>>,
    parties: Part,
    others: Part,
}

/// The holders of one kind.
#[derive(Debug, Default)]
struct Part {
    connections: usize,
    by_count: BTreeSet<(usize, Holder)>,
}

impl<T> Default for Holders<T> {
    fn default() -> Self {
        Self { held: HashMap::new(), parties: Part::default(), others: Part::default() }
    }
}

impl<T> Holders<T> {
    pub(super) fn add(&mut self, holder: Holder, number: u64, connection: T) {
        self.change(holder, |held| held.insert(number, connection));
    }

    /// None if it was removed before.
    pub(super) fn remove(&mut self, holder: Holder, number: u64) -> Option<T> {
        self.change(holder, |held| held.remove(&number))
    }

    fn change<R>(&mut self, holder: Holder, change: impl FnOnce(&mut BTreeMap<u64, T>) -> R) -> R {
        let held = self.held.entry(holder).or_default();
        let before = held.len();
        let result = change(held);
        let after = held.len();
        if after == 0 {
            self.held.remove(&holder);
        }
        if after != before {
            let is_party = matches!(holder, Holder::Party(_));
            let part = if is_party { &mut self.parties } else { &mut self.others };
            part.connections = part.connections - before + after;
            part.by_count.remove(&(before, holder));
            if after > 0 {
                part.by_count.insert((after, holder));
            }
        }
        result
    }

    /// Removes the connection that makes room for one of `newcomer`, which has sent no token yet: of the holder with the most
    /// connections, the least by `key`. None if no holder has more than its share.
    pub(super) fn evict<K: Ord>(
        &mut self,
        most: usize,
        newcomer: Holder,
        key: impl Fn(&T) -> K,
    ) -> Option<T> {
        let (parties, others, half) = (self.parties.connections, self.others.connections, most / 2);
        // Rounded up, or two clients would close each other's connections again and again.
        let (part, share) = if parties <= half || others >= half {
            let holders =
                self.others.by_count.len() + usize::from(!self.held.contains_key(&newcomer));
            (&self.others, (most - parties.min(half)).div_ceil(holders))
        } else {
            let most = most.saturating_sub(others + 1);
            (&self.parties, most.div_ceil(self.parties.by_count.len()))
        };
        let &(count, holder) = part.by_count.last()?;
        if count <= share {
            return None;
        }
        let oldest = self.held.get(&holder)?.iter().take(COMPARED_MAX);
        let (&number, _) = oldest.min_by_key(|(_, connection)| key(connection))?;
        self.remove(holder, number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(number: u8) -> Holder {
        Holder::Client([192, 0, 2, number].into())
    }

    fn proxy() -> Holder {
        Holder::Unknown([127, 0, 0, 1].into())
    }

    /// Connections by holder. Each is worth what `worth` makes of its number.
    fn holders(counts: &[(Holder, u64)], worth: impl Fn(u64) -> u64) -> Holders<(Holder, u64)> {
        let mut holders = Holders::default();
        let mut number = 0;
        for &(holder, count) in counts {
            for _ in 0..count {
                holders.add(holder, number, (holder, worth(number)));
                number += 1;
            }
        }
        holders
    }

    /// Who loses a connection to a client behind the proxy.
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
            // Clients that say nothing are one holder, and the newcomer is of them.
            (&[(client(1), 4), (proxy(), 6)], 10, Some(proxy())),
            (&[(client(1), 5), (proxy(), 5)], 10, None),
            (&[(proxy(), 10)], 10, None),
            // With the newcomer they are four: none has more than three.
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

    #[test]
    fn nothing_is_left_of_connections_that_are_gone() {
        let mut held = holders(&[(client(1), 2), (client(2), 1)], |number| number);
        assert!(held.remove(client(2), 0).is_none());
        for (holder, number) in [(client(1), 0), (client(1), 1), (client(2), 2)] {
            assert!(held.remove(holder, number).is_some());
            assert!(held.remove(holder, number).is_none());
        }
        assert!(held.held.is_empty() && held.others.by_count.is_empty());
    }
}
