//! Timer of an actor: every act changes it, and it hardly ever expires.

use jiff::Timestamp;

use futures::future::BoxFuture;
use swarmbench_clock::Clock;

/// Timer that expires at the moment for which it was set, or at an earlier moment for which it was set before. So it costs nothing
/// that every act sets it to a later moment.
#[derive(Default)]
pub(super) struct Timer(Option<(Timestamp, BoxFuture<'static, ()>)>);

impl Timer {
    /// Sets the timer; `None` leaves it as it is.
    pub(super) fn set(&mut self, at: Option<Timestamp>, clock: &dyn Clock) {
        let Some(at) = at else { return };
        if self.0.as_ref().is_none_or(|(earlier, _)| at < *earlier) {
            self.0 = Some((at, clock.sleep_until(at)));
        }
    }

    /// Completes when the timer expires, and unsets it.
    pub(super) async fn expired(&mut self) {
        match &mut self.0 {
            Some((_, sleep)) => sleep.await,
            None => std::future::pending().await,
        }
        self.0 = None;
    }
}
