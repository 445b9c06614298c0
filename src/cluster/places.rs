//! The places of a server, as far as it knows.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard};

use crate::ids::Place;

/// Places that a server owns, and those that it may have taken. The database has the truth: a change there comes first, and is
/// noted here before the next one.
#[derive(Debug, Default)]
pub struct Places {
    owned: Mutex<BTreeMap<Place, State>>,
    /// Places taken but perhaps not resumed: the client that asked for them may be gone.
    taken: Mutex<BTreeSet<Place>>,
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
        self.owned().get(&place) == Some(&State::Has)
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
        self.owned().extend(places.into_iter().map(|place| (place, State::Has)));
    }

    /// Notes places that the database shows as owned. One that is being released stays so.
    pub fn confirmed(&self, places: impl IntoIterator<Item = Place>) {
        let mut owned = self.owned();
        for place in places {
            owned.entry(place).or_insert(State::Has);
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
        self.owned().get_mut(&place).is_some_and(|state| {
            *state = State::Leaves;
            true
        })
    }

    /// Cancels the release of a place.
    pub fn stay(&self, place: Place) {
        if let Some(state) = self.owned().get_mut(&place) {
            *state = State::Has;
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

    fn owned(&self) -> MutexGuard<'_, BTreeMap<Place, State>> {
        self.owned.lock().expect("nothing panics while it holds this")
    }

    fn taken(&self) -> MutexGuard<'_, BTreeSet<Place>> {
        self.taken.lock().expect("nothing panics while it holds this")
    }
}
