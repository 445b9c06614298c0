//! Routing within a cluster: which server answers a request, and how the other servers forward it.
//!
//! Clients may send any request to any server. The owner of a place answers requests about what is played there; every other
//! server forwards the request unchanged, and streams the answer back. Any server reads finished games, lists and boards from the
//! database.

mod credential;
mod links;
mod peers;
mod target;

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody as _};
use axum::extract::Request;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use futures::StreamExt as _;
use metrics::Counter;
use quick_cache::sync::Cache;
use tokio_util::sync::CancellationToken;

use super::auth;
use super::body::{Arrived, LIGHT_BODY_BYTES_MAX, too_large};
use super::client::Client;
use super::feed::is_event_stream;
use super::prelude::*;
use super::routes::{Facts, Play};
use crate::cluster::route::{Driver, End, Owner, Route, Sender, Sent, Target, View, follow};
use crate::cluster::{Incarnation, preferred};
use crate::ids::{CompetitionKey, EpisodeId, Place, RoutingName, RunKey};
use crate::membership;
use crate::store::{Cluster, Store, StoreError};
use links::{Failed, Links, Question};
pub use peers::ForwardingPeers;
pub(super) use peers::PATH;

/// Capacity of the caches of owners and of games; those of runs and competitions are smaller.
const ROUTES_CACHED: usize = 100_000;

/// Capacity of the cache of other servers' names, which include servers that are gone.
const ROUTING_NAMES_CACHED: usize = 1000;

/// Header of an answer: this server does not own the place of the forwarded request.
const ELSEWHERE: HeaderName = HeaderName::from_static("x-swarmbench-elsewhere");

/// Extension of an answer: another server owns the place.
#[derive(Clone, Copy)]
pub(super) struct IsElsewhere;

/// One server's view of its cluster: owners of places, and connections to the other servers.
pub struct Forwarder {
    cluster: Arc<Cluster>,
    store: Store,
    links: Links,
    routing_name: Option<RoutingName>,
    /// Names of other servers.
    routing_names: Cache<Incarnation, Option<RoutingName>>,
    started: Instant,
    forwarded: Counter,
    players: Routes,
    others: Routes,
    owners: Cache<Place, Owner>,
    games: Cache<EpisodeId, Place>,
    runs: Cache<String, RunKey>,
    competitions: Cache<String, CompetitionKey>,
}

/// Counters of clients' requests by the server that answers them.
struct Routes {
    here: Counter,
    forwarded: Counter,
}

impl Routes {
    fn of(kind: &'static str) -> Self {
        let of = |answered| {
            let labels = [("kind", kind), ("answered", answered)];
            metrics::counter!("swarmbench_cluster_requests_total", &labels)
        };
        Self { here: of("here"), forwarded: of("forwarded") }
    }
}

/// Another server of the cluster.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Other {
    incarnation: Incarnation,
    address: String,
}

/// Outcome of routing a request.
pub(super) enum Routed {
    /// This server handles the request.
    Here(Request),
    Answered(Response),
}

