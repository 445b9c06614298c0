//! The durable data: the entries of all episodes, and of a cluster the servers, the times when they
//! were seen, and the owners of places. It stands for the tables `nodes`, `members` and `places` of PostgreSQL.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};

use jiff::Timestamp;
use swarmbench::cluster::Incarnation;
use swarmbench::episode::Status;
use swarmbench::ids::{EpisodeId, EpisodeKey, Place};
use swarmbench::keys::OwnerKey;
use swarmbench::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, OpeningRow, RoundRow, SeatingRow,
};
use swarmbench::store::port::{StoredEpisode, Unfinished};
use swarmbench_journal::record::{ActRecord, Source};

#[derive(Default)]
pub(crate) struct Database(Mutex<Tables>);

#[derive(Default)]
pub(crate) struct Tables {
    /// Entries that survive a crash.
    pub(crate) durable: Vec<Entry>,
    servers: BTreeMap<Incarnation, Server>,
    places: BTreeMap<Place, Incarnation>,
    /// The number of unfinished games that servers gave up.
    pub(crate) given_up: usize,
    /// The last number of a server.
    given: Incarnation,
}

/// The rows of a server.
#[derive(Clone, Copy, Debug)]
struct Server {
    slot: i16,
    beat_at: Timestamp,
    is_ready: bool,
}

impl Database {
    pub(crate) fn tables(&self) -> MutexGuard<'_, Tables> {
        self.0.lock().expect("one thread")
    }
}

impl Tables {
    /// Adds a server; its predecessor in this slot is gone.
    pub(crate) fn join(&mut self, slot: i16, now: Timestamp) -> Incarnation {
        let before = self.servers.iter().find(|(_, server)| server.slot == slot);
        if let Some(before) = before.map(|(&incarnation, _)| incarnation) {
            self.delete(before);
        }
        self.given += 1;
        self.servers.insert(self.given, Server { slot, beat_at: now, is_ready: false });
        self.given
    }

    /// True if a server is registered, and thus may write.
    pub(crate) fn knows(&self, incarnation: Incarnation) -> bool {
        self.servers.contains_key(&incarnation)
    }

    /// Records a beat of a server; returns false if the server was excluded.
    pub(crate) fn beat(&mut self, incarnation: Incarnation, at: Timestamp, is_ready: bool) -> bool {
        let Some(server) = self.servers.get_mut(&incarnation) else { return false };
        (server.beat_at, server.is_ready) = (at, is_ready);
        true
    }

    /// All servers, the oldest first: their numbers, last beats, and whether they take places.
    pub(crate) fn servers(&self) -> impl Iterator<Item = (Incarnation, Timestamp, bool)> {
        self.servers.iter().map(|(&number, server)| (number, server.beat_at, server.is_ready))
    }

    /// Time of the last beat of a server; `None` if it is not registered.
    pub(crate) fn beat_at(&self, incarnation: Incarnation) -> Option<Timestamp> {
        self.servers.get(&incarnation).map(|server| server.beat_at)
    }

    /// Deletes the rows of a server and its places.
    pub(crate) fn delete(&mut self, incarnation: Incarnation) {
        self.servers.remove(&incarnation);
        self.free(incarnation);
    }

    /// Frees the places of a server.
    pub(crate) fn free(&mut self, incarnation: Incarnation) {
        self.places.retain(|_, owner| *owner != incarnation);
    }

    /// Takes a place for a server unless another owns it; returns the owner. `None` if the server was excluded.
    pub(crate) fn take(&mut self, place: Place, incarnation: Incarnation) -> Option<Incarnation> {
        if let Some(&owner) = self.places.get(&place) {
            return Some(owner);
        }
        self.put(place, incarnation).then_some(incarnation)
    }

    /// Sets the owner of a place; returns false if that server was excluded.
    pub(crate) fn put(&mut self, place: Place, incarnation: Incarnation) -> bool {
        let is_known = self.knows(incarnation);
        if is_known {
            self.places.insert(place, incarnation);
        }
        is_known
    }

    /// Gives a place of a server back.
    pub(crate) fn release(&mut self, place: Place, incarnation: Incarnation) {
        if self.places.get(&place) == Some(&incarnation) {
            self.places.remove(&place);
            self.given_up += 1;
        }
    }

    /// Gives back all places of a server at which everything has ended.
    pub(crate) fn release_ended(&mut self, incarnation: Incarnation) -> Vec<Place> {
        let owned = self.places.iter().filter(|(_, owner)| **owner == incarnation);
        let mut ended: Vec<Place> = owned.map(|(place, _)| *place).collect();
        ended.retain(|place| !self.is_unfinished(*place));
        self.places.retain(|place, _| !ended.contains(place));
        ended
    }

    pub(crate) fn owner(&self, place: Place) -> Option<Incarnation> {
        self.places.get(&place).copied()
    }

    pub(crate) fn places(&self) -> impl Iterator<Item = (Place, Incarnation)> {
        self.places.iter().map(|(&place, &owner)| (place, owner))
    }

