//! The simulated database, clock and games of one server, for its part in the cluster.

use std::collections::{BTreeSet, HashSet};
use std::sync::Arc;
use std::time::Duration;

use swarmbench::cluster::watch::ClockSeen;
use swarmbench::cluster::{Death, Incarnation, Places, ServerRow};
use swarmbench::ids::Place;
use swarmbench::membership::{Others, Port};
use swarmbench::store::StoreError;
use swarmbench_clock::{Clock as _, after};

use super::{Net, Peer};
use crate::simulation::broken::Flaw;
use crate::simulation::database::Tables;

/// A server and the network in which it is.
pub(crate) struct Site {
    pub(crate) net: Arc<Net>,
    pub(crate) peer: Arc<Peer>,
}

impl Site {
    /// The servers in the database.
    fn shown(&self, tables: &Tables) -> Vec<ServerRow> {
        let now = self.peer.lease_clock();
        // A server with the flaw believes its clock alone, and not the beats that it sees.
        let sees_beats = self.peer.flaw != Some(Flaw::LeaseByOwnClock);
        let row = |(incarnation, beat_at, is_ready): (_, jiff::Timestamp, _)| ServerRow {
            incarnation,
            address: String::new(),
            name: String::new(),
            version: String::new(),
            joined_at_ms: 0,
            beat_at_ms: if sees_beats { beat_at.as_millisecond() } else { 0 },
            seen_ms_ago: now.as_millisecond() - beat_at.as_millisecond(),
            is_connected: self.net.is_there(incarnation),
            clock_offset_ms: 0,
            is_ready,
            episodes: 0,
            places: 0,
        };
        tables.servers().map(row).collect()
    }
}

impl Others for Site {
    fn servers(&self) -> Arc<[ServerRow]> {
        self.peer.servers()
    }

    fn set_servers(&self, servers: Arc<[ServerRow]>) {
        self.places().saw(&servers);
        *self.peer.servers.lock().expect("one thread") = servers;
    }

    async fn is_dead(&self, row: &ServerRow) -> bool {
        !self.net.is_there(row.incarnation)
    }

    async fn exclude(&self, server: Incarnation, death: Death) -> Result<bool, StoreError> {
        let is_silent = |tables: &Tables| {
            let now = self.peer.lease_clock().as_millisecond();
            let beat_at = tables.beat_at(server);
            beat_at.is_some_and(|at| now - at.as_millisecond() > death.silent_ms())
        };
        if self.peer.flaw == Some(Flaw::FreesPlacesFirst) {
            let frees = |tables: &mut Tables| {
                if is_silent(tables) {
                    tables.free(server);
                }
            };
            self.peer.journal.at_database(frees).await;
        }
        let deletes = |tables: &mut Tables| {
            let is_silent = is_silent(tables);
            if is_silent {
                tables.delete(server);
            }
            is_silent
        };
        Ok(self.peer.journal.at_database(deletes).await)
    }
}

impl Port for Site {
    type Others = Self;
    type Held<'a> = ();

    fn others(&self) -> &Self {
        self
    }

    fn places(&self) -> &Places {
        self.peer.journal.places()
    }

    fn me(&self) -> Incarnation {
        self.peer.incarnation
    }

    fn forwards_only(&self) -> bool {
        false
    }

    fn now(&self) -> Duration {
        self.peer.time()
    }

    async fn sleep(&self, pause: Duration) {
        let clock = &self.net.clock;
        clock.sleep_until(after(clock.now(), pause)).await;
    }

    async fn beat(&self) -> Result<(), StoreError> {
        let peer = &self.peer;
        let sent = peer.time();
        let beats =
            |tables: &mut Tables| tables.beat(self.me(), peer.lease_clock(), !peer.is_shut());
        if !peer.journal.at_database(beats).await {
            return Err(StoreError::Failed);
        }
        let is_late = peer.flaw == Some(Flaw::LeaseFromTheReply);
        peer.lease.renew(if is_late { peer.time() } else { sent });
        Ok(())
    }

    async fn look(&self) -> Result<Vec<ServerRow>, StoreError> {
        Ok(self.peer.journal.at_database(|tables| self.shown(tables)).await)
    }

    async fn unowned(&self) -> Result<Vec<Place>, StoreError> {
        let unowned = self.peer.journal.at_database(|tables| tables.unowned()).await;
        Ok(unowned.into_iter().map(|one| Place::Game(one.episode)).collect())
    }

    async fn take(&self, places: &[Place]) -> Result<Vec<(Place, Incarnation)>, StoreError> {
        let mut owners = Vec::new();
        for place in places {
            owners.push((*place, self.peer.journal.take_noted(*place).await?));
        }
        Ok(owners)
    }

    async fn release(&self, places: &[Place]) -> Result<(), StoreError> {
        for place in places {
            self.peer.journal.release(*place).await;
        }
        Ok(())
    }

    async fn release_ended(&self) -> Result<(), StoreError> {
        self.peer.journal.release_ended().await;
        Ok(())
    }

    async fn delete_old_changes(&self) -> Result<(), StoreError> {
        Ok(())
    }

    async fn resume(&self, places: &[Place]) -> Result<(), StoreError> {
        if places.is_empty() {
            return Ok(());
        }
        // Some episodes may have ended since.
        let mut unfinished = self.peer.journal.at_database(|tables| tables.unfinished()).await;
        unfinished.retain(|one| places.contains(&Place::Game(one.episode)));
        self.peer.registry.adopt(unfinished).await;
        Ok(())
    }

    fn idle(&self, places: Vec<Place>) -> (Vec<Place>, ()) {
        if self.peer.flaw == Some(Flaw::GivesUpWhatIsUsed) {
            return (places, ());
        }
        let idle = self.peer.registry.idle_places(places.iter().copied().collect());
        (places.into_iter().filter(|place| idle.contains(place)).collect(), ())
    }

    async fn evict(&self, places: &[Place]) -> Result<BTreeSet<Place>, StoreError> {
        if self.peer.flaw == Some(Flaw::GivesUpWhatIsUsed) {
            return Ok(places.iter().copied().collect());
        }
        let places: HashSet<Place> = places.iter().copied().collect();
        Ok(self.peer.registry.give_up(places).await?.into_iter().collect())
    }

    fn excluded(&self) {
        self.peer.journal.set_excluded();
    }

    fn ready(&self) {}

    fn clock_seen(&self, _: ClockSeen) {}

    fn measure(&self) {}
}
