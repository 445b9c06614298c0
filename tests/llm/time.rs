//! Time that passes when somebody pauses.

use std::pin::Pin;
use std::sync::Mutex;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench::clock::{Clock, ManualClock, until};

/// From here on a wait is a time-out, which passes only by [`Leaps::pass`].
pub(crate) const TIME_OUT: Duration = Duration::from_secs(10_000);

/// A clock on which every pause is over at once and is noted; time-outs, which are longer than any pause, wait for the
/// test.
#[derive(Debug)]
pub(crate) struct Leaps {
    clock: ManualClock,
    pauses: Mutex<Vec<Duration>>,
}

impl Default for Leaps {
    fn default() -> Self {
        let start = "2026-03-01T12:00:00Z".parse().expect("a time");
        Self { clock: ManualClock::new(start), pauses: Mutex::default() }
    }
}

impl Leaps {
    /// All pauses that were asked for.
    pub(crate) fn pauses(&self) -> Vec<Duration> {
        self.pauses.lock().expect("a lock").clone()
    }

    /// Lets time pass.
    pub(crate) fn pass(&self, by: Duration) {
        self.clock.advance(by);
    }
}

impl Clock for Leaps {
    fn now(&self) -> Timestamp {
        self.clock.now()
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        let pause = until(self.now(), at);
        if pause < TIME_OUT {
            self.pauses.lock().expect("a lock").push(pause);
            self.clock.advance(pause);
        }
        self.clock.sleep_until(at)
    }
}