impl Forwarder {
    /// `store` is the database that the cluster shares.
    pub fn new(
        store: Store,
        cluster: Arc<Cluster>,
        secret: &[u8],
        routing_name: Option<RoutingName>,
    ) -> Self {
        let links = Links::new(cluster.incarnation(), secret);
        Self {
            cluster,
            store,
            links,
            routing_name,
            routing_names: Cache::new(ROUTING_NAMES_CACHED),
            started: Instant::now(),
            forwarded: metrics::counter!("swarmbench_forwarded_total"),
            players: Routes::of("player"),
            others: Routes::of("other"),
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
        if !self.cluster.answers_for().is_zero() {
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
        facts: Facts,
        client: Client,
        is_hop: bool,
    ) -> Result<Routed, ApiError> {
        let (parts, body) = request.into_parts();
        let target = self.target(app, facts.at, parts.uri.path(), &parts.headers);
        let mut target = Box::pin(target).await?;
        let is_small = is_small(&body);
        if target != Target::Anybody && !is_small {
            target = accepted(app, facts.play, &body, target)?;
        }
        let sender = if is_hop {
            Sender::Server
        } else {
            Sender::Client { is_repeatable: facts.is_repeatable, may_resend: is_small }
        };
        let counted = if facts.play.is_some() { &self.players } else { &self.others };
        let outgoing = Outgoing::Whole(parts, body);
        let sending = Forwarding { origin: Origin { app, facts, client }, outgoing, answer: None };
        let mut way = Way { forwarder: self, sending };
        let end = follow(Route::new(target, sender), &mut way).await?;
        match end {
            End::Here if !is_hop && target != Target::Anybody => counted.here.increment(1),
            End::Answered => {
                counted.forwarded.increment(1);
                self.forwarded.increment(1);
            }
            _ => {}
        }
        way.sending.ended(end)
    }

    /// Name of this server for load balancers.
    pub(super) const fn routing_name(&self) -> Option<RoutingName> {
        self.routing_name
    }

    /// Address of another server; `None` once it is gone.
    fn other(&self, incarnation: Incarnation) -> Option<Other> {
        let servers = self.cluster.servers();
        let row = servers.iter().find(|row| row.incarnation == incarnation)?;
        Some(Other { incarnation, address: row.address.clone() })
    }

    /// Sends a client's request, whose wait ends when this server stops.
    async fn ask(
        &self,
        question: &Question,
        Origin { app, facts, client }: Origin<'_>,
        to: &Other,
    ) -> Result<Response, Failed> {
        let at_stop = if facts.waits { question.without_wait() } else { None };
        let Some(at_stop) = at_stop else { return self.send(question, None, client, to).await };
        tokio::select! {
            answered = self.send(question, None, client, to) => answered,
            () = app.stop.cancelled() => self.send(&at_stop, None, client, to).await,
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

impl View for Forwarder {
    fn me(&self) -> Incarnation {
        self.cluster.incarnation()
    }

    fn takes_places(&self) -> bool {
        self.cluster.takes_places()
    }

    fn has(&self, place: Place) -> bool {
        self.cluster.places().has(place)
    }

    fn is_in_cluster(&self, server: Incarnation) -> bool {
        self.cluster.servers().iter().any(|row| row.incarnation == server)
    }

    fn preferred(&self, number: u64) -> Option<Incarnation> {
        preferred(&self.cluster.servers(), number)
    }

    fn known_owner(&self, place: Place) -> Option<Owner> {
        self.owners.get(&place)
    }

    fn note_owner(&self, place: Place, owner: Owner) {
        self.owners.insert(place, owner);
    }

    fn forget_owner(&self, place: Place) {
        self.owners.remove(&place);
    }
}

/// A request on its way: the database of the cluster, and how the request is sent.
struct Way<'a, T> {
    forwarder: &'a Forwarder,
    sending: T,
}

/// A request that can be sent to another server.
trait Sending: Send {
    type Error: From<StoreError>;

    fn send(
        &mut self,
        forwarder: &Forwarder,
        to: &Other,
    ) -> impl Future<Output = Result<Sent, Self::Error>> + Send;
}

impl<T: Sending> Driver for Way<'_, T> {
    type View = Forwarder;
    type Error = T::Error;

    fn view(&self) -> &Forwarder {
        self.forwarder
    }

    fn now(&self) -> Duration {
        self.forwarder.started.elapsed()
    }

    async fn owner(&mut self, place: Place) -> Result<Option<Incarnation>, T::Error> {
        Ok(self.forwarder.cluster.owner(place).await?)
    }

    async fn is_unfinished(&mut self, place: Place) -> Result<bool, T::Error> {
        Ok(self.forwarder.cluster.is_unfinished(place).await?)
    }

    async fn take(&mut self, place: Place) -> Result<Option<Incarnation>, T::Error> {
        let owners = self.forwarder.cluster.take(&[place]).await?;
        Ok(owners.first().map(|(_, owner)| *owner))
    }

    async fn send(&mut self, to: Incarnation) -> Result<Sent, T::Error> {
        match self.forwarder.other(to) {
            Some(other) => self.sending.send(self.forwarder, &other).await,
            None => Ok(Sent::NotSent),
        }
    }

    async fn exclude_if_dead(&mut self, server: Incarnation) -> Result<(), T::Error> {
        Ok(membership::exclude_if_dead(&*self.forwarder.cluster, server).await?)
    }

    async fn pause(&mut self, pause: Duration) {
        tokio::time::sleep(pause).await;
    }
}

/// Context of a client's request.
#[derive(Clone, Copy)]
struct Origin<'a> {
    app: &'a App,
    facts: Facts,
    client: Client,
}

/// A client's request.
struct Forwarding<'a> {
    origin: Origin<'a>,
    outgoing: Outgoing,
    answer: Option<Response>,
}

/// Part of a request that is left to send.
#[expect(clippy::large_enum_variant, reason = "most requests are whole, and are sent once")]
enum Outgoing {
    /// Whole request, not sent yet.
    Whole(Parts, Body),
    /// Whole request, kept for a second attempt.
    Small(Box<Small>),
    /// Nothing is left, as the body was streamed.
    Streamed,
}

/// A request whose body is small enough to be kept.
struct Small {
    /// Parts of the request without headers: those are in `question`.
    parts: Parts,
    question: Question,
    /// The reservation of the body's memory.
    _body: Arrived,
}

impl Forwarding<'_> {
    fn ended(self, end: End) -> Result<Routed, ApiError> {
        match (end, self.outgoing) {
            (End::Here, Outgoing::Whole(parts, body)) => {
                Ok(Routed::Here(Request::from_parts(parts, body)))
            }
            (End::Here, Outgoing::Small(small)) => {
                let Small { mut parts, question, .. } = *small;
                parts.headers = question.headers;
                Ok(Routed::Here(Request::from_parts(parts, Body::from(question.body))))
            }
            (End::Answered, _) => {
                let response = self.answer.expect("the end of a request that was sent");
                Ok(Routed::Answered(until_stop(&self.origin.app.stop, response)))
            }
            (End::Elsewhere, _) => Ok(Routed::Answered(elsewhere())),
            (End::Unknown, _) => Err(unknown()),
            (End::Moved | End::Here, _) => Err(StoreError::Elsewhere.into()),
        }
    }
}

