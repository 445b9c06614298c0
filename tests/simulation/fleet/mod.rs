//! Servers that share a database: their beats, take-overs and hand-overs, and the choice of the server that answers a
//! request. This does the work of `fleet` and `http::nodes` of the server without a network: the database decides,
//! and the registry below is the server's own.

mod lease;
mod routes;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use jiff::{SignedDuration, Timestamp};
use swarmbench::episode::actor::Spawn;
use swarmbench::episode::registry::Registry;
use swarmbench::ids::{EpisodeId, Place};
use swarmbench_clock::{Clock as _, after};
use swarmbench_testkit::worlds::Dice;
use tokio::sync::oneshot;

pub(crate) use self::lease::{beat, work};
pub(crate) use self::routes::{Order, client};
use crate::simulation::broken::Flaw;
use crate::simulation::clients::{Desk, Told};
use crate::simulation::database::Incarnation;
use crate::simulation::journal::MemoryJournal;
use crate::simulation::time::SimClock;

/// The network among servers, and between them and clients.
pub(crate) struct Net {
    pub(crate) clock: Arc<SimClock>,
    pub(crate) desk: Desk,
    nodes: Mutex<BTreeMap<Incarnation, Arc<Node>>>,
}

impl Net {
    pub(crate) fn new(clock: Arc<SimClock>, desk: Desk) -> Self {
        Self { clock, desk, nodes: Mutex::default() }
    }

    pub(crate) fn add(&self, node: Arc<Node>) {
        self.nodes.lock().expect("one thread").insert(node.incarnation, node);
    }

    /// Removes the process of a server.
    pub(crate) fn remove(&self, incarnation: Incarnation) {
        let node = self.nodes.lock().expect("one thread").remove(&incarnation);
        // The drop runs code that looks at the other servers, so the lock must be free.
        drop(node);
    }

    /// Whether the process of a server exists, stopped or not.
    fn is_there(&self, incarnation: Incarnation) -> bool {
        self.nodes.lock().expect("one thread").contains_key(&incarnation)
    }

    /// A server that accepts requests.
    fn node(&self, incarnation: Incarnation) -> Option<Arc<Node>> {
        let node = self.nodes.lock().expect("one thread").get(&incarnation).cloned()?;
        node.accepts.load(Ordering::Relaxed).then_some(node)
    }

    /// A random server for a client.
    fn any(&self, dice: &mut Dice) -> Option<Incarnation> {
        let nodes = self.nodes.lock().expect("one thread");
        let all: Vec<Incarnation> = nodes.keys().copied().collect();
        (!all.is_empty()).then(|| all[dice.below(all.len())])
    }

    /// Sends a request to a server; `None` if it accepts none.
    fn send(
        self: &Arc<Self>,
        to: Incarnation,
        order: &Order,
        is_hop: bool,
    ) -> Option<oneshot::Receiver<Reply>> {
        let node = self.node(to)?;
        let (done, answer) = oneshot::channel();
        let spawn = Arc::clone(&node.spawn);
        spawn(Box::pin(routes::answer(Arc::clone(self), node, order.clone(), is_hop, done)));
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
pub(crate) struct Node {
    pub(crate) incarnation: Incarnation,
    pub(crate) registry: Registry,
    pub(crate) journal: Arc<MemoryJournal>,
    clock: Arc<SimClock>,
    spawn: Spawn,
    flaw: Option<Flaw>,
    /// The error of its own clock.
    off: SignedDuration,
    /// All servers, as last seen.
    members: Mutex<Vec<Member>>,
    answers_until: Mutex<Timestamp>,
    /// The known owners of places; none where everything has ended.
    owners: Mutex<BTreeMap<Place, Option<Incarnation>>>,
    places: Mutex<BTreeMap<EpisodeId, Place>>,
    accepts: AtomicBool,
}

/// A server, as last seen.
#[derive(Clone, Copy, Debug)]
struct Member {
    incarnation: Incarnation,
    is_expired: bool,
    is_ready: bool,
}

impl Node {
    pub(crate) fn new(
        registry: Registry,
        journal: Arc<MemoryJournal>,
        clock: Arc<SimClock>,
        spawn: Spawn,
        off: SignedDuration,
        flaw: Option<Flaw>,
    ) -> Self {
        let node = Self {
            incarnation: journal.incarnation(),
            registry,
            journal,
            answers_until: Mutex::new(clock.now()),
            clock,
            spawn,
            flaw,
            off,
            members: Mutex::default(),
            owners: Mutex::default(),
            places: Mutex::default(),
            accepts: AtomicBool::new(true),
        };
        node.answers_from(node.clock.now());
        node
    }

    /// Accepts no more requests and no more work.
    pub(crate) fn shut(&self) {
        self.accepts.store(false, Ordering::Relaxed);
    }

    pub(crate) fn is_shut(&self) -> bool {
        !self.accepts.load(Ordering::Relaxed)
    }

    /// Whether the server's lease lets it answer.
    pub(crate) fn may_answer(&self) -> bool {
        self.clock.now() < *self.answers_until.lock().expect("one thread")
    }

    /// Whether the server believes that it may answer.
    fn answers(&self) -> bool {
        self.flaw == Some(Flaw::AnswersForever) || self.may_answer()
    }

    pub(crate) fn answers_from(&self, sent: Timestamp) {
        *self.answers_until.lock().expect("one thread") =
            after(sent, swarmbench::store::ANSWERS_FOR);
    }

    /// The clock by which this server judges leases: that of the database.
    pub(crate) fn lease_clock(&self) -> Timestamp {
        let now = self.clock.now();
        if self.flaw == Some(Flaw::LeaseByOwnClock) {
            return now.saturating_add(self.off).expect("near the present");
        }
        now
    }

    fn members(&self) -> Vec<Member> {
        self.members.lock().expect("one thread").clone()
    }

    /// The server that should take a place without an owner; the same for all who see the same servers.
    fn preferred(&self, place: Place) -> Incarnation {
        let (_, key) = place.numbers();
        let ready = self.members().into_iter().filter(|member| member.is_ready);
        let weight = |incarnation: &Incarnation| {
            Dice(key.cast_unsigned() ^ incarnation.cast_unsigned().rotate_left(32)).below(1 << 20)
        };
        ready.map(|member| member.incarnation).max_by_key(weight).unwrap_or(self.incarnation)
    }
}
