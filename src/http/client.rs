//! The client of a connection: its address, its rate limits and its requests in flight.
//!
//! An address counts against the rate limit; whether a request comes from a program on this machine
//! decides what a server without keys lets it do.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, Version, header};
use axum::middleware::Next;
use axum::response::Response;
use governor::clock::Clock as _;
use governor::middleware::NoOpMiddleware;
use governor::nanos::Nanos;
use governor::state::keyed::DashMapStateStore;
use governor::{Quota, RateLimiter};
use hyper::body::Body as _;
use ipnet::IpNet;

use super::App;
use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::clock::Clock;
use crate::fair::{Group, Origin, Party, Rank};
use crate::keys::OwnerKey;
use swarmbench_protocol::loopback::is_loopback;

/// The address of the client, in the extensions of every request. Behind a proxy it is the proxy's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Peer(pub(super) IpAddr);

/// The sender of a request, as far as the connection shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Client {
    /// The address, that which a trusted proxy names where there is one.
    pub(super) address: IpAddr,
    /// Whether it is a program on this machine: not a proxy that forwards others, and no page of
    /// another site in a browser.
    pub(super) is_local: bool,
}

impl Client {
    /// For whom something is done as long as nobody showed a key or a token.
    pub(super) fn party(self) -> Party {
        Party::of(Group::Address(network(self.address)))
    }
}

/// Addresses that are remembered for their rates between two sweeps, about.
const ADDRESSES_REMEMBERED: usize = 65_536;

/// After so many requests of addresses it is looked how many are remembered.
const ADDRESSES_COUNTED_EVERY: usize = 4096;

/// The unit in which rates of large bodies are counted, in bytes.
const BODY_CELL_BYTES: usize = 1024;

/// The headers by which proxies say that they are some.
const FORWARDED: [HeaderName; 5] = [
    HeaderName::from_static("forwarded"),
    HeaderName::from_static("x-forwarded-for"),
    HeaderName::from_static("x-forwarded-host"),
    HeaderName::from_static("x-real-ip"),
    HeaderName::from_static("via"),
];

impl Client {
    /// Reads the client off a connection and its headers.
    fn of(peer: IpAddr, headers: &HeaderMap, uri: &Uri, trusted: &[IpNet]) -> Self {
        let address = address(peer, headers, trusted);
        let is_forwarded = FORWARDED.iter().any(|name| headers.contains_key(name));
        let is_local = address.is_loopback()
            && !is_forwarded
            && names_loopback(host(headers, uri))
            && headers.get(header::ORIGIN).is_none_or(|origin| {
                names_loopback(origin.to_str().ok().and_then(|origin| origin.split("://").nth(1)))
            });
        Self { address, is_local }
    }
}

/// The address of the client, that which a trusted proxy names where there is one.
pub(super) fn address(peer: IpAddr, headers: &HeaderMap, trusted: &[IpNet]) -> IpAddr {
    let peer = peer.to_canonical();
    let is_trusted = |address: &IpAddr| trusted.iter().any(|net| net.contains(address));
    let address = if is_trusted(&peer) { forwarded(headers, is_trusted) } else { None };
    address.unwrap_or(peer)
}

/// The nearest address in `X-Forwarded-For` that is not a trusted proxy's: all that comes before
/// it may have been made up.
fn forwarded(headers: &HeaderMap, is_trusted: impl Fn(&IpAddr) -> bool) -> Option<IpAddr> {
    let lines = headers.get_all("x-forwarded-for").iter().rev();
    let entries = lines.flat_map(|line| line.to_str().unwrap_or("?").rsplit(','));
    let mut nearest = None;
    for entry in entries {
        let Ok(address) = entry.trim().parse::<IpAddr>() else { break };
        let address = address.to_canonical();
        nearest = Some(address);
        if !is_trusted(&address) {
            break;
        }
    }
    nearest
}

/// The host that the request asks for, with its port.
fn host<'a>(headers: &'a HeaderMap, uri: &'a Uri) -> Option<&'a str> {
    match uri.authority() {
        Some(authority) => Some(authority.as_str()),
        None => headers.get(header::HOST).and_then(|host| host.to_str().ok()),
    }
}

