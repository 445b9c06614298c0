//! The host's time and randomness, moved by hand.

use std::pin::Pin;
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use sha2::{Digest, Sha256};
use swarmbench_clock::{Agreement, Clock, Doubt, Entropy, after};
use tokio::sync::watch;

/// A clock that moves only on command, for tests.
#[derive(Debug)]
pub struct ManualClock {
    now: watch::Sender<Timestamp>,
    /// The simulated host.
    host: Mutex<ManualHost>,
}

#[derive(Debug)]
struct ManualHost {
    /// Lead of its time of day over the steady clock.
    ahead: SignedDuration,
    /// Total time for which the process was stopped.
    lost: Duration,
    agreement: Agreement,
}

impl ManualClock {
    /// A clock at `start`, to the millisecond.
    pub fn new(start: Timestamp) -> Self {
        let start = Timestamp::from_millisecond(start.as_millisecond()).expect("a time of a test");
        let agreement = Agreement::new(start);
        let host = ManualHost { ahead: SignedDuration::ZERO, lost: Duration::ZERO, agreement };
        Self { now: watch::Sender::new(start), host: Mutex::new(host) }
    }

    /// Moves the clock forward and wakes the tasks whose sleep ends.
    pub fn advance(&self, by: Duration) {
        self.now.send_modify(|now| *now = after(*now, by));
    }

    /// Sets the host's time of day forward by `by`, or back if it is negative.
    pub fn step(&self, by: SignedDuration) {
        self.manual().ahead += by;
    }

    /// Simulates a stop of the process for `by`.
    pub fn stop(&self, by: Duration) {
        self.manual().lost += by;
    }

    fn manual(&self) -> MutexGuard<'_, ManualHost> {
        self.host.lock().expect("nothing panics while it holds this")
    }

    fn ahead(&self) -> SignedDuration {
        let host = self.manual();
        SignedDuration::try_from(host.lost).expect("a time of a test") + host.agreement.ahead()
    }
}

impl Clock for ManualClock {
    fn now(&self) -> Timestamp {
        *self.now.borrow()
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        let mut now = self.now.subscribe();
        Box::pin(async move {
            // A dropped clock never reaches `at`.
            if now.wait_for(|now| *now >= at).await.is_err() {
                std::future::pending::<()>().await;
            }
        })
    }

    fn to_wall(&self, running: Timestamp) -> Timestamp {
        moved(running, self.ahead())
    }

    fn running_at(&self, wall: Timestamp) -> Timestamp {
        moved(wall, -self.ahead())
    }

    fn steady(&self) -> Timestamp {
        after(self.now(), self.lost())
    }

    fn lost(&self) -> Duration {
        self.manual().lost
    }

    fn doubt(&self) -> Option<Doubt> {
        let (steady, host) = (self.steady(), self.host());
        self.manual().agreement.compare(steady, host)
    }

    fn host(&self) -> Timestamp {
        let steady = self.steady();
        moved(steady, self.manual().ahead)
    }

    fn confirm(&self) {
        let (steady, host) = (self.steady(), self.host());
        self.manual().agreement.confirm(steady, host);
    }

    fn not_before(&self, newest: Timestamp) {
        self.manual().agreement.not_before(newest);
    }
}

/// Random bytes derived from a seed, so that tests can be repeated.
#[derive(Debug)]
pub struct SeededEntropy(Mutex<u64>);

impl SeededEntropy {
    /// The sequence derived from `seed`.
    pub const fn new(seed: u64) -> Self {
        Self(Mutex::new(seed))
    }
}

impl Entropy for SeededEntropy {
    fn fill(&self, bytes: &mut [u8]) {
        let mut counter = self.0.lock().expect("nothing panics while it holds this");
        for chunk in bytes.chunks_mut(32) {
            *counter = counter.wrapping_add(1);
            let block = Sha256::digest(counter.to_le_bytes());
            chunk.copy_from_slice(&block[..chunk.len()]);
        }
    }
}

/// A moment moved by a duration that may be negative.
fn moved(at: Timestamp, by: SignedDuration) -> Timestamp {
    at.saturating_add(by).unwrap_or(at)
}
