//! The places of a server, as far as it knows.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Mutex, MutexGuard};

use super::{Incarnation, ServerRow, number_of, preferred};
use crate::ids::Place;

/// Places that a server owns, and those that it may have taken. The database has the truth: a change there comes first, and is
/// noted here before the next one.
#[derive(Debug, Default)]
pub struct Places {
    owned: Mutex<BTreeMap<Place, Owned>>,
    /// The newest server that this one has seen.
    newest: AtomicI64,
    /// Places taken but perhaps not resumed: the client that asked for them may be gone.
    taken: Mutex<BTreeSet<Place>>,
}

#[derive(Clone, Copy, Debug)]
struct Owned {
    state: State,
    /// The newest server when this one took the place.
    newest: Incarnation,
}

/// State of an owned place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Has,
    /// Being released: nothing new begins there.
    Leaves,
}

impl Places {
    /// Whether the server owns a place and is not releasing it.
    #[must_use]
    pub fn has(&self, place: Place) -> bool {
        self.owned().get(&place).is_some_and(|owned| owned.state == State::Has)
    }

    /// The server that does what is due at a place for which no request has come: `me`, where it has the place, or else the
    /// preferred one, which takes the place unless another owns it. `None` if no server takes places.
    #[must_use]
    pub fn keeper(
        &self,
        place: Place,
        me: Incarnation,
        servers: &[ServerRow],
    ) -> Option<Incarnation> {
        if self.has(place) { Some(me) } else { preferred(servers, number_of(place)) }
    }

    /// All owned places, including those being released.
    #[must_use]
    pub fn all(&self) -> Vec<Place> {
        self.owned().keys().copied().collect()
    }

    /// Number of owned places.
    #[must_use]
    pub fn count(&self) -> usize {
        self.owned().len()
    }

    /// Notes places that a commit has created, or that a release has not released.
    pub fn gained(&self, places: impl IntoIterator<Item = Place>) {
        let owned = self.taken_now();
        self.owned().extend(places.into_iter().map(|place| (place, owned)));
    }

    /// Notes places that the database shows as owned. One that is being released stays so.
    pub fn confirmed(&self, places: impl IntoIterator<Item = Place>) {
        let taken = self.taken_now();
        let mut owned = self.owned();
        for place in places {
            owned.entry(place).or_insert(taken);
        }
    }

    /// Notes released places.
    pub fn lost(&self, places: impl IntoIterator<Item = Place>) {
        let mut owned = self.owned();
        for place in places {
            owned.remove(&place);
        }
    }

    /// Starts to release a place: nothing new begins there. False if the server does not own it.
    pub fn leave(&self, place: Place) -> bool {
        self.owned().get_mut(&place).map(|owned| owned.state = State::Leaves).is_some()
    }

    /// Cancels the release of a place.
    pub fn stay(&self, place: Place) {
        if let Some(owned) = self.owned().get_mut(&place) {
            owned.state = State::Has;
        }
    }

    /// Notes places that may have been taken.
    pub fn note_taken(&self, places: impl IntoIterator<Item = Place>) {
        self.taken().extend(places);
    }

    /// Drains the places that may have been taken; the caller resumes their unfinished work.
    #[must_use]
    pub fn drain_taken(&self) -> Vec<Place> {
        std::mem::take(&mut *self.taken()).into_iter().collect()
    }

    /// Notes the servers of the cluster.
    pub fn saw(&self, servers: &[ServerRow]) {
        if let Some(newest) = servers.iter().map(|row| row.incarnation).max() {
            self.newest.fetch_max(newest, Ordering::AcqRel);
        }
    }

    /// Whether a server has joined since this one took a place.
    #[must_use]
    pub fn is_older(&self, place: Place, server: Incarnation) -> bool {
        self.owned().get(&place).is_some_and(|owned| owned.newest < server)
    }

    fn taken_now(&self) -> Owned {
        Owned { state: State::Has, newest: self.newest.load(Ordering::Acquire) }
    }

    fn owned(&self) -> MutexGuard<'_, BTreeMap<Place, Owned>> {
        self.owned.lock().expect("nothing panics while it holds this")
    }

    fn taken(&self) -> MutexGuard<'_, BTreeSet<Place>> {
        self.taken.lock().expect("nothing panics while it holds this")
    }
}
