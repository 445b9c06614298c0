//! Routing within a cluster: which server answers a request, and how the other servers forward it.
//!
//! Clients may send any request to any server. The owner of a place answers requests about what is played there; every other
//! server forwards the request unchanged, and streams the answer back. Any server reads finished games, lists and boards from the
//! database.

mod credential;
mod links;
pub(super) mod list;
mod peers;
mod target;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody as _};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use futures::StreamExt as _;
use metrics::Counter;
use quick_cache::sync::Cache;
use tokio_util::sync::CancellationToken;

use super::body::{LIGHT_BODY_BYTES_MAX, too_large};
use super::client::Client;
use super::feed::is_event_stream;
use super::front::is_of_a_player;
use super::prelude::*;
use crate::ids::{CompetitionKey, EpisodeId, Place, RunKey};
use crate::store::{Cluster, Store, StoreError};
use links::{Failed, Links, Question};
pub use peers::NodePeers;
pub(super) use peers::PATH;
use target::Target;

/// Capacity of the caches of owners and of games; those of runs and competitions are smaller.
const ROUTES_CACHED: usize = 100_000;

/// Longest wait of a request for another server to take over a place.
const MOVE_PATIENCE: Duration = Duration::from_millis(1500);

/// Interval between attempts to locate the owner while a request waits.
const MOVE_PAUSE: Duration = Duration::from_millis(25);

/// Header of an answer: this server does not own the place of the forwarded request.
const ELSEWHERE: HeaderName = HeaderName::from_static("x-swarmbench-elsewhere");

/// Extension of an answer: another server owns the place.
#[derive(Clone, Copy)]
pub(super) struct IsElsewhere;

/// One server's view of its cluster: owners of places, and connections to the other servers.
pub struct Nodes {
    cluster: Arc<Cluster>,
    store: Store,
    links: Links,
    forwarded: Counter,
    /// Owners of places; [`ANYBODY`] where everything has ended.
    owners: Cache<Place, i64>,
    games: Cache<EpisodeId, Place>,
    runs: Cache<String, RunKey>,
    competitions: Cache<String, CompetitionKey>,
}

/// Pseudo-owner of a place where everything has ended: any server answers from the database.
const ANYBODY: i64 = 0;

/// Server that answers a request.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Location {
    Here,
    At(Other),
}

/// Another server of the cluster.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Other {
    incarnation: i64,
    address: String,
}

/// Outcome of routing a request.
pub(super) enum Routed {
    /// This server handles the request.
    Here(Request),
    Answered(Response),
}

impl Nodes {
    /// `store` is the database that the cluster shares.
    pub fn new(store: Store, cluster: Arc<Cluster>, secret: &[u8]) -> Self {
        let links = Links::new(cluster.incarnation(), secret);
        Self {
            cluster,
            store,
            links,
            forwarded: metrics::counter!("swarmbench_forwarded_total"),
            owners: Cache::new(ROUTES_CACHED),
            games: Cache::new(ROUTES_CACHED),
            runs: Cache::new(ROUTES_CACHED / 10),
            competitions: Cache::new(ROUTES_CACHED / 100),
        }
    }

    /// Client of a request that another server forwarded, or made itself; `None` where the credential is for an earlier server of
    /// this address. Fails where no server of the cluster sent the request.
    pub(super) fn client_of_hop(&self, headers: &HeaderMap) -> Result<Option<Client>, ApiError> {
        self.links.client_of(headers)
    }

    /// Fails once the lease of this server has expired: another server may have taken over its places.
    pub(super) fn check_may_answer(&self) -> Result<(), ApiError> {
        if self.cluster.may_answer() {
            return Ok(());
        }
        let detail = "this server does not reach the database, so another one may have taken its games over; the same request works \
                      there, or here once the database is back";
        Err(ApiError::new(Code::Unavailable, detail).retry_after(Duration::from_secs(1)))
    }

    /// Locates the server that answers a request, and forwards the request unless it is this one.
    pub(super) async fn route(
        &self,
        app: &App,
        request: Request,
        client: Client,
        is_hop: bool,
    ) -> Result<Routed, ApiError> {
        let (parts, body) = request.into_parts();
        let target = self.target(app, &parts.method, parts.uri.path(), &parts.headers);
        let target = Box::pin(target).await?;
        let request = Request::from_parts(parts, body);
        if is_hop {
            return match target {
                Target::Place(place) if !self.takes(place).await? => {
                    Ok(Routed::Answered(elsewhere()))
                }
                _ => Ok(Routed::Here(request)),
            };
        }
        match self.locate(target).await? {
            Location::Here => Ok(Routed::Here(request)),
            Location::At(other) => {
                let routed = self.forward(app, request, client, target, &other).await?;
                Ok(match routed {
                    Routed::Answered(response) => Routed::Answered(until_stop(&app.stop, response)),
                    here @ Routed::Here(_) => here,
                })
            }
        }
    }

