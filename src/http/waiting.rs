//! Long polls: requests that wait for an event, their timeout or the stop of the server.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use tokio_util::sync::CancellationToken;

use super::error::{ApiError, Code};
use crate::episode::Snapshot;
use crate::episode::actor::Handle;
use swarmbench_clock::{Clock, after};

/// Limit of waiting requests.
pub(super) struct Waits {
    count: Arc<AtomicUsize>,
    most: usize,
    clock: Arc<dyn Clock>,
    /// Cancelled when the server stops.
    stop: CancellationToken,
}

/// Keeps a waiting request counted until dropped.
pub(super) struct Waiting(Arc<AtomicUsize>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
        metrics::gauge!("swarmbench_waits").decrement(1.0);
    }
}

impl Waits {
    pub(super) fn new(most: usize, clock: Arc<dyn Clock>, stop: CancellationToken) -> Self {
        Self { count: Arc::default(), most, clock, stop }
    }

    pub(super) fn start(&self) -> Result<Waiting, ApiError> {
        let most = self.most;
        let waiting = Waiting(Arc::clone(&self.count));
        metrics::gauge!("swarmbench_waits").increment(1.0);
        if self.count.fetch_add(1, Ordering::Relaxed) >= most {
            let detail =
                format!("{most} requests wait already; ask without `wait`, or try again later");
            return Err(ApiError::limit(Code::Overloaded, "waits_max", most, detail)
                .retry_after(Duration::from_secs(1)));
        }
        Ok(waiting)
    }

    /// The first published state that is `wanted`, or the current one at the timeout.
    pub(super) async fn until(
        &self,
        handle: &Handle,
        wait: Duration,
        wanted: impl Fn(&Snapshot) -> bool,
    ) -> Result<Arc<Snapshot>, ApiError> {
        let now = handle.snapshot();
        if wait.is_zero() || wanted(&now) {
            return Ok(now);
        }
        let mut published = handle.follow();
        let found = async {
            let snapshot = published.wait_for(|snapshot| wanted(snapshot)).await;
            snapshot.ok().map(|snapshot| Arc::clone(&snapshot))
        };
        let seen = self.hold(wait, found).await?.flatten();
        Ok(seen.unwrap_or_else(|| handle.snapshot()))
    }

    /// Waits for `done`; `None` at the timeout or when the server stops.
    pub(super) async fn hold<T>(
        &self,
        wait: Duration,
        done: impl Future<Output = T>,
    ) -> Result<Option<T>, ApiError> {
        let _waiting = self.start()?;
        let up = self.clock.sleep_until(after(self.clock.now(), wait));
        tokio::select! {
            value = done => Ok(Some(value)),
            () = up => Ok(None),
            () = self.stop.cancelled() => Ok(None),
        }
    }
}
