//! The host's time and randomness, as arguments, and its [`files`].
//!
//! The crate is separate because the server and its clients both use it, and neither depends on the other.
//!
//! A server has two times (ADR 8). The *running time* is for durations: rounds, waits, timeouts. It is never set, and
//! stops while the process is stopped. The *time of day* is for records and for announced moments; while it is in
//! [`Doubt`] it triggers nothing irreversible. Both start at the same moment, so a running time is also a timestamp:
//! [`Clock::to_wall`] and [`Clock::running_at`] convert between the two.

mod agreement;
pub mod files;
mod running;

use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};

pub use agreement::{Agreement, Doubt};
use agreement::{moved, signed};
pub use running::BEAT;
use running::Running;

/// A source of time.
pub trait Clock: Send + Sync + 'static {
    /// The running time, to the millisecond.
    fn now(&self) -> Timestamp;

    /// Completes once [`Clock::now`] has reached `at`.
    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>>;

    /// The time of day, to the millisecond.
    fn wall(&self) -> Timestamp {
        self.to_wall(self.now())
    }

    /// The time of day at a moment of the running time.
    fn to_wall(&self, running: Timestamp) -> Timestamp {
        running
    }

    /// The running time at a moment of the time of day, as if the process always ran.
    fn running_at(&self, wall: Timestamp) -> Timestamp {
        wall
    }

    /// A monotonic time that also runs while the process is stopped.
    fn steady(&self) -> Timestamp {
        self.now()
    }

    /// Total time for which the process was stopped so far.
    fn lost(&self) -> Duration {
        Duration::ZERO
    }

    /// The reason why the time of day is in doubt now, if it is.
    fn doubt(&self) -> Option<Doubt> {
        None
    }

    /// The time of day by the host's own clock, even if it is in doubt.
    fn host(&self) -> Timestamp {
        self.wall()
    }

    /// Accepts the host's time of day, which ends a doubt.
    fn confirm(&self) {}

    /// Reports the time of the database's newest entry: an earlier time of day is in doubt.
    fn not_before(&self, _newest: Timestamp) {}
}

/// The unmodified host's clock, for clients.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    #[expect(clippy::disallowed_methods, reason = "the one place that reads the host's clock")]
    fn now(&self) -> Timestamp {
        to_millisecond(Timestamp::now())
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        // The time is truncated to milliseconds, so the sleeper waits for the end of the last one.
        let wait = until(self.now(), at) + Duration::from_millis(1);
        Box::pin(tokio::time::sleep(wait))
    }
}

/// The clock of a server, which has to be read at least every [`BEAT`]. Clones share it.
#[derive(Clone, Debug)]
pub struct ServerClock(Arc<Started>);

#[derive(Debug)]
struct Started {
    at: Timestamp,
    since: Instant,
    times: Mutex<Times>,
}

/// The running time and the time of day.
#[derive(Debug)]
struct Times {
    running: Running,
    agreement: Agreement,
}

impl Times {
    /// Lead of the time of day over the running time.
    fn ahead(&self) -> SignedDuration {
        signed(self.running.lost()) + self.agreement.ahead()
    }
}

impl Default for ServerClock {
    fn default() -> Self {
        let at = SystemClock.now();
        let times = Times { running: Running::default(), agreement: Agreement::new(at) };
        Self(Arc::new(Started { at, since: Instant::now(), times: Mutex::new(times) }))
    }
}

impl ServerClock {
    fn times(&self) -> MutexGuard<'_, Times> {
        self.0.times.lock().expect("nothing panics while it holds this")
    }
}

impl Clock for ServerClock {
    fn now(&self) -> Timestamp {
        let running = self.times().running.at(self.0.since.elapsed());
        to_millisecond(after(self.0.at, running))
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        let clock = self.clone();
        Box::pin(async move {
            // The running time may not have reached `at` yet if the process was stopped meanwhile.
            loop {
                let wait = until(clock.now(), at);
                if wait.is_zero() {
                    return;
                }
                tokio::time::sleep(wait + Duration::from_millis(1)).await;
            }
        })
    }

    fn wall(&self) -> Timestamp {
        to_millisecond(moved(self.steady(), self.times().agreement.ahead()))
    }

    fn to_wall(&self, running: Timestamp) -> Timestamp {
        to_millisecond(moved(running, self.times().ahead()))
    }

    fn running_at(&self, wall: Timestamp) -> Timestamp {
        to_millisecond(moved(wall, -self.times().ahead()))
    }

    fn steady(&self) -> Timestamp {
        to_millisecond(after(self.0.at, self.0.since.elapsed()))
    }

    fn lost(&self) -> Duration {
        self.times().running.lost()
    }

    fn doubt(&self) -> Option<Doubt> {
        let mut times = self.times();
        times.agreement.compare(self.steady(), self.host())
    }

    fn host(&self) -> Timestamp {
        SystemClock.now()
    }

    fn confirm(&self) {
        self.times().agreement.confirm(self.steady(), self.host());
    }

    fn not_before(&self, newest: Timestamp) {
        self.times().agreement.not_before(newest);
    }
}

/// The moment `by` after `at`, or the last representable one.
#[must_use]
pub fn after(at: Timestamp, by: Duration) -> Timestamp {
    at.saturating_add(by).unwrap_or(Timestamp::MAX)
}

/// The duration from `now` until `at`; zero if it has passed.
#[must_use]
pub fn until(now: Timestamp, at: Timestamp) -> Duration {
    Duration::try_from(at.duration_since(now)).unwrap_or_default()
}

/// A duration in whole milliseconds.
#[must_use]
pub fn millis(duration: Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

fn to_millisecond(at: Timestamp) -> Timestamp {
    Timestamp::from_millisecond(at.as_millisecond()).unwrap_or(at)
}

/// A source of random bytes, for ids, tokens and drawn seeds.
pub trait Entropy: Send + Sync + 'static {
    /// Fills `bytes` with unpredictable bytes.
    fn fill(&self, bytes: &mut [u8]);
}

/// The host's source of secure random bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemEntropy;

impl Entropy for SystemEntropy {
    #[expect(
        clippy::disallowed_methods,
        reason = "the one place that asks the host for randomness"
    )]
    fn fill(&self, bytes: &mut [u8]) {
        getrandom::fill(bytes).expect("the host gives random bytes");
    }
}
