//! The accept loop: HTTP/1.1 with timeouts on every connection (`timers.rs`), a limit of connections, and a quick error for
//! connections above it.

use std::convert::Infallible;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv6Addr};
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use futures::future::FutureExt as _;
use hyper::Request;
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use ipnet::IpNet;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::client::{ByNetwork, Peer, address, site};
use super::error::{ApiError, Code};
use super::eviction::{Holder, Holders, Whose};
use super::front::{Answered, Front, REQUEST_ID};
use super::limits::Limits;
use super::timers::{ConnectionTimers, TimedBody, TimedStream, Timeouts};
use crate::fair::Party;

/// Maximum bytes of a request's line and headers; hyper answers longer ones with 431 by itself.
pub const HEAD_BYTES_MAX: usize = 16 * 1024;

/// Memory of a connection with its request: the buffers; a head of [`HEAD_BYTES_MAX`], both raw and parsed; and a short body with
/// its parsed form, or a short answer.
pub const CONNECTION_BYTES: usize = 48 * 1024;

/// Connections over the limit that get an error response at once; further ones are only closed.
pub const REFUSALS_MAX: usize = 128;

/// Evicted connections that are not closed yet; at this number no others are evicted.
pub const EVICTIONS_MAX: usize = 32;

/// Timeout for a connection over the limit to read its error.
const REFUSAL: Duration = Duration::from_secs(1);

/// Time after which clients over the limit may try again.
const RETRY_AFTER: Duration = Duration::from_secs(5);

/// Connections in a burst, and minimum time of a burst: their first requests come together, and games continue in between. It
/// makes 8,000 connections a second.
const ACCEPTS_AT_ONCE: u32 = 16;
const ACCEPTS_TAKE: Duration = Duration::from_millis(2);

/// Serves until `stop` is cancelled, then lets open requests end.
pub async fn serve(
    listener: TcpListener,
    front: Front,
    limits: Limits,
    trusted_proxies: Vec<IpNet>,
    stop: CancellationToken,
) {
    let limit = Arc::new(ConnectionLimit::new(&limits, trusted_proxies, stop.clone()));
    let timeouts = Timeouts::from(&limits);
    let refusals = Arc::new(Semaphore::new(REFUSALS_MAX));
    let connections = TaskTracker::new();
    let ending = Ending { stop, cut: CancellationToken::new() };
    let (mut burst, mut burst_began) = (0, Instant::now());
    loop {
        if burst == ACCEPTS_AT_ONCE {
            tokio::time::sleep(ACCEPTS_TAKE.saturating_sub(burst_began.elapsed())).await;
            (burst, burst_began) = (0, Instant::now());
        }
        burst += 1;
        let (stream, peer) = tokio::select! {
            accepted = listener.accept() => match accepted {
                // An IPv6 address may be a mapped IPv4 address.
                Ok((stream, from)) => (stream, Peer(from.ip().to_canonical())),
                Err(error) if is_connection_error(error.kind()) => continue,
                Err(error) => {
                    // The host may have too many open files, for example, and others may be closed meanwhile.
                    tracing::warn!(%error, "a connection was not accepted");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    continue;
                }
            },
            () = ending.stop.cancelled() => break,
        };
        let timers = ConnectionTimers::new(timeouts);
        match limit.take(peer, &timers) {
            Ok(permit) => {
                let (front, ending) = (front.clone(), ending.clone());
                let counted = Arc::clone(&permit.counted);
                let answer = move |request| {
                    let (front, counted) = (front.clone(), Arc::clone(&counted));
                    async move { front.answer(request, peer, counted).await }
                };
                connections
                    .spawn(connection(stream, peer, answer, timers, ending, Some(permit)).boxed());
                if limit.has_many_evicted() {
                    // The evicted connections are closed before the next one is accepted.
                    tokio::task::yield_now().await;
                }
            }
            Err(full) => {
                metrics::counter!("swarmbench_connections_refused_total", "reason" => full.reason)
                    .increment(1);
                if let Ok(permit) = Arc::clone(&refusals).try_acquire_owned() {
                    let timeouts =
                        Timeouts { head: REFUSAL, idle: REFUSAL, write: REFUSAL, ..timeouts };
                    let timers = ConnectionTimers::new(timeouts);
                    let front = front.clone();
                    let answer = move |request: Request<Body>| {
                        let response = full.response(front.id_of(&request));
                        std::future::ready(Answered { response, context: None })
                    };
                    let refused = connection(stream, peer, answer, timers, ending.clone(), None);
                    let refused = async move {
                        refused.await;
                        drop(permit);
                    };
                    connections.spawn(refused.boxed());
                }
            }
        }
    }
    drop(listener);
    connections.close();
    let drain = Duration::from_millis(limits.drain_ms_max);
    if tokio::time::timeout(drain, connections.wait()).await.is_err() {
        tracing::warn!(
            open = connections.len(),
            "connections that outlived the grace period were cut"
        );
        ending.cut.cancel();
        connections.wait().await;
    }
}

