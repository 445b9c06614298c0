//! Servers that share a database. Their part in the cluster and the way of a request are the server's own code
//! ([`swarmbench::membership`], [`swarmbench::cluster`]); the database and the network are simulated.

mod port;
mod requests;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use swarmbench::cluster::route::{Owner, View};
use swarmbench::cluster::{Incarnation, Lease, ServerRow, preferred};
use swarmbench::episode::actor::Spawn;
use swarmbench::episode::registry::Registry;
use swarmbench::ids::{EpisodeId, Place};
use swarmbench_clock::Clock as _;
use swarmbench_testkit::worlds::Dice;
use tokio::sync::oneshot;

pub(crate) use self::port::Site;
pub(crate) use self::requests::{Order, client};
use crate::simulation::broken::Flaw;
use crate::simulation::clients::{Desk, Told};
use crate::simulation::journal::MemoryJournal;
use crate::simulation::time::SimClock;

/// The network among servers, and between them and clients.
pub(crate) struct Net {
    pub(crate) clock: Arc<SimClock>,
    pub(crate) desk: Desk,
    peers: Mutex<BTreeMap<Incarnation, Arc<Peer>>>,
}

impl Net {
    pub(crate) fn new(clock: Arc<SimClock>, desk: Desk) -> Self {
        Self { clock, desk, peers: Mutex::default() }
    }

    pub(crate) fn add(&self, peer: Arc<Peer>) {
        self.peers.lock().expect("one thread").insert(peer.incarnation, peer);
    }

    /// Removes the process of a server.
    pub(crate) fn remove(&self, incarnation: Incarnation) {
        let peer = self.peers.lock().expect("one thread").remove(&incarnation);
        // The drop runs code that looks at the other servers, so the lock must be free.
        drop(peer);
    }

    /// True if the process of a server exists, stopped or not.
    fn is_there(&self, incarnation: Incarnation) -> bool {
        self.peers.lock().expect("one thread").contains_key(&incarnation)
    }

    /// A server that accepts requests.
    fn peer(&self, incarnation: Incarnation) -> Option<Arc<Peer>> {
        let peer = self.peers.lock().expect("one thread").get(&incarnation).cloned()?;
        (!peer.is_shut()).then_some(peer)
    }

    /// A random server for a client.
    fn any(&self, dice: &mut Dice) -> Option<Incarnation> {
        let peers = self.peers.lock().expect("one thread");
        let all: Vec<Incarnation> = peers.keys().copied().collect();
        (!all.is_empty()).then(|| all[dice.below(all.len())])
    }

    /// Sends a request to a server; `None` if it accepts none.
    fn send(
        self: &Arc<Self>,
        to: Incarnation,
        order: &Order,
        is_hop: bool,
    ) -> Option<oneshot::Receiver<Reply>> {
        let peer = self.peer(to)?;
        let (done, answer) = oneshot::channel();
        let spawn = Arc::clone(&peer.spawn);
        spawn(Box::pin(requests::answer(Arc::clone(self), peer, order.clone(), is_hop, done)));
        Some(answer)
    }
}

/// The reply of a server.
enum Reply {
    Done(Vec<Told>),
    /// Another server plays the place.
    Elsewhere,
    /// The server cannot answer now; nothing was executed.
    NotDone,
    /// The request may have been executed.
    Unknown,
}

/// A server during the life of its process.
pub(crate) struct Peer {
    pub(crate) incarnation: Incarnation,
    pub(crate) registry: Registry,
    pub(crate) journal: Arc<MemoryJournal>,
    pub(crate) lease: Lease,
    clock: Arc<SimClock>,
    spawn: Spawn,
    flaw: Option<Flaw>,
    /// The error of its own clock.
    off: SignedDuration,
    /// All servers, as last seen.
    servers: Mutex<Arc<[ServerRow]>>,
    owners: Mutex<BTreeMap<Place, Owner>>,
    places: Mutex<BTreeMap<EpisodeId, Place>>,
    accepts: AtomicBool,
}

impl Peer {
    pub(crate) fn new(
        registry: Registry,
        journal: Arc<MemoryJournal>,
        clock: Arc<SimClock>,
        spawn: Spawn,
        off: SignedDuration,
        flaw: Option<Flaw>,
    ) -> Self {
        let peer = Self {
            incarnation: journal.incarnation(),
            registry,
            journal,
            lease: Lease::default(),
            clock,
            spawn,
            flaw,
            off,
            servers: Mutex::new(Arc::default()),
            owners: Mutex::default(),
            places: Mutex::default(),
            accepts: AtomicBool::new(true),
        };
        peer.lease.renew(peer.time());
        peer
    }

    /// Accepts no more requests and no more work.
    pub(crate) fn shut(&self) {
        self.accepts.store(false, Ordering::Relaxed);
    }

    pub(crate) fn is_shut(&self) -> bool {
        !self.accepts.load(Ordering::Relaxed)
    }

    /// True if the server's lease lets it answer.
    pub(crate) fn may_answer(&self) -> bool {
        !self.lease.left(self.time()).is_zero()
    }

    /// True if the server believes that it may answer.
    fn answers(&self) -> bool {
        self.flaw == Some(Flaw::AnswersForever) || self.may_answer()
    }

    /// The time by which this server counts, which is that of all.
    pub(crate) fn time(&self) -> Duration {
        Duration::from_millis(self.clock.now().as_millisecond().unsigned_abs())
    }

    /// The clock by which this server judges leases: that of the database.
    pub(crate) fn lease_clock(&self) -> Timestamp {
        let now = self.clock.now();
        if self.flaw == Some(Flaw::LeaseByOwnClock) {
            return now.saturating_add(self.off).expect("near the present");
        }
        now
    }

    fn servers(&self) -> Arc<[ServerRow]> {
        Arc::clone(&self.servers.lock().expect("one thread"))
    }
}

impl View for Peer {
    fn me(&self) -> Incarnation {
        self.incarnation
    }

    fn takes_places(&self) -> bool {
        !self.is_shut()
    }

    fn has(&self, place: Place) -> bool {
        self.journal.places().has(place)
    }

    fn is_in_cluster(&self, server: Incarnation) -> bool {
        self.servers().iter().any(|row| row.incarnation == server)
    }

    fn preferred(&self, number: u64) -> Option<Incarnation> {
        preferred(&self.servers(), number)
    }

    fn known_owner(&self, place: Place) -> Option<Owner> {
        self.owners.lock().expect("one thread").get(&place).copied()
    }

    fn note_owner(&self, place: Place, owner: Owner) {
        self.owners.lock().expect("one thread").insert(place, owner);
    }

    fn forget_owner(&self, place: Place) {
        self.owners.lock().expect("one thread").remove(&place);
    }
}