    /// Whether this server owns a place, or takes ownership now; true as well where everything there has ended.
    async fn takes(&self, place: Place) -> Result<bool, StoreError> {
        if self.cluster.has(place) || !self.cluster.is_unfinished(place).await? {
            return Ok(true);
        }
        self.store.take_place(place).await
    }

    /// Locates the server that answers a request.
    async fn locate(&self, target: Target) -> Result<Location, StoreError> {
        let owner = match target {
            Target::Anybody => ANYBODY,
            Target::New if self.cluster.takes_work() => ANYBODY,
            Target::Named(number) => self.taker(number)?,
            Target::New => self.taker(drawn())?,
            Target::Place(place) => self.owner(place).await?,
        };
        if owner == ANYBODY {
            return Ok(Location::Here);
        }
        if owner == self.cluster.incarnation() {
            return Ok(Location::Here);
        }
        let members = self.cluster.members();
        if let Some(member) = members.iter().find(|member| member.incarnation == owner) {
            return Ok(Location::At(Other { incarnation: owner, address: member.address.clone() }));
        }
        self.forget(target);
        // The owner has joined at this moment, or is gone.
        Err(StoreError::Elsewhere)
    }

    /// Server that creates something new. Fails where no server takes work at this moment.
    fn taker(&self, number: u64) -> Result<i64, StoreError> {
        let is_stopping =
            |one: &i64| *one == self.cluster.incarnation() && !self.cluster.takes_work();
        let taker = self.cluster.preferred_for(number).filter(|one| !is_stopping(one));
        taker.ok_or(StoreError::Elsewhere)
    }

    async fn owner(&self, place: Place) -> Result<i64, StoreError> {
        let me = self.cluster.incarnation();
        if self.cluster.has(place) {
            return Ok(me);
        }
        let is_known = |owner: &i64| {
            *owner == ANYBODY
                || self.cluster.members().iter().any(|member| member.incarnation == *owner)
        };
        if let Some(owner) = self.owners.get(&place).filter(is_known) {
            return Ok(owner);
        }
        let owner = match self.cluster.owner(place).await? {
            Some(owner) => owner,
            None if !self.cluster.is_unfinished(place).await? => ANYBODY,
            None => {
                if let Some(preferred) = self.cluster.preferred(place).filter(|one| *one != me) {
                    // The preferred server takes ownership when the request arrives.
                    return Ok(preferred);
                }
                if !self.cluster.takes_work() {
                    return Err(StoreError::Elsewhere);
                }
                match self.cluster.take(&[place]).await?.first() {
                    Some((_, owner)) => *owner,
                    None => return Err(StoreError::Elsewhere),
                }
            }
        };
        if owner == me {
            // A commit whose answer was lost took the place; or the place is being released.
            return if self.store.take_place(place).await? {
                Ok(me)
            } else {
                Err(StoreError::Elsewhere)
            };
        }
        self.owners.insert(place, owner);
        Ok(owner)
    }