/// True for errors of one connection, false for errors of the host.
const fn is_connection_error(error: ErrorKind) -> bool {
    matches!(
        error,
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused
    )
}

/// Signals that end connections.
#[derive(Clone)]
struct Ending {
    /// Graceful end: of idle connections at once, of others after the answer to their request.
    stop: CancellationToken,
    /// Immediate end, whatever a connection does.
    cut: CancellationToken,
}

/// Serves a connection: `answer` answers its requests.
async fn connection<A: Future<Output = Answered>>(
    stream: TcpStream,
    peer: Peer,
    answer: impl Fn(Request<Body>) -> A,
    timers: ConnectionTimers,
    ending: Ending,
    permit: Option<ConnectionPermit>,
) {
    // A small answer must not wait for more to send; where the option cannot be set, answers are only late.
    drop(stream.set_nodelay(true));
    let stream = TokioIo::new(TimedStream { stream, timers: timers.clone() });
    let service = service_fn(|request: Request<Incoming>| {
        let pending = timers.pending();
        if let Some(permit) = &permit {
            permit.counted.asked_by(peer, request.headers());
        }
        let answer = answer(request.map(Body::new));
        async move {
            let Answered { response, context: request } = answer.await;
            Ok::<_, Infallible>(response.map(|body| TimedBody { body, _pending: pending, request }))
        }
    });
    let served = hyper::server::conn::http1::Builder::new()
        .header_read_timeout(None)
        .max_buf_size(HEAD_BYTES_MAX)
        .serve_connection(stream, service);
    // One token serves both purposes: a connection polls every token whenever there is something to read.
    let end = match &permit {
        Some(permit) => permit.end.clone(),
        None => ending.stop.child_token(),
    };
    let (mut served, mut timeout) = (pin!(served), pin!(timers.timed_out()));
    let mut end = pin!(end.cancelled());
    let mut stopping = false;
    loop {
        tokio::select! {
            // The timers are polled after the I/O that moves them.
            biased;
            served = served.as_mut() => {
                if let Err(error) = served {
                    tracing::debug!(%error, "a connection broke off");
                }
                break;
            }
            timeout = timeout.as_mut() => {
                metrics::counter!("swarmbench_connections_cut_total", "reason" => timeout.name())
                    .increment(1);
                break;
            }
            () = end.as_mut(), if !stopping => {
                if !ending.stop.is_cancelled() {
                    metrics::counter!("swarmbench_connections_cut_total", "reason" => "room").increment(1);
                    break;
                }
                stopping = true;
                served.as_mut().graceful_shutdown();
            }
            () = ending.cut.cancelled(), if stopping => break,
        }
    }
}

/// Limits of connections: in all, and per address. The last few are reserved for addresses without any. At the limit, a connection
/// of a holder with more than its fair share is evicted.
struct ConnectionLimit {
    most: usize,
    reserved: usize,
    most_per_address: usize,
    trusted_proxies: Vec<IpNet>,
    stop: CancellationToken,
    open: Mutex<Connections>,
}

