//! Rate limits: requests per second, and entries in competitions per hour.

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
use ipnet::IpNet;

use super::client::{NETWORKS_PER_SITE_MAX, networks};
use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::keys::OwnerKey;
use swarmbench_clock::Clock;

/// Approximate maximum of senders remembered for one rate between two sweeps.
const SENDERS_REMEMBERED: usize = 65_536;

/// Checks between two counts of the remembered senders.
const SENDERS_COUNTED_EVERY: usize = 4096;

/// Time for rate limits: monotonic, and continues while the process is stopped.
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

/// One rate limit, and how much of it each sender has used.
struct Rate<K: Hash + Eq + Clone> {
    name: &'static str,
    most: usize,
    clock: RateClock,
    /// None for no limit.
    limiter: Option<Limiter<K>>,
    checks: AtomicUsize,
}

impl<K: Hash + Eq + Clone> Rate<K> {
    fn new(name: &'static str, most: usize, quota: Option<Quota>, clock: &RateClock) -> Self {
        let limiter =
            quota.map(|quota| RateLimiter::new(quota, DashMapStateStore::default(), clock.clone()));
        Self { name, most, clock: clock.clone(), limiter, checks: AtomicUsize::new(0) }
    }

    /// Takes cells of a sender's rate, or refuses the request.
    fn check(
        &self,
        sender: &K,
        cells: NonZeroU32,
        detail: impl FnOnce(usize) -> String,
    ) -> Result<(), ApiError> {
        let Some(limiter) = &self.limiter else { return Ok(()) };
        let is_due =
            self.checks.fetch_add(1, Ordering::Relaxed).is_multiple_of(SENDERS_COUNTED_EVERY);
        if is_due && limiter.len() > SENDERS_REMEMBERED {
            self.forget_idle();
        }
        let Ok(Err(until)) = limiter.check_key_n(sender, cells) else { return Ok(()) };
        let wait = until.wait_time_from(self.clock.now());
        metrics::counter!("swarmbench_rate_limited_total", "limit" => self.name).increment(1);
        Err(ApiError::limit(Code::RateLimited, self.name, self.most, detail(self.most))
            .retry_after(wait))
    }

    /// Forgets idle senders.
    fn forget_idle(&self) {
        if let Some(limiter) = &self.limiter {
            limiter.retain_recent();
            limiter.shrink_to_fit();
        }
    }
}

impl Rate<IpNet> {
    /// Counts one event of an address in each of its networks. An event costs fewer cells in a site, which may have as many as
    /// [`NETWORKS_PER_SITE_MAX`] addresses. Events from this machine are not limited.
    fn check_networks(
        &self,
        address: IpAddr,
        detail: impl Fn(usize) -> String,
    ) -> Result<(), ApiError> {
        if address.is_loopback() {
            return Ok(());
        }
        networks(address).try_for_each(|(network, times)| {
            let cells = NonZeroU32::new(NETWORKS_PER_SITE_MAX / times).unwrap_or(NonZeroU32::MIN);
            self.check(&network, cells, &detail)
        })
    }
}

pub(super) struct Rates {
    by_address: Rate<IpNet>,
    by_key: Rate<OwnerKey>,
    entries: Rate<IpNet>,
}

impl Rates {
    pub(super) fn new(limits: &Limits, clock: Arc<dyn Clock>) -> Self {
        let clock = &RateClock(clock);
        // Bursts may have twice the rate of a second.
        let per_s = |most| {
            let most = NonZeroU32::new(most)?;
            Some(Quota::per_second(most).allow_burst(most.saturating_add(most.get())))
        };
        let of_networks = |most: u32| most.saturating_mul(NETWORKS_PER_SITE_MAX);
        let address = limits.address_requests_per_s_max;
        let address_quota = per_s(of_networks(address));
        let key = limits.key_requests_per_s_max;
        let entries = limits.entries_per_address_h_max;
        let entries_quota = NonZeroU32::new(of_networks(entries)).map(Quota::per_hour);
        Self {
            by_address: Rate::new(
                "address_requests_per_s_max",
                address as usize,
                address_quota,
                clock,
            ),
            by_key: Rate::new("key_requests_per_s_max", key as usize, per_s(key), clock),
            entries: Rate::new("entries_per_address_h_max", entries as usize, entries_quota, clock),
        }
    }

    /// Counts a request of an address. Requests from this machine are not limited.
    pub(super) fn check_address(&self, address: IpAddr) -> Result<(), ApiError> {
        self.by_address.check_networks(address, |most| {
            format!("more than {most} requests a second came from this address; try again later")
        })
    }

    /// Counts a request with a key, or with a token of one of the key's episodes.
    pub(super) fn check_key(&self, key: OwnerKey) -> Result<(), ApiError> {
        self.by_key.check(&key, NonZeroU32::MIN, |most| {
            format!("more than {most} requests a second came from this key; try again later")
        })
    }

    /// Counts an entry in a competition from an address. Entries from this machine are not limited.
    pub(super) fn check_entry(&self, address: IpAddr) -> Result<(), ApiError> {
        self.entries.check_networks(address, |most| {
            format!(
                "{most} entries an hour came from this address, the maximum; try again later, or ask the organizer for a code"
            )
        })
    }

    /// Forgets idle senders.
    pub(super) fn forget_idle(&self) {
        self.by_address.forget_idle();
        self.by_key.forget_idle();
        self.entries.forget_idle();
    }
}
