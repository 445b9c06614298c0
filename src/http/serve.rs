//! The accept loop: HTTP/1.1 with clocks on every connection (`pace.rs`), a place for each of so many, and
//! a quick answer to those for whom there is none.

use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv6Addr};
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::http::HeaderName;
use axum::response::IntoResponse;
use hyper::Request;
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::{ServiceBuilder, ServiceExt};
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};

use super::client::{Peer, network};
use super::error::{ApiError, Code};
use super::limits::Limits;
use super::pace::{Answer, Pace, Paced, Patience};

/// Connections that are told at once that there is no place; whoever comes beyond is only closed.
pub const REFUSALS_MAX: usize = 128;

/// How long a connection may take to be told so.
const REFUSAL: Duration = Duration::from_secs(1);

/// When those who found no place may come again.
const COME_AGAIN: Duration = Duration::from_secs(5);

/// Serves until `stop` is cancelled, then lets open requests end.
pub async fn serve(listener: TcpListener, router: Router, limits: Limits, stop: CancellationToken) {
    let places = Arc::new(Places::new(&limits));
    let patience = Patience::from(&limits);
    let refusals = Arc::new(Semaphore::new(REFUSALS_MAX));
    let connections = TaskTracker::new();
    let ending = Ending { stop, cut: CancellationToken::new() };
    loop {
        let (stream, peer) = tokio::select! {
            accepted = listener.accept() => match accepted {
                // An IPv4 address may come in the clothes of an IPv6 one.
                Ok((stream, from)) => (stream, Peer(from.ip().to_canonical())),
                Err(error) if is_of_one(error.kind()) => continue,
                Err(error) => {
                    // Too many open files, say: others may close theirs meanwhile.
                    tracing::warn!(%error, "a connection was not accepted");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                    continue;
                }
            },
            () = ending.stop.cancelled() => break,
        };
        match places.take(peer) {
            Ok(place) => {
                let served = connection(stream, peer, router.clone(), patience, ending.clone());
                connections.spawn(async move {
                    served.await;
                    drop(place);
                });
            }
            Err(full) => {
                metrics::counter!("swarmbench_connections_refused_total", "reason" => full.reason)
                    .increment(1);
                if let Ok(turn) = Arc::clone(&refusals).try_acquire_owned() {
                    let patience =
                        Patience { head: REFUSAL, idle: REFUSAL, write: REFUSAL, ..patience };
                    let told = connection(stream, peer, full.router(), patience, ending.clone());
                    connections.spawn(async move {
                        told.await;
                        drop(turn);
                    });
                }
            }
        }
    }
    drop(listener);
    connections.close();
    let drain = Duration::from_millis(limits.drain_ms_max);
    if tokio::time::timeout(drain, connections.wait()).await.is_err() {
        tracing::warn!(open = connections.len(), "connections were cut");
        ending.cut.cancel();
        connections.wait().await;
    }
}

/// Whether an error of accepting concerns the one connection that is gone, and not the host.
const fn is_of_one(error: ErrorKind) -> bool {
    matches!(
        error,
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused
    )
}

/// What tells connections to end.
#[derive(Clone)]
struct Ending {
    /// In good order: idle ones at once, the others after the answer to their request.
    stop: CancellationToken,
    /// Wherever they are.
    cut: CancellationToken,
}

async fn connection(
    stream: TcpStream,
    peer: Peer,
    router: Router,
    patience: Patience,
    ending: Ending,
) {
    // Small answers must not wait for more to send; where that cannot be set they are only late.
    drop(stream.set_nodelay(true));
    let pace = Pace::new(patience);
    let stream = TokioIo::new(Paced { stream, pace: pace.clone() });
    let service = service_fn(|mut request: Request<Incoming>| {
        let answering = pace.answering();
        request.extensions_mut().insert(peer);
        let answer = router.clone().oneshot(request);
        async move {
            let answer = answer.await;
            answer.map(|mut answer| {
                let asked = answer.extensions_mut().remove();
                answer.map(|body| Answer { body, _answering: answering, asked })
            })
        }
    });
    let served = hyper::server::conn::http1::Builder::new()
        .header_read_timeout(None)
        .max_buf_size(64 * 1024)
        .serve_connection(stream, service);
    let (mut served, mut late) = (pin!(served), pin!(pace.late()));
    let mut stopping = false;
    loop {
        tokio::select! {
            // The clocks come after what moves them.
            biased;
            served = served.as_mut() => {
                if let Err(error) = served {
                    tracing::debug!(%error, "a connection broke off");
                }
                break;
            }
            late = late.as_mut() => {
                metrics::counter!("swarmbench_connections_cut_total", "reason" => late.name())
                    .increment(1);
                break;
            }
            () = ending.stop.cancelled(), if !stopping => {
                stopping = true;
                served.as_mut().graceful_shutdown();
            }
            () = ending.cut.cancelled(), if stopping => break,
        }
    }
}

/// The places for connections: so many at once, and so many from one address. The last few are for addresses that have
/// none.
struct Places {
    most: usize,
    reserved: usize,
    most_per_address: usize,
    taken: Mutex<Taken>,
}