#[derive(Default)]
struct Connections {
    /// Open connections, without evicted ones.
    all: usize,
    /// Connections by network; those of this host count together, and no entry is 0.
    by_network: ByNetwork,
    /// Connections by party and client, also behind proxies.
    holders: Holders<Connection>,
    /// Evicted connections that are not closed yet.
    evictions: usize,
    accepted: u64,
}

struct Connection {
    network: IpAddr,
    timers: ConnectionTimers,
    end: CancellationToken,
}

impl Connections {
    fn release(&mut self, network: IpAddr) {
        self.all -= 1;
        self.by_network.remove(network);
    }

    /// Evicts a connection in favour of `newcomer`. Returns whether there was one to evict.
    fn make_room(&mut self, most: usize, newcomer: Holder) -> bool {
        if self.evictions >= EVICTIONS_MAX {
            return false;
        }
        let evicted = self.holders.evict(most, newcomer, |connection| connection.timers.usage());
        let Some(Connection { network, end, .. }) = evicted else { return false };
        end.cancel();
        self.evictions += 1;
        self.release(network);
        true
    }
}

impl ConnectionLimit {
    fn new(limits: &Limits, trusted_proxies: Vec<IpNet>, stop: CancellationToken) -> Self {
        Self {
            most: limits.connections_max,
            reserved: limits.connections_max * limits.reserved_percent as usize / 100,
            most_per_address: limits.connections_per_address_max,
            trusted_proxies,
            stop,
            open: Mutex::default(),
        }
    }

    fn has_many_evicted(&self) -> bool {
        let open = self.open.lock().expect("nothing panics while it holds this");
        open.evictions >= EVICTIONS_MAX / 2
    }

    /// Holder of a connection that has not sent a request yet.
    fn newcomer(&self, peer: Peer) -> Holder {
        let is_proxy = self.trusted_proxies.iter().any(|net| net.contains(&peer.0));
        if is_proxy { Holder::Unknown(peer.0) } else { Holder::Client(site(peer.0)) }
    }

    fn take(
        self: &Arc<Self>,
        peer: Peer,
        timers: &ConnectionTimers,
    ) -> Result<ConnectionPermit, Full> {
        // A proxy on this host speaks for many clients.
        let is_host = peer.0.is_loopback();
        let network = if is_host { IpAddr::V6(Ipv6Addr::LOCALHOST) } else { peer.0 };
        let mut open = self.open.lock().expect("nothing panics while it holds this");
        if !is_host && !open.by_network.has_room(network, self.most_per_address) {
            let limit = "connections_per_address_max";
            return Err(Full { reason: "address", limit, most: self.most_per_address });
        }
        let most =
            if open.by_network.is_new(network) { self.most } else { self.most - self.reserved };
        let holder = self.newcomer(peer);
        if open.all >= most && !open.make_room(most, holder) {
            return Err(Full { reason: "server", limit: "connections_max", most: self.most });
        }
        open.all += 1;
        open.by_network.add(network);
        let number = open.accepted;
        open.accepted += 1;
        let end = self.stop.child_token();
        let connection = Connection { network, timers: timers.clone(), end: end.clone() };
        open.holders.add(Whose::client(holder), number, connection);
        metrics::gauge!("swarmbench_connections").increment(1.0);
        let whose = Mutex::new(Whose::client(holder));
        let counted = Arc::new(Counted { limit: Arc::clone(self), number, whose });
        Ok(ConnectionPermit { counted, network, end })
    }
}

/// Permit for an open connection, returned on drop.
struct ConnectionPermit {
    counted: Arc<Counted>,
    network: IpAddr,
    /// Cancelled when the connection is evicted, or the server stops.
    end: CancellationToken,
}

/// A counted connection.
pub(super) struct Counted {
    limit: Arc<ConnectionLimit>,
    number: u64,
    whose: Mutex<Whose>,
}

tokio::task_local! {
    static CONNECTION: Arc<Counted>;
}

/// Moves the connection of the request that this task handles to the party of its token.
pub(super) fn token_of(party: Party) {
    // Work without a request has no connection.
    let _ = CONNECTION.try_with(|connection| {
        connection.move_to(|whose| Whose { party: Some(party), ..whose });
    });
}