/// Whether `host` or `host:port` names this machine for itself.
fn names_loopback(host: Option<&str>) -> bool {
    let Some(host) = host else { return false };
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !host.ends_with(']') => (name, Some(port)),
        _ => (host, None),
    };
    if port.is_some_and(|port| port.parse::<u16>().is_err()) {
        return false;
    }
    is_loopback(name)
}

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

type Keyed<K> = RateLimiter<K, DashMapStateStore<K>, RateClock, NoOpMiddleware<Nanos>>;

/// How many requests came lately, by address and by key.
pub(super) struct Rates {
    clock: RateClock,
    /// How many requests of addresses came.
    seen: AtomicUsize,
    by_address: Option<Keyed<IpAddr>>,
    by_key: Option<Keyed<OwnerKey>>,
    entries: Option<Keyed<IpAddr>>,
    /// KiB of large bodies.
    bodies: Option<Keyed<Party>>,
    bodies_of_competition: Option<Keyed<Party>>,
}

impl Rates {
    pub(super) fn new(limits: &Limits, clock: Arc<dyn Clock>) -> Self {
        fn keyed<K: std::hash::Hash + Eq + Clone>(
            per_s: u32,
            clock: &RateClock,
        ) -> Option<Keyed<K>> {
            let per_s = NonZeroU32::new(per_s)?;
            let burst = per_s.saturating_add(per_s.get());
            let quota = Quota::per_second(per_s).allow_burst(burst);
            Some(RateLimiter::new(quota, DashMapStateStore::default(), clock.clone()))
        }
        let clock = RateClock(clock);
        let entries = NonZeroU32::new(limits.entries_per_address_h_max).map(|most| {
            let quota = Quota::per_hour(most);
            RateLimiter::new(quota, DashMapStateStore::default(), clock.clone())
        });
        // Twice as much at once: two of the largest bodies at least.
        let kib = |bytes: usize| u32::try_from(bytes / BODY_CELL_BYTES).unwrap_or(u32::MAX / 2);
        Self {
            entries,
            bodies: keyed(kib(limits.large_body_bytes_per_key_s_max), &clock),
            bodies_of_competition: keyed(
                kib(limits.large_body_bytes_per_competition_s_max),
                &clock,
            ),
            by_address: keyed(limits.address_requests_per_s_max, &clock),
            by_key: keyed(limits.key_requests_per_s_max, &clock),
            seen: AtomicUsize::new(0),
            clock,
        }
    }

    /// Counts a request of an address. Those of this machine itself are not limited.
    fn check_address(&self, address: IpAddr, limits: &Limits) -> Result<(), ApiError> {
        let Some(rates) = self.by_address.as_ref().filter(|_| !address.is_loopback()) else {
            return Ok(());
        };
        Self::forget_if_many(rates, &self.seen);
        let most = limits.address_requests_per_s_max;
        rates.check_key(&network(address)).map_err(|until| {
            let wait = until.wait_time_from(self.clock.now());
            limited("address_requests_per_s_max", most, "this address", wait)
        })
    }

    /// Counts a request that was made with a key, or with a token of an episode of it.
    pub(super) fn check_key(&self, key: OwnerKey, limits: &Limits) -> Result<(), ApiError> {
        let Some(rates) = &self.by_key else { return Ok(()) };
        let most = limits.key_requests_per_s_max;
        rates.check_key(&key).map_err(|until| {
            let wait = until.wait_time_from(self.clock.now());
            limited("key_requests_per_s_max", most, "this key", wait)
        })
    }

    /// Counts an entry in a competition from an address. Those of this machine itself are not limited.
    pub(super) fn check_entry(&self, address: IpAddr, limits: &Limits) -> Result<(), ApiError> {
        let Some(rates) = self.entries.as_ref().filter(|_| !address.is_loopback()) else {
            return Ok(());
        };
        let most = limits.entries_per_address_h_max;
        rates.check_key(&network(address)).map_err(|until| {
            let wait = until.wait_time_from(self.clock.now());
            let name = "entries_per_address_h_max";
            metrics::counter!("swarmbench_rate_limited_total", "limit" => name).increment(1);
            let detail = format!(
                "{most} entries an hour came from this address, the maximum; try again later, or ask the organizer for a code"
            );
            ApiError::limit(Code::RateLimited, name, most as usize, detail).retry_after(wait)
        })
    }

