//! Addresses of servers for clients: of the one that runs now, or of any of several.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use swarmbench_testkit::dice::Dice;
use swarmbench_testkit::program::{Address, Door, PATIENCE};

/// Pause between two looks for a listening server.
const PAUSE: Duration = Duration::from_millis(5);

pub(crate) enum Servers {
    One(Arc<Door>),
    Any(Arc<Doors>),
}

impl Servers {
    /// The only server.
    pub(crate) fn one(&self) -> &Door {
        match self {
            Self::One(door) => door,
            Self::Any(_) => panic!("there are several"),
        }
    }

    /// The run that is asked next: of a cluster, how many faults are behind them.
    pub(crate) async fn run_after(&self, tried: Tried) -> u64 {
        match self {
            Self::One(door) => door.after(tried.run).await.run,
            Self::Any(doors) => doors.epoch(),
        }
    }
}

/// Servers that were asked in vain.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tried {
    /// The next run to be asked is one after this.
    pub(crate) run: u64,
    /// The next a server of a cluster is asked next.
    pub(crate) server: Option<usize>,
}

/// Several servers, any of which takes any request.
pub(crate) struct Doors {
    seed: u64,
    servers: Vec<Arc<Door>>,
    /// Servers whose connections may break, as they were stopped for a while.
    excused: Vec<AtomicBool>,
    /// Counts faults, from 1: after each of them all clients look whether everything is in order.
    epoch: AtomicU64,
    picks: AtomicU64,
}

impl Doors {
    pub(crate) fn new(seed: u64, doors: Vec<Arc<Door>>) -> Arc<Self> {
        let excused = doors.iter().map(|_| AtomicBool::new(false)).collect();
        Arc::new(Self {
            seed,
            servers: doors,
            excused,
            epoch: AtomicU64::new(1),
            picks: AtomicU64::new(0),
        })
    }

    pub(crate) fn epoch(&self) -> u64 {
        self.epoch.load(Ordering::SeqCst)
    }

    /// A fault is over; returns the new epoch.
    pub(crate) fn next_epoch(&self) -> u64 {
        self.epoch.fetch_add(1, Ordering::SeqCst) + 1
    }

    /// From now on connections of a server may break, or not.
    pub(crate) fn excuse(&self, server: usize, is_excused: bool) {
        self.excused[server].store(is_excused, Ordering::SeqCst);
    }

    /// True if a run of a server may leave a request without an answer.
    pub(crate) fn may_break(&self, server: usize, run: u64) -> bool {
        self.servers[server].has_ended(run) || self.excused[server].load(Ordering::SeqCst)
    }

    /// Any server that listens. After a failed attempt it is the next one in order, as with a load balancer (round robin).
    pub(crate) async fn any(&self, tried: Tried) -> (usize, Address) {
        let began = Instant::now();
        let drawn = || {
            let pick = self.picks.fetch_add(1, Ordering::SeqCst);
            Dice::of(self.seed, &format!("pick {pick}")).below(self.servers.len())
        };
        let first = tried.server.map_or_else(drawn, |tried| tried + 1);
        loop {
            let mut order = (0..self.servers.len()).map(|next| (first + next) % self.servers.len());
            let open = order.find_map(|server| Some((server, self.servers[server].now()?)));
            if let Some(found) = open {
                return found;
            }
            assert!(began.elapsed() < PATIENCE, "none of the servers listens");
            tokio::time::sleep(PAUSE).await;
        }
    }
}