impl Counted {
    /// Runs a future that handles a request of this connection.
    pub(super) async fn scope<F: Future>(self: Arc<Self>, future: F) -> F::Output {
        CONNECTION.scope(self, future).await
    }

    /// Moves the connection to the client whose request it has sent.
    fn asked_by(&self, peer: Peer, headers: &HeaderMap) {
        let client = Holder::Client(site(address(peer.0, headers, &self.limit.trusted_proxies)));
        // The party stays as long as the client does.
        self.move_to(|whose| if whose.holder == client { whose } else { Whose::client(client) });
    }

    fn move_to(&self, change: impl FnOnce(Whose) -> Whose) {
        let mut whose = self.whose.lock().expect("nothing panics while it holds this");
        let changed = change(*whose);
        if *whose == changed {
            return;
        }
        *whose = changed;
        let mut open = self.limit.open.lock().expect("nothing panics while it holds this");
        if let Some(connection) = open.holders.remove(self.number) {
            open.holders.add(changed, self.number, connection);
        }
    }
}

impl Drop for ConnectionPermit {
    fn drop(&mut self) {
        let Counted { limit, number, .. } = &*self.counted;
        let mut open = limit.open.lock().expect("nothing panics while it holds this");
        match open.holders.remove(*number) {
            Some(_) => open.release(self.network),
            None => open.evictions -= 1,
        }
        metrics::gauge!("swarmbench_connections").decrement(1.0);
    }
}

/// A limit of connections that was reached.
#[derive(Debug, PartialEq, Eq)]
struct Full {
    reason: &'static str,
    limit: &'static str,
    most: usize,
}

impl Full {
    /// Answer to a request over a connection that is one too many.
    fn response(&self, id: HeaderValue) -> Response {
        let detail = match self.limit {
            "connections_max" => {
                "the server has its maximum number of connections; try again later"
            }
            _ => "your address has its maximum number of connections; close some, or reuse them",
        };
        let error = ApiError::limit(Code::Overloaded, self.limit, self.most, detail)
            .retry_after(RETRY_AFTER);
        let mut response = error.into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
        headers.insert(REQUEST_ID, id);
        response
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderName;

    use super::super::client::NETWORKS_PER_SITE_MAX;
    use super::*;

    const PROXY: &str = "203.0.113.1/32";

    fn limit(most: usize, most_per_address: usize) -> Arc<ConnectionLimit> {
        let limits = Limits {
            connections_max: most,
            connections_per_address_max: most_per_address,
            ..Limits::default()
        };
        Arc::new(ConnectionLimit::new(
            &limits,
            vec![PROXY.parse().expect("a net")],
            CancellationToken::new(),
        ))
    }

    fn peer(address: &str) -> Peer {
        Peer(address.parse().expect("an address"))
    }

    fn take(limit: &Arc<ConnectionLimit>, address: &str) -> Result<ConnectionPermit, Full> {
        limit.take(peer(address), &ConnectionTimers::new(Timeouts::from(&Limits::default())))
    }

    fn asked_by(permit: &ConnectionPermit, client: &str) {
        let forwarded = client.parse().expect("ASCII");
        let headers =
            HeaderMap::from_iter([(HeaderName::from_static("x-forwarded-for"), forwarded)]);
        permit.counted.asked_by(peer("203.0.113.1"), &headers);
    }

    fn reason(open: Result<ConnectionPermit, Full>) -> &'static str {
        open.err().expect("no permit").reason
    }

    #[test]
    fn an_address_has_so_many_places_and_gets_them_back() {
        let limit = limit(10, 2);
        let first = take(&limit, "192.0.2.1");
        let _second = take(&limit, "192.0.2.1").expect("a permit");
        assert_eq!(reason(take(&limit, "192.0.2.1")), "address");
        let _other = take(&limit, "192.0.2.2").expect("another address");
        drop(first);
        let _again = take(&limit, "192.0.2.1").expect("a permit was returned");
    }