    /// Counts a large body of `bytes` bytes before it is read. Those of this machine itself are not limited.
    pub(super) fn check_body(
        &self,
        party: Party,
        bytes: usize,
        limits: &Limits,
    ) -> Result<(), ApiError> {
        if matches!(party.group, Group::Address(address) if address.is_loopback()) {
            return Ok(());
        }
        let own = ("large_body_bytes_per_key_s_max", limits.large_body_bytes_per_key_s_max);
        self.check_bytes(self.bodies.as_ref(), party, bytes, own)?;
        if let Group::Competition(_) = party.group {
            let most = limits.large_body_bytes_per_competition_s_max;
            let all = ("large_body_bytes_per_competition_s_max", most);
            self.check_bytes(
                self.bodies_of_competition.as_ref(),
                Party::of(party.group),
                bytes,
                all,
            )?;
        }
        Ok(())
    }

    fn check_bytes(
        &self,
        rates: Option<&Keyed<Party>>,
        party: Party,
        bytes: usize,
        (name, most): (&'static str, usize),
    ) -> Result<(), ApiError> {
        let Some(rates) = rates else { return Ok(()) };
        if rates.len() > ADDRESSES_REMEMBERED {
            forget(rates);
        }
        let cells = u32::try_from(bytes.div_ceil(BODY_CELL_BYTES)).ok().and_then(NonZeroU32::new);
        let wait = match cells.map(|cells| rates.check_key_n(&party, cells)) {
            None | Some(Ok(Ok(()))) => return Ok(()),
            Some(Ok(Err(until))) => until.wait_time_from(self.clock.now()),
            // It is more than may come at once.
            Some(Err(_)) => Duration::from_secs(1),
        };
        metrics::counter!("swarmbench_rate_limited_total", "limit" => name).increment(1);
        let detail = format!(
            "more than {most} bytes a second were sent in bodies of more than {LIGHT_BODY_BYTES_MAX} bytes; send this one again later, or smaller ones"
        );
        Err(ApiError::limit(Code::RateLimited, name, most, detail).retry_after(wait))
    }

    /// Forgets clients without recent requests.
    pub(super) fn forget_idle(&self) {
        for rates in self.by_address.iter().chain(&self.entries) {
            forget(rates);
        }
        if let Some(rates) = &self.by_key {
            forget(rates);
        }
        for rates in self.bodies.iter().chain(&self.bodies_of_competition) {
            forget(rates);
        }
    }

    /// Forgets addresses in time where many come within a minute.
    fn forget_if_many(rates: &Keyed<IpAddr>, seen: &AtomicUsize) {
        let is_due = seen.fetch_add(1, Ordering::Relaxed).is_multiple_of(ADDRESSES_COUNTED_EVERY);
        if is_due && rates.len() > ADDRESSES_REMEMBERED {
            forget(rates);
        }
    }
}

/// Forgets clients whose bucket is full, and frees the memory.
fn forget<K: std::hash::Hash + Eq + Clone>(rates: &Keyed<K>) {
    rates.retain_recent();
    rates.shrink_to_fit();
}

fn limited(name: &str, most: u32, whose: &str, wait: Duration) -> ApiError {
    metrics::counter!("swarmbench_rate_limited_total", "limit" => name.to_owned()).increment(1);
    let detail = format!("more than {most} requests a second came from {whose}; try again later");
    ApiError::limit(Code::RateLimited, name, most as usize, detail).retry_after(wait)
}

/// What counts as one address: a host has a whole /64 of IPv6 to choose from.
pub(super) fn network(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => address,
        IpAddr::V6(address) => IpAddr::V6((address.to_bits() & !u128::from(u64::MAX)).into()),
    }
}