    /// True if a place has anything unfinished.
    pub(crate) fn is_unfinished(&self, place: Place) -> bool {
        self.openings()
            .any(|row| Place::Game(row.episode) == place && self.end(row.episode).is_none())
    }

    pub(crate) fn key_of(&self, id: &EpisodeId) -> Option<EpisodeKey> {
        self.openings().find(|row| row.id == *id).map(|row| row.episode)
    }

    /// All unfinished episodes; those with a round clock first.
    pub(crate) fn unfinished(&self) -> Vec<Unfinished> {
        let unfinished = |row: &OpeningRow| Unfinished {
            run: None,
            episode: row.episode,
            id: row.id.clone(),
            owner: row.owner,
            clocked: row.clocked,
            played: None,
        };
        let running = self.openings().filter(|row| self.end(row.episode).is_none());
        let mut all: Vec<_> = running.map(unfinished).collect();
        all.sort_by_key(|episode| (!episode.clocked, episode.episode));
        all
    }

    /// Unfinished episodes without an owner.
    pub(crate) fn unowned(&self) -> Vec<Unfinished> {
        let mut unowned = self.unfinished();
        unowned.retain(|one| self.owner(Place::Game(one.episode)).is_none());
        unowned
    }

    /// The number of the newest episode, 0 without any.
    pub(crate) fn last_key(&self) -> i64 {
        self.openings().map(|row| row.episode.0).max().unwrap_or(0)
    }

    /// Bytes of the acts of all episodes, by key.
    pub(crate) fn bytes_by_owner(&self) -> Vec<(OwnerKey, u64)> {
        let owned = self.openings().filter_map(|row| Some((row.owner?, row.episode)));
        owned
            .map(|(owner, key)| {
                let acts = self.acts(key).map(|row| row.record.as_str().len() as u64);
                (owner, acts.sum())
            })
            .collect()
    }

    pub(crate) fn openings(&self) -> impl Iterator<Item = &OpeningRow> {
        self.durable.iter().filter_map(|entry| match entry {
            Entry::Open(row) => Some(&**row),
            _ => None,
        })
    }

    pub(crate) fn acts(&self, key: EpisodeKey) -> impl Iterator<Item = &ActRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Act(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    pub(crate) fn rounds(&self, key: EpisodeKey) -> impl Iterator<Item = &RoundRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Round(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    pub(crate) fn end(&self, key: EpisodeKey) -> Option<&EndRow> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::End(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    pub(crate) fn seating(&self, key: EpisodeKey) -> Option<&SeatingRow> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::Seat(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    pub(crate) fn claims(&self, key: EpisodeKey) -> impl Iterator<Item = &ClaimRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Claim(row) if row.episode == key => Some(&**row),
            _ => None,
        })
    }

    pub(crate) fn started_at(&self, key: EpisodeKey) -> Option<jiff::Timestamp> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::Start { episode, at } if *episode == key => Some(*at),
            _ => None,
        })
    }

    pub(crate) fn episode(&self, row: &OpeningRow) -> StoredEpisode {
        let key = row.episode;
        let (last, end, started_at) =
            (self.rounds(key).last(), self.end(key), self.started_at(key));
        let status = match end {
            Some(end) => end.status,
            None if row.waiting && started_at.is_none() => Status::Waiting.name(),
            None => Status::Running.name(),
        };
        let by_player = |act: &&ActRow| record(act).source == Source::Player;
        StoredEpisode {
            episode: key,
            id: row.id.clone(),
            owner: row.owner,
            run: row.run.map(|(run, _)| run),
            revealed: false,
            own_from: None,
            opening: row.record.clone(),
            first_round: row.fork.map_or(0, |(_, round)| round),
            seating: self.seating(key).map(|row| row.record.clone()),
            status: status.to_owned(),
            reason: end.map(|end| end.reason.to_owned()),
            end: end.map(|end| end.record.clone()),
            head: match (end, last, self.seating(key)) {
                (Some(end), ..) => end.head,
                (None, Some(round), _) => round.head,
                (None, None, Some(seating)) => seating.head,
                (None, None, None) => row.head,
            },
            rounds: last.map_or(0, |round| round.round + 1),
            score: last.map_or(0.0, |round| round.score),
            created_at: row.at,
            newest_at: (self.rounds(key).map(|round| round.at))
                .chain(self.acts(key).map(|act| act.at))
                .chain(started_at)
                .chain(end.map(|end| end.at))
                .fold(row.at, jiff::Timestamp::max),
            last_act_at: self.acts(key).filter(by_player).map(|act| act.at).max().or(started_at),
            ended_at: end.map(|end| end.at),
            void_reason: None,
            has_people: row.has_people,
            curve: None,
            act_bytes: None,
        }
    }
}

/// The record of an act, which must be valid.
pub(crate) fn record(row: &ActRow) -> ActRecord {
    row.record.read().expect("it was written as an act")
}