    /// Forwards the request; retries once at the new owner.
    async fn forward(
        &self,
        app: &App,
        request: Request,
        client: Client,
        target: Target,
        to: &Other,
    ) -> Result<Routed, ApiError> {
        self.forwarded.increment(1);
        let (mut parts, body) = request.into_parts();
        let is_small =
            body.size_hint().upper().is_some_and(|most| most <= LIGHT_BODY_BYTES_MAX as u64);
        if !is_small {
            let limits = &app.limits;
            let path = parts.uri.path();
            let (name, most) = if path == "/swarm/act" {
                ("swarm_body_bytes_max", limits.swarm_body_bytes_max)
            } else {
                ("body_bytes_max", limits.body_bytes_max)
            };
            if body.size_hint().lower() > most as u64 {
                // No server accepts this body. The refusal of another server may get lost with the connection, which it closes
                // without reading the body.
                return if is_of_a_player(path) {
                    Err(too_large(name, most))
                } else {
                    Ok(Routed::Here(Request::from_parts(parts, body)))
                };
            }
            // The body is streamed, so the request cannot be sent again.
            let question = Question::of(&mut parts, Bytes::new());
            return match self.send(&question, Some(body), client, to).await {
                Ok(response) if !is_elsewhere(&response) => Ok(Routed::Answered(response)),
                Ok(_) | Err(Failed::NotSent) => {
                    self.forget(target);
                    Err(moved())
                }
                Err(Failed::Unknown) => Err(unknown()),
            };
        }
        let bytes = app.bodies.light(&parts.headers, body).await?.into_bytes();
        let question = Question::of(&mut parts, bytes);
        let may_repeat = question.is_repeatable();
        let answered = if question.may_wait() {
            tokio::select! {
                answered = self.send(&question, None, client, to) => answered,
                // A stopping server ends all long polls.
                () = app.stop.cancelled() => {
                    self.send(&question.without_wait(), None, client, to).await
                }
            }
        } else {
            self.send(&question, None, client, to).await
        };
        match answered {
            Ok(response) if !is_elsewhere(&response) => return Ok(Routed::Answered(response)),
            Err(Failed::Unknown) if !may_repeat => {
                self.forget(target);
                return Err(unknown());
            }
            Ok(_) | Err(_) => {}
        }
        metrics::counter!("swarmbench_forwarded_again_total").increment(1);
        match self.located_again(target, to.incarnation, answered.is_err()).await? {
            Location::Here => {
                parts.headers = question.headers;
                Ok(Routed::Here(Request::from_parts(parts, Body::from(question.body))))
            }
            Location::At(next) => match self.send(&question, None, client, &next).await {
                Ok(response) if !is_elsewhere(&response) => Ok(Routed::Answered(response)),
                Err(Failed::Unknown) if !may_repeat => Err(unknown()),
                Ok(_) | Err(_) => {
                    self.forget(target);
                    Err(moved())
                }
            },
        }
    }

    /// Locates the server that answers a request after another one did not: waits for a takeover, up to [`MOVE_PATIENCE`].
    async fn located_again(
        &self,
        target: Target,
        before: i64,
        is_away: bool,
    ) -> Result<Location, ApiError> {
        let until = Instant::now() + MOVE_PATIENCE;
        loop {
            self.forget(target);
            if is_away {
                let members = self.cluster.members();
                if let Some(member) = members.iter().find(|member| member.incarnation == before)
                    && crate::fleet::is_dead(&self.cluster, member).await
                {
                    // Exclusion frees the places of the dead server at once.
                    crate::fleet::take_over(&self.cluster, member.incarnation).await?;
                }
            }
            match self.locate(target).await {
                Ok(Location::At(other)) if other.incarnation == before && is_away => {}
                Ok(location) => return Ok(location),
                Err(StoreError::Elsewhere) => {}
                Err(error) => return Err(error.into()),
            }
            if Instant::now() >= until {
                return Err(moved());
            }
            tokio::time::sleep(MOVE_PAUSE).await;
        }
    }

    fn forget(&self, target: Target) {
        if let Target::Place(place) = target {
            self.owners.remove(&place);
        }
    }

    /// Sends a request to the owner; `body` replaces the body of the question. A stopped or unreachable server is waited for until
    /// the cluster has excluded it.
    async fn send(
        &self,
        question: &Question,
        body: Option<Body>,
        client: Client,
        to: &Other,
    ) -> Result<Response, Failed> {
        let gone = || self.cluster.gone(to.incarnation);
        self.links.send(question, body, client, to, gone).await
    }
}

/// Ends an event stream when this server stops.
fn until_stop(stop: &CancellationToken, response: Response) -> Response {
    if !is_event_stream(&response) {
        return response;
    }
    let stop = stop.clone().cancelled_owned();
    response.map(|body| Body::from_stream(body.into_data_stream().take_until(stop)))
}

/// A different number at each call.
fn drawn() -> u64 {
    static DRAWN: AtomicU64 = AtomicU64::new(0);
    DRAWN.fetch_add(1, Ordering::Relaxed)
}

fn is_elsewhere(response: &Response) -> bool {
    response.status() == StatusCode::MISDIRECTED_REQUEST
        && response.headers().contains_key(ELSEWHERE)
}

/// Answer to a forwarded request about a place that this server does not own.
pub(super) fn elsewhere() -> Response {
    let mut response = StatusCode::MISDIRECTED_REQUEST.into_response();
    response.headers_mut().insert(ELSEWHERE, HeaderValue::from_static("1"));
    response
}

fn moved() -> ApiError {
    StoreError::Elsewhere.into()
}

fn unknown() -> ApiError {
    let detail = "the server that plays this has gone while it answered: whether the request was done is not known. Look first, then \
                  send it again if it was not";
    ApiError::new(Code::Unavailable, detail).retry_after(Duration::from_secs(1))
}