    #[test]
    fn a_network_of_ipv6_is_one_address() {
        let limit = limit(10, 1);
        let _first = take(&limit, "2001:db8:0:1::1").expect("a permit");
        assert_eq!(reason(take(&limit, "2001:db8:0:1:ffff::2")), "address");
        let _other = take(&limit, "2001:db8:0:2::1").expect("another network");
    }

    #[test]
    fn a_site_of_ipv6_is_a_few_addresses_and_not_thousands() {
        let limit = limit(100, 2);
        let open = |site: u32| -> Vec<_> {
            let peers = (0..100).map(|network| format!("2001:db8:{site:x}:{network:x}::1"));
            peers.filter_map(|peer| take(&limit, &peer).ok()).collect()
        };
        let (one, other) = (open(1), open(2));
        let most = 2 * NETWORKS_PER_SITE_MAX as usize;
        assert_eq!((one.len(), other.len()), (most, most));
        assert!(
            limit.newcomer(peer("2001:db8:1:ffff::1")) == limit.newcomer(peer("2001:db8:1::1"))
        );
    }

    #[test]
    fn the_last_places_are_for_addresses_that_have_none() {
        let limit = limit(20, 20);
        let connection: Vec<_> = (0..18).map(|_| take(&limit, "127.0.0.1")).collect();
        assert!(connection.iter().all(Result::is_ok));
        assert_eq!(reason(take(&limit, "127.0.0.1")), "server");
        let _others =
            ["192.0.2.1", "192.0.2.3"].map(|new| take(&limit, new).expect("it has none yet"));
        let _room = take(&limit, "192.0.2.2").expect("this host has more than its share");
        assert!(connection[0].as_ref().is_ok_and(|first| first.end.is_cancelled()));
    }

    #[test]
    fn this_host_may_take_all_places_and_no_more() {
        let limit = limit(3, 1);
        let all = ["127.0.0.1", "127.0.0.1", "::1"].map(|address| take(&limit, address));
        assert!(all.iter().all(Result::is_ok));
        assert_eq!(reason(take(&limit, "127.0.0.1")), "server");
        drop(all);
        let open = limit.open.lock().expect("no panic");
        assert_eq!((open.all, &open.by_network), (0, &ByNetwork::default()));
    }

    #[test]
    fn a_client_behind_a_proxy_makes_room_for_another_one() {
        let limit = limit(4, 100);
        let greedy: Vec<_> = (0..4).filter_map(|_| take(&limit, "203.0.113.1").ok()).collect();
        assert_eq!(greedy.len(), 4);
        for permit in &greedy {
            asked_by(permit, "192.0.2.1");
        }
        let evicted =
            |of: &[ConnectionPermit]| of.iter().filter(|permit| permit.end.is_cancelled()).count();
        let honest = [(); 2].map(|()| take(&limit, "203.0.113.1").expect("there is room"));
        assert_eq!(evicted(&greedy), 2);
        for permit in &honest {
            asked_by(permit, "192.0.2.2");
        }
        // Every address has its share, except one that has none yet.
        let third = take(&limit, "203.0.113.1").err();
        assert_eq!(third.map(|full| full.reason), Some("server"));
        assert_eq!(evicted(&honest), 0);
        drop((greedy, honest));
        let open = limit.open.lock().expect("no panic");
        assert_eq!((open.all, &open.by_network, open.evictions), (0, &ByNetwork::default(), 0));
    }

    #[test]
    fn no_more_are_evicted_than_are_closed() {
        let limit = limit(3 * EVICTIONS_MAX, 1000);
        let proxy = "203.0.113.1";
        let greedy: Vec<_> =
            (0..3 * EVICTIONS_MAX).map_while(|_| take(&limit, proxy).ok()).collect();
        for permit in &greedy {
            asked_by(permit, "192.0.2.1");
        }
        let came: Vec<_> = (0..EVICTIONS_MAX).map_while(|_| take(&limit, proxy).ok()).collect();
        assert_eq!(came.len(), EVICTIONS_MAX);
        assert_eq!(reason(take(&limit, proxy)), "server");
        drop(greedy);
        drop(take(&limit, proxy).expect("they are closed"));
    }
}