/// Refuses requests that do not say, or say twice, for which host they are: a proxy in front might take another one for
/// it. HTTP/1.0 knows no such header.
pub(super) async fn check_host(request: Request, next: Next) -> Result<Response, ApiError> {
    let mut hosts = request.headers().get_all(header::HOST).iter();
    let problem = match (hosts.next(), hosts.next()) {
        (Some(_), Some(_)) => "the request has more than one `Host` header",
        (None, _) if request.version() >= Version::HTTP_11 => "the request has no `Host` header",
        (Some(host), None) if !is_host(host) => {
            "the `Host` header is not a name, or an address, and a port"
        }
        _ => return Ok(next.run(request).await),
    };
    Err(ApiError::new(Code::Malformed, problem))
}

/// Whether it is the name of a host with or without a port, or nothing, as requests may have it.
fn is_host(value: &HeaderValue) -> bool {
    value.is_empty()
        || value.to_str().is_ok_and(|host| !host.contains('@') && host.parse::<Authority>().is_ok())
}

/// Finds out who asks, and counts it.
pub(super) async fn admit(
    State(app): State<App>,
    mut request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let peer = request.extensions().get::<Peer>().map(|Peer(peer)| *peer);
    let peer = peer.ok_or_else(|| ApiError::new(Code::Internal, "the peer is not known"))?;
    let trusted = &app.access.trusted_proxies;
    let client = Client::of(peer, request.headers(), request.uri(), trusted);
    app.rates.check_address(client.address, &app.limits)?;
    request.extensions_mut().insert(client);
    let in_flight = app.in_flight.take(client.address, &app.limits)?;
    let rank = rank(request.method(), request.uri().path());
    let is_light = rank == Rank::Urgent && is_light(&request);
    let answered = async { (next.run(request).await, Origin::current()) };
    let answered = rank.scope(client.party().scope(answered));
    let (mut response, origin) =
        if is_light { answered.await } else { app.workers.in_background(answered).await? };
    // It counts until its body is sent, and is made for the same party to its end.
    response.extensions_mut().insert(RequestContext { origin, _in_flight: in_flight });
    Ok(response)
}

/// How many requests are not answered yet, by address. A proxy forwards those of many on its own connections: here it
/// shows whose they are.
#[derive(Debug, Default)]
pub(super) struct InFlight(Mutex<HashMap<IpAddr, usize>>);

/// What accompanies a request until its answer is sent.
#[derive(Clone, Debug)]
pub(super) struct RequestContext {
    /// For whom the answer is made.
    pub(super) origin: Origin,
    _in_flight: InFlightRequest,
}

/// A request that is counted until this is dropped.
#[derive(Clone, Debug)]
struct InFlightRequest {
    _permit: Option<Arc<InFlightPermit>>,
}

#[derive(Debug)]
struct InFlightPermit {
    all: Arc<InFlight>,
    network: IpAddr,
}

impl InFlight {
    fn requests(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        self.0.lock().expect("nothing panics while it holds this")
    }

    /// Counts a request of an address. Those of this machine itself are not limited.
    fn take(
        self: &Arc<Self>,
        address: IpAddr,
        limits: &Limits,
    ) -> Result<InFlightRequest, ApiError> {
        if address.is_loopback() {
            return Ok(InFlightRequest { _permit: None });
        }
        let network = network(address);
        let most = limits.requests_per_address_max;
        let mut requests = self.requests();
        let here = requests.entry(network).or_default();
        if *here >= most {
            let name = "requests_per_address_max";
            let detail = format!("{most} requests of this address wait for their answers already");
            return Err(ApiError::limit(Code::Overloaded, name, most, detail)
                .retry_after(Duration::from_secs(1)));
        }
        *here += 1;
        drop(requests);
        let permit = InFlightPermit { all: Arc::clone(self), network };
        Ok(InFlightRequest { _permit: Some(Arc::new(permit)) })
    }
}

impl Drop for InFlightPermit {
    fn drop(&mut self) {
        let mut requests = self.all.requests();
        if let Entry::Occupied(mut here) = requests.entry(self.network) {
            *here.get_mut() -= 1;
            if *here.get() == 0 {
                here.remove();
            }
        }
    }
}

/// Bytes of a body that is read and handled in one piece on the threads on which games run. A larger one, or one that does
/// not say how large it is, is handled on threads of lower priority.
pub(super) const LIGHT_BODY_BYTES_MAX: usize = 128 * 1024;

