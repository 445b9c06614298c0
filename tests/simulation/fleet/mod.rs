//! Several servers that share a database: when each says that it lives, takes over and gives up, and which of them answers a
//! request. It does what `fleet` and `http::nodes` of the server do, without a network: what decides is the database, and the
//! registry below is that of the server.

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

/// What servers reach of each other, and clients of them.
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

    /// The process of a server is gone.
    pub(crate) fn remove(&self, incarnation: Incarnation) {
        let node = self.nodes.lock().expect("one thread").remove(&incarnation);
        // What ends with it looks at the others.
        drop(node);
    }

    /// Whether the process of a server is there, stopped or not.
    fn is_there(&self, incarnation: Incarnation) -> bool {
        self.nodes.lock().expect("one thread").contains_key(&incarnation)
    }

    /// A server that accepts requests.
    fn node(&self, incarnation: Incarnation) -> Option<Arc<Node>> {
        let node = self.nodes.lock().expect("one thread").get(&incarnation).cloned()?;
        node.accepts.load(Ordering::Relaxed).then_some(node)
    }

    /// Some server that a client finds.
    fn any(&self, dice: &mut Dice) -> Option<Incarnation> {
        let nodes = self.nodes.lock().expect("one thread");
        let all: Vec<Incarnation> = nodes.keys().copied().collect();
        (!all.is_empty()).then(|| all[dice.below(all.len())])
    }

    /// Sends a request to a server; none where it accepts none.
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

/// What a server answers.
enum Reply {
    Done(Vec<Told>),
    /// It does not play what this is about.
    Elsewhere,
    /// It answers nothing now; nothing was done.
    NotDone,
    /// It may have been done, or not.
    Unknown,
}

/// A server, as long as its process lives.
pub(crate) struct Node {
    pub(crate) incarnation: Incarnation,
    pub(crate) registry: Registry,
    pub(crate) journal: Arc<MemoryJournal>,
    clock: Arc<SimClock>,
    spawn: Spawn,
    flaw: Option<Flaw>,
    /// How far its own clock is off.
    off: SignedDuration,
    /// All servers, as they were seen last.
    members: Mutex<Vec<Member>>,
    answers_until: Mutex<Timestamp>,
    /// Who plays at a place, as it was found; nobody where all is over.
    owners: Mutex<BTreeMap<Place, Option<Incarnation>>>,
    places: Mutex<BTreeMap<EpisodeId, Place>>,
    accepts: AtomicBool,
}

/// Another server, as it was seen.
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

    /// Accepts no more requests, and takes no more work.
    pub(crate) fn shut(&self) {
        self.accepts.store(false, Ordering::Relaxed);
    }

    pub(crate) fn is_shut(&self) -> bool {
        !self.accepts.load(Ordering::Relaxed)
    }

    /// Whether this server was seen lately enough to answer.
    pub(crate) fn may_answer(&self) -> bool {
        self.clock.now() < *self.answers_until.lock().expect("one thread")
    }

    /// Whether it thinks so.
    fn answers(&self) -> bool {
        self.flaw == Some(Flaw::AnswersForever) || self.may_answer()
    }

    pub(crate) fn answers_from(&self, sent: Timestamp) {
        *self.answers_until.lock().expect("one thread") =
            after(sent, swarmbench::store::ANSWERS_FOR);
    }

    /// By what this server judges who was seen when: the clock of the database.
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

    /// Which server takes a place that nobody has, the same for all who see the same servers.
    fn preferred(&self, place: Place) -> Incarnation {
        let (_, key) = place.numbers();
        let ready = self.members().into_iter().filter(|member| member.is_ready);
        let weight = |incarnation: &Incarnation| {
            Dice(key.cast_unsigned() ^ incarnation.cast_unsigned().rotate_left(32)).below(1 << 20)
        };
        ready.map(|member| member.incarnation).max_by_key(weight).unwrap_or(self.incarnation)
    }
}
