//! Time that passes when somebody pauses, or when the test says so.

use std::pin::Pin;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_clock::{Clock, until};
use swarmbench_testkit::host::ManualClock;
use tokio::sync::watch;
use tokio::time::timeout;

use crate::llm::endpoint::PATIENCE;

/// The timeout of a request.
pub(crate) const TIME_OUT: Duration = Duration::from_secs(10_000);

/// From here on a wait is that for an answer and no pause: it passes only by [`Leaps::pass`].
const WAIT: Duration = Duration::from_secs(1_000);

/// A clock that notes all pauses. It leaps over them, or else stands until [`Leaps::pass`].
#[derive(Debug)]
pub(crate) struct Leaps {
    clock: ManualClock,
    pauses: watch::Sender<Vec<Duration>>,
    waits: watch::Sender<usize>,
    stands: bool,
}

impl Leaps {
    /// A clock on which every pause is over at once.
    pub(crate) fn leaping() -> Self {
        let start = "2026-03-01T12:00:00Z".parse().expect("a time");
        Self {
            clock: ManualClock::new(start),
            pauses: watch::Sender::default(),
            waits: watch::Sender::default(),
            stands: false,
        }
    }

    /// A clock that stands.
    pub(crate) fn standing() -> Self {
        Self { stands: true, ..Self::leaping() }
    }

    /// All pauses that were asked for.
    pub(crate) fn pauses(&self) -> Vec<Duration> {
        self.pauses.borrow().clone()
    }

    /// Waits for a number of pauses.
    pub(crate) async fn has_seen(&self, pauses: usize) {
        let mut seen = self.pauses.subscribe();
        let all = timeout(PATIENCE, seen.wait_for(|seen| seen.len() >= pauses)).await;
        all.expect("they come").expect("it is there");
    }

    /// Waits for a number of waits for an answer: for all of it, and for each further piece of a stream.
    pub(crate) async fn has_waited(&self, waits: usize) {
        let mut seen = self.waits.subscribe();
        let all = timeout(PATIENCE, seen.wait_for(|seen| *seen >= waits)).await;
        all.expect("they come").expect("it is there");
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
        if pause >= WAIT {
            self.waits.send_modify(|waits| *waits += 1);
        } else {
            self.pauses.send_modify(|pauses| pauses.push(pause));
            if !self.stands {
                self.clock.advance(pause);
            }
        }
        self.clock.sleep_until(at)
    }
}
