//! How much may come in a second or an hour: requests, and entries in competitions.

use std::hash::Hash;
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use governor::clock::Clock as _;
use governor::middleware::NoOpMiddleware;
use governor::nanos::Nanos;
use governor::state::keyed::DashMapStateStore;
use governor::{Quota, RateLimiter};

use super::client::network;
use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::keys::OwnerKey;
use swarmbench_clock::Clock;

/// Senders that are remembered for one rate between two sweeps, about.
const SENDERS_REMEMBERED: usize = 65_536;

/// After this number of checks the remembered senders are counted.
const SENDERS_COUNTED_EVERY: usize = 4096;

/// Time for rate limits: monotonic, and runs also while the process is stopped.
#[derive(Clone)]
struct RateClock(Arc<dyn Clock>);

impl governor::clock::Clock for RateClock {
    type Instant = Nanos;

    fn now(&self) -> Nanos {
        let millis = u64::try_from(self.0.steady().as_millisecond()).unwrap_or(0);
        Nanos::from(Duration::from_millis(millis))
    }
}

type Limiter<K> = RateLimiter<K, DashMapStateStore<K>, RateClock, NoOpMiddleware<Nanos>>;

/// The limit of one rate, and how much of it each sender has used.
struct Rate<K: Hash + Eq + Clone> {
    name: &'static str,
    most: usize,
    clock: RateClock,
    /// None if there is no limit.
    limiter: Option<Limiter<K>>,
    checks: AtomicUsize,
}

impl<K: Hash + Eq + Clone> Rate<K> {
    fn new(name: &'static str, most: usize, quota: Option<Quota>, clock: &RateClock) -> Self {
        let limiter =
            quota.map(|quota| RateLimiter::new(quota, DashMapStateStore::default(), clock.clone()));
        Self { name, most, clock: clock.clone(), limiter, checks: AtomicUsize::new(0) }
    }

    /// Counts what a sender sent, or refuses it.
    fn check(&self, sender: &K, detail: impl FnOnce(usize) -> String) -> Result<(), ApiError> {
        let Some(limiter) = &self.limiter else { return Ok(()) };
        let is_due =
            self.checks.fetch_add(1, Ordering::Relaxed).is_multiple_of(SENDERS_COUNTED_EVERY);
        if is_due && limiter.len() > SENDERS_REMEMBERED {
            self.forget_idle();
        }
        let Err(until) = limiter.check_key(sender) else { return Ok(()) };
        let wait = until.wait_time_from(self.clock.now());
        metrics::counter!("swarmbench_rate_limited_total", "limit" => self.name).increment(1);
        Err(ApiError::limit(Code::RateLimited, self.name, self.most, detail(self.most))
            .retry_after(wait))
    }

    /// Forgets senders of which nothing came lately.
    fn forget_idle(&self) {
        if let Some(limiter) = &self.limiter {
            limiter.retain_recent();
            limiter.shrink_to_fit();
        }
    }
}

pub(super) struct Rates {
    by_address: Rate<IpAddr>,
    by_key: Rate<OwnerKey>,
    entries: Rate<IpAddr>,
}

impl Rates {
    pub(super) fn new(limits: &Limits, clock: Arc<dyn Clock>) -> Self {
        let clock = &RateClock(clock);
        // Twice as many at once.
        let per_s = |most| {
            let most = NonZeroU32::new(most)?;
            Some(Quota::per_second(most).allow_burst(most.saturating_add(most.get())))
        };
        let requests = |most: u32| (most as usize, per_s(most));
        let (address, address_quota) = requests(limits.address_requests_per_s_max);
        let (key, key_quota) = requests(limits.key_requests_per_s_max);
        let entries = limits.entries_per_address_h_max;
        let entries_quota = NonZeroU32::new(entries).map(Quota::per_hour);
        Self {
            by_address: Rate::new("address_requests_per_s_max", address, address_quota, clock),
            by_key: Rate::new("key_requests_per_s_max", key, key_quota, clock),
            entries: Rate::new("entries_per_address_h_max", entries as usize, entries_quota, clock),
        }
    }

    /// Counts a request of an address. Those of this machine itself are not limited.
    pub(super) fn check_address(&self, address: IpAddr) -> Result<(), ApiError> {
        if address.is_loopback() {
            return Ok(());
        }
        self.by_address.check(&network(address), |most| {
            format!("more than {most} requests a second came from this address; try again later")
        })
    }

    /// Counts a request that was made with a key, or with a token of an episode of it.
    pub(super) fn check_key(&self, key: OwnerKey) -> Result<(), ApiError> {
        self.by_key.check(&key, |most| {
            format!("more than {most} requests a second came from this key; try again later")
        })
    }

    /// Counts an entry in a competition from an address. Those of this machine itself are not limited.
    pub(super) fn check_entry(&self, address: IpAddr) -> Result<(), ApiError> {
        if address.is_loopback() {
            return Ok(());
        }
        self.entries.check(&network(address), |most| {
            format!(
                "{most} entries an hour came from this address, the maximum; try again later, or ask the organizer for a code"
            )
        })
    }

    /// Forgets senders of which nothing came lately.
    pub(super) fn forget_idle(&self) {
        self.by_address.forget_idle();
        self.by_key.forget_idle();
        self.entries.forget_idle();
    }
}