/// Whether the body is small.
pub(super) fn is_light(request: &Request) -> bool {
    request.body().size_hint().upper().is_some_and(|bytes| bytes <= LIGHT_BODY_BYTES_MAX as u64)
}

/// The rank of a request: playing, entering and changing come first, reading comes after them.
fn rank(method: &Method, path: &str) -> Rank {
    match path {
        _ if method != Method::GET && method != Method::HEAD => Rank::Urgent,
        "/obs" | "/swarm/obs" | "/healthz" | "/readyz" | "/metrics" => Rank::Urgent,
        _ => Rank::Normal,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(peer: &str, headers: &[(&str, &str)]) -> Client {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            let name: HeaderName = name.parse().expect("a name");
            map.append(name, value.parse().expect("a value"));
        }
        let trusted =
            ["127.0.0.1/32".parse().expect("a net"), "10.0.0.0/8".parse().expect("a net")];
        let peer = peer.parse().expect("an address");
        Client::of(peer, &map, &Uri::from_static("/obs"), &trusted)
    }

    #[test]
    fn only_trusted_proxies_say_whom_they_forward() {
        for (peer, forwarded, expected) in [
            ("203.0.113.9", "198.51.100.1", "203.0.113.9"),
            ("127.0.0.1", "198.51.100.1", "198.51.100.1"),
            ("127.0.0.1", "6.6.6.6, 198.51.100.1", "198.51.100.1"),
            ("127.0.0.1", "6.6.6.6, 198.51.100.1, 10.1.2.3", "198.51.100.1"),
            ("127.0.0.1", "10.1.2.3", "10.1.2.3"),
            ("127.0.0.1", "nonsense", "127.0.0.1"),
            ("127.0.0.1", "198.51.100.1, nonsense", "127.0.0.1"),
            ("::ffff:127.0.0.1", "2001:db8::1", "2001:db8::1"),
        ] {
            let seen = client(peer, &[("x-forwarded-for", forwarded), ("host", "localhost")]);
            assert_eq!(seen.address.to_string(), expected, "{peer} {forwarded}");
            assert!(!seen.is_local, "what is forwarded is not from here");
        }
        // Several headers are one list.
        let lines = [("x-forwarded-for", "6.6.6.6"), ("x-forwarded-for", "198.51.100.1")];
        assert_eq!(client("127.0.0.1", &lines).address.to_string(), "198.51.100.1");
    }

    #[test]
    fn a_program_on_this_machine_is_told_from_proxies_and_pages() {
        for (peer, headers, expected) in [
            ("127.0.0.1", &[("host", "127.0.0.1:8080")][..], true),
            ("127.0.0.1", &[("host", "LocalHost")], true),
            ("::1", &[("host", "[::1]:8080")], true),
            ("127.9.9.9", &[("host", "127.9.9.9")], true),
            ("127.0.0.1", &[], false),
            ("127.0.0.1", &[("host", "evil.example:8080")], false),
            ("127.0.0.1", &[("host", "localhost.evil.example")], false),
            ("127.0.0.1", &[("host", "localhost:evil")], false),
            ("127.0.0.1", &[("host", "127.0.0.1@evil.example")], false),
            ("192.0.2.1", &[("host", "localhost")], false),
            ("127.0.0.1", &[("host", "localhost"), ("x-real-ip", "192.0.2.1")], false),
            ("127.0.0.1", &[("host", "localhost"), ("via", "1.1 proxy")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "https://evil.example")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "null")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "http://localhost:3000")], true),
        ] {
            assert_eq!(client(peer, headers).is_local, expected, "{peer} {headers:?}");
        }
    }

    #[test]
    fn one_host_has_many_addresses_of_ipv6() {
        let network = |text: &str| network(text.parse().expect("an address"));
        assert_eq!(network("2001:db8::1"), network("2001:db8::ffff:1"));
        assert_ne!(network("2001:db8::1"), network("2001:db8:0:1::1"));
        assert_ne!(network("192.0.2.1"), network("192.0.2.2"));
    }
}
