//! The time of a run, which moves only by steps.

use std::collections::BTreeSet;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_clock::{Clock, after, until};
use swarmbench_testkit::host::ManualClock;

use crate::simulation::broken::Flaw;

/// A manual clock that knows the moments that tasks wait for.
pub(crate) struct SimClock {
    time: ManualClock,
    awaited: Mutex<BTreeSet<Timestamp>>,
}

impl SimClock {
    pub(crate) fn new(start: Timestamp) -> Self {
        Self { time: ManualClock::new(start), awaited: Mutex::default() }
    }

    /// Advances the time.
    pub(crate) fn advance(&self, by: Duration) {
        self.time.advance(by);
        let now = self.now();
        self.awaited.lock().expect("one thread").retain(|&at| at > now);
    }

    /// The future moments that tasks wait for, or waited for.
    pub(crate) fn awaited(&self) -> Vec<Duration> {
        let now = self.now();
        self.awaited.lock().expect("one thread").iter().map(|&at| until(now, at)).collect()
    }
}

impl Clock for SimClock {
    fn now(&self) -> Timestamp {
        self.time.now()
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        if at > self.now() {
            self.awaited.lock().expect("one thread").insert(at);
        }
        self.time.sleep_until(at)
    }
}

/// The server's clock, with the run's flaw.
pub(crate) struct ServerClock {
    pub(crate) time: Arc<SimClock>,
    pub(crate) flaw: Option<Flaw>,
    pub(crate) asked: AtomicU64,
}

impl Clock for ServerClock {
    fn now(&self) -> Timestamp {
        let asked = self.asked.fetch_add(1, Ordering::Relaxed);
        let (now, wrong) = (self.time.now(), Duration::from_secs(20));
        match self.flaw {
            Some(Flaw::ClockAhead) if asked % 5 == 4 => after(now, wrong),
            Some(Flaw::ClockBehind) if asked % 3 == 2 => now.saturating_sub(wrong).unwrap_or(now),
            _ => now,
        }
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        if self.flaw == Some(Flaw::NeverWakes) {
            return Box::pin(std::future::pending());
        }
        self.time.sleep_until(at)
    }
}