impl Sending for Forwarding<'_> {
    type Error = ApiError;

    async fn send(&mut self, forwarder: &Forwarder, to: &Other) -> Result<Sent, ApiError> {
        let answered = match std::mem::replace(&mut self.outgoing, Outgoing::Streamed) {
            Outgoing::Whole(mut parts, body) if !is_small(&body) => {
                let question = Question::of(&mut parts, Bytes::new());
                forwarder.send(&question, Some(body), self.origin.client, to).await
            }
            Outgoing::Whole(mut parts, body) => {
                let app = self.origin.app;
                let has_token = auth::has_token(app, &parts.headers).await?;
                let body = app.bodies.light(has_token, body).await?;
                let question = Question::of(&mut parts, body.bytes());
                let answered = forwarder.ask(&question, self.origin, to).await;
                self.outgoing = Outgoing::Small(Box::new(Small { parts, question, _body: body }));
                answered
            }
            Outgoing::Small(small) => {
                metrics::counter!("swarmbench_forwarded_again_total").increment(1);
                let answered = forwarder.ask(&small.question, self.origin, to).await;
                self.outgoing = Outgoing::Small(small);
                answered
            }
            Outgoing::Streamed => return Ok(Sent::NotSent),
        };
        Ok(match answered {
            Ok(response) if is_elsewhere(&response) => Sent::Elsewhere,
            Ok(response) => {
                self.answer = Some(response);
                Sent::Answered
            }
            Err(Failed::NotSent) => Sent::NotSent,
            Err(Failed::Unknown) => Sent::Unknown,
        })
    }
}

/// A small body is kept, and can be sent again.
fn is_small(body: &Body) -> bool {
    body.size_hint().upper().is_some_and(|most| most <= LIGHT_BODY_BYTES_MAX as u64)
}

/// Target of a request whose body may be one that no server accepts: this server refuses it, as the refusal of another server may
/// get lost with the connection, which it closes without reading the body.
fn accepted(
    app: &App,
    play: Option<Play>,
    body: &Body,
    target: Target,
) -> Result<Target, ApiError> {
    let limits = &app.limits;
    let (name, most) = if play == Some(Play::SwarmAct) {
        ("swarm_body_bytes_max", limits.swarm_body_bytes_max)
    } else {
        ("body_bytes_max", limits.body_bytes_max)
    };
    match body.size_hint().lower() > most as u64 {
        true if play.is_some() => Err(too_large(name, most)),
        true => Ok(Target::Anybody),
        false => Ok(target),
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

fn unknown() -> ApiError {
    let detail = "the server that plays this has gone while it answered: whether the request was done is not known. Look first, then \
                  send it again if it was not";
    ApiError::new(Code::Unavailable, detail).retry_after(Duration::from_secs(1))
}