#[derive(Default)]
struct Taken {
    all: usize,
    /// By network, and those of this host together; no entry is 0.
    by_network: HashMap<IpAddr, usize>,
}

impl Places {
    fn new(limits: &Limits) -> Self {
        Self {
            most: limits.connections_max,
            reserved: limits.connections_max * limits.connections_reserved_percent as usize / 100,
            most_per_address: limits.connections_per_address_max,
            taken: Mutex::default(),
        }
    }

    fn take(self: &Arc<Self>, peer: Peer) -> Result<Place, Full> {
        // A proxy on this host speaks for many.
        let is_host = peer.0.is_loopback();
        let network = if is_host { IpAddr::V6(Ipv6Addr::LOCALHOST) } else { network(peer.0) };
        let mut taken = self.taken.lock().expect("nothing panics while it holds this");
        let here = taken.by_network.get(&network).copied().unwrap_or(0);
        let most = if here == 0 { self.most } else { self.most - self.reserved };
        if taken.all >= most {
            return Err(Full { reason: "server", limit: "connections_max", most: self.most });
        }
        if !is_host && here >= self.most_per_address {
            let limit = "connections_per_address_max";
            return Err(Full { reason: "address", limit, most: self.most_per_address });
        }
        taken.by_network.insert(network, here + 1);
        taken.all += 1;
        metrics::gauge!("swarmbench_connections").increment(1.0);
        Ok(Place { places: Arc::clone(self), network })
    }
}

/// A place that is taken until this is dropped.
struct Place {
    places: Arc<Places>,
    network: IpAddr,
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken.lock().expect("nothing panics while it holds this");
        taken.all -= 1;
        if let Some(here) = taken.by_network.get_mut(&self.network) {
            *here -= 1;
            if *here == 0 {
                taken.by_network.remove(&self.network);
            }
        }
        metrics::gauge!("swarmbench_connections").decrement(1.0);
    }
}

/// There is no place.
#[derive(Debug, PartialEq, Eq)]
struct Full {
    reason: &'static str,
    limit: &'static str,
    most: usize,
}

impl Full {
    /// Answers every request with that.
    fn router(&self) -> Router {
        let detail = match self.limit {
            "connections_max" => "the server has as many connections as it takes; come again later",
            _ => "your address has as many connections as it may; close some, or use them again",
        };
        let error = ApiError::limit(Code::Overloaded, self.limit, self.most, detail)
            .retry_after(COME_AGAIN);
        let answer = move || async move {
            ([(axum::http::header::CONNECTION, "close")], error.clone()).into_response()
        };
        let request_id = HeaderName::from_static("x-request-id");
        let layers = ServiceBuilder::new()
            .layer(SetRequestIdLayer::new(request_id.clone(), MakeRequestUuid))
            .layer(PropagateRequestIdLayer::new(request_id));
        Router::new().fallback(answer).layer(layers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(most: usize, most_per_address: usize) -> Arc<Places> {
        let limits = Limits {
            connections_max: most,
            connections_per_address_max: most_per_address,
            ..Limits::default()
        };
        Arc::new(Places::new(&limits))
    }

    fn peer(address: &str) -> Peer {
        Peer(address.parse().expect("an address"))
    }

    fn reason(taken: Result<Place, Full>) -> &'static str {
        taken.err().expect("no place").reason
    }

    #[test]
    fn an_address_has_so_many_places_and_gets_them_back() {
        let places = places(10, 2);
        let first = places.take(peer("192.0.2.1"));
        let _second = places.take(peer("192.0.2.1")).expect("a place");
        assert_eq!(reason(places.take(peer("192.0.2.1"))), "address");
        let _other = places.take(peer("192.0.2.2")).expect("another address");
        drop(first);
        let _again = places.take(peer("192.0.2.1")).expect("it was given back");
    }

    #[test]
    fn a_network_of_ipv6_is_one_address() {
        let places = places(10, 1);
        let _first = places.take(peer("2001:db8:0:1::1")).expect("a place");
        assert_eq!(reason(places.take(peer("2001:db8:0:1:ffff::2"))), "address");
        let _other = places.take(peer("2001:db8:0:2::1")).expect("another network");
    }

    #[test]
    fn the_last_places_are_for_addresses_that_have_none() {
        let places = places(20, 20);
        let held: Vec<_> = (0..19).map(|_| places.take(peer("127.0.0.1"))).collect();
        assert!(held.iter().all(Result::is_ok));
        assert_eq!(reason(places.take(peer("127.0.0.1"))), "server");
        let _other = places.take(peer("192.0.2.1")).expect("it has none yet");
        assert_eq!(reason(places.take(peer("192.0.2.2"))), "server");
    }

    #[test]
    fn this_host_may_take_all_places_and_no_more() {
        let places = places(3, 1);
        let all = ["127.0.0.1", "127.0.0.1", "::1"].map(|address| places.take(peer(address)));
        assert!(all.iter().all(Result::is_ok));
        assert_eq!(reason(places.take(peer("127.0.0.1"))), "server");
        drop(all);
        let taken = places.taken.lock().expect("no panic");
        assert_eq!((taken.all, taken.by_network.len()), (0, 0));
    }
}
