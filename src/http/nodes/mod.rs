//! Several servers on one database: which of them answers a request, and how the others pass it on.
//!
//! Every request may be sent to any server. What is being played is answered by the server that plays it: another one forwards
//! the request as it is, and the answer as it comes. What is over, and lists and boards, any server reads from the database.

mod credential;
pub(super) mod list;
mod peers;
mod target;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody as _, to_bytes};
use axum::extract::Request;
use axum::http::uri::{Authority, Scheme};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse as _, Response};
use bytes::Bytes;
use futures::{StreamExt as _, stream};
use hyper::body::Incoming;
use hyper_util::client::legacy::Client as HttpClient;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use quick_cache::sync::Cache;
use tokio_util::sync::CancellationToken;

use super::body::LIGHT_BODY_BYTES_MAX;
use super::client::Client;
use super::prelude::*;
use crate::ids::{CompetitionKey, EpisodeId, Place, RunKey};
use crate::store::{Cluster, Store, StoreError};
use credential::Secret;
pub use peers::NodePeers;
pub(super) use peers::PATH;
use target::Target;

/// Places and ids of which is remembered who plays them.
const ROUTES_CACHED: usize = 100_000;

/// How long another server may take to accept a connection.
const CONNECT_PATIENCE: Duration = Duration::from_millis(500);

/// After how long a connection to another server that is silent is asked for a sign of life, and how often in vain.
const KEEPALIVE: Duration = Duration::from_secs(2);
const KEEPALIVE_RETRIES: u32 = 3;

/// How long a request waits for another server to take what the last one had.
const MOVE_PATIENCE: Duration = Duration::from_millis(1500);

/// How often it looks meanwhile.
const MOVE_PAUSE: Duration = Duration::from_millis(25);

/// What a server sends with what it forwards: who it is, as only servers of the cluster can tell.
const HOP: HeaderName = HeaderName::from_static("x-swarmbench-hop");

/// The address of the client, and whether it is a program on the machine to which it sent its request.
const CLIENT: HeaderName = HeaderName::from_static("x-swarmbench-client");

/// In the answer of a server that does not play what a forwarded request is about.
const ELSEWHERE: HeaderName = HeaderName::from_static("x-swarmbench-elsewhere");

/// Headers of one connection, which are not passed on.
const OF_A_CONNECTION: [HeaderName; 7] = [
    header::CONNECTION,
    HeaderName::from_static("keep-alive"),
    header::PROXY_AUTHENTICATE,
    header::PROXY_AUTHORIZATION,
    header::TE,
    header::TRANSFER_ENCODING,
    header::UPGRADE,
];

/// In the extensions of an answer that says that another server plays it.
#[derive(Clone, Copy)]
pub(super) struct IsElsewhere;

/// The servers of a database, as one of them sees the others.
pub struct Nodes {
    cluster: Arc<Cluster>,
    store: Store,
    secret: Secret,
    http: HttpClient<HttpConnector, Body>,
    /// Who plays at a place; [`ANYBODY`] where all is over.
    owners: Cache<Place, i64>,
    games: Cache<EpisodeId, Place>,
    runs: Cache<String, RunKey>,
    competitions: Cache<String, CompetitionKey>,
}

/// In the place of an owner: everything there is over, so that any server answers from the database.
const ANYBODY: i64 = 0;

/// Who answers a request.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Location {
    Here,
    At(Other),
}

/// Another server.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Other {
    incarnation: i64,
    address: String,
}

/// What becomes of a request.
pub(super) enum Routed {
    /// This server answers it.
    Here(Request),
    Answered(Response),
}

/// Why a request was not answered by the server to which it was forwarded.
enum Failed {
    /// It has not arrived there.
    NotSent,
    /// It may have been done, or not.
    Unknown,
}

impl Nodes {
    /// The servers with a secret in common; `store` is the database that they share.
    pub fn new(store: Store, cluster: Arc<Cluster>, secret: &[u8]) -> Self {
        let mut connector = HttpConnector::new();
        connector.set_nodelay(true);
        connector.set_connect_timeout(Some(CONNECT_PATIENCE));
        // Where packets are lost between two servers that both reach the database, nobody else ends the connection.
        connector.set_keepalive(Some(KEEPALIVE));
        connector.set_keepalive_interval(Some(KEEPALIVE));
        connector.set_keepalive_retries(Some(KEEPALIVE_RETRIES));
        #[cfg(target_os = "linux")]
        connector.set_tcp_user_timeout(Some(KEEPALIVE * (KEEPALIVE_RETRIES + 1)));
        let http = HttpClient::builder(TokioExecutor::new())
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(Duration::from_secs(30))
            .retry_canceled_requests(true)
            .build(connector);
        Self {
            cluster,
            store,
            secret: Secret::new(secret),
            http,
            owners: Cache::new(ROUTES_CACHED),
            games: Cache::new(ROUTES_CACHED),
            runs: Cache::new(ROUTES_CACHED / 10),
            competitions: Cache::new(ROUTES_CACHED / 100),
        }
    }

    /// The client of a request that another server has forwarded, or asks itself. An error where it is of no server; `None` where
    /// it is for the server that was at this address before.
    pub(super) fn client_of_hop(&self, headers: &HeaderMap) -> Result<Option<Client>, ApiError> {
        let refuse = || {
            let detail = "this address is for the other servers of the cluster, and the request is of none of them: send it to the \
                          public address. A server that sees this has another --cluster-secret-file";
            ApiError::new(Code::Forbidden, detail)
        };
        let hop = headers.get(HOP).and_then(|value| value.to_str().ok()).ok_or_else(refuse)?;
        if self.secret.recipient(hop).ok_or_else(refuse)? != self.cluster.incarnation() {
            return Ok(None);
        }
        let client =
            headers.get(CLIENT).and_then(|value| value.to_str().ok()).ok_or_else(refuse)?;
        let (address, is_local) = client.split_once(' ').ok_or_else(refuse)?;
        let address = address.parse().map_err(|_| refuse())?;
        Ok(Some(Client { address, is_local: is_local == "local" }))
    }

    /// Refuses to answer for what this server plays where the database may have been told that it is dead.
    pub(super) fn check_may_answer(&self) -> Result<(), ApiError> {
        if self.cluster.may_answer() {
            return Ok(());
        }
        let detail = "this server does not reach the database, so another one may have taken its games over; the same request works \
                      there, or here once the database is back";
        Err(ApiError::new(Code::Unavailable, detail).retry_after(Duration::from_secs(1)))
    }

    /// Finds out who answers a request, and lets another server answer it where that plays what it is about.
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
                let routed = self.forward(&app.stop, request, client, target, &other).await?;
                Ok(match routed {
                    Routed::Answered(response) => Routed::Answered(until_stop(&app.stop, response)),
                    here @ Routed::Here(_) => here,
                })
            }
        }
    }

    /// Whether this server plays at a place, or takes it now as nobody does.
    async fn takes(&self, place: Place) -> Result<bool, StoreError> {
        if self.cluster.has(place) || !self.cluster.is_unfinished(place).await? {
            return Ok(true);
        }
        self.store.take_place(place).await
    }

    /// Where a request is answered.
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
        // It has joined at this moment, or is gone.
        Err(StoreError::Elsewhere)
    }

    /// Who makes something new; an error where nobody takes work at this moment.
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
                    // It takes the place when it is asked.
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
            // A commit whose answer was lost has taken it; or it is being given up.
            return if self.store.take_place(place).await? {
                Ok(me)
            } else {
                Err(StoreError::Elsewhere)
            };
        }
        self.owners.insert(place, owner);
        Ok(owner)
    }

    /// Lets another server answer, and the next one that plays it where that does not: once.
    async fn forward(
        &self,
        stop: &CancellationToken,
        request: Request,
        client: Client,
        target: Target,
        to: &Other,
    ) -> Result<Routed, ApiError> {
        metrics::counter!("swarmbench_forwarded_total").increment(1);
        let (parts, body) = request.into_parts();
        let is_small =
            body.size_hint().upper().is_some_and(|most| most <= LIGHT_BODY_BYTES_MAX as u64);
        if !is_small {
            // It is passed on as it comes, so it cannot be sent again.
            let head = request_to(&Request::from_parts(parts, Body::empty()), Bytes::new());
            return match self.send(&head, Some(body), client, to).await {
                Ok(response) if !is_elsewhere(&response) => Ok(Routed::Answered(response)),
                Ok(_) | Err(Failed::NotSent) => {
                    self.forget(target);
                    Err(moved())
                }
                Err(Failed::Unknown) => Err(unknown()),
            };
        }
        let bytes = to_bytes(body, LIGHT_BODY_BYTES_MAX).await.map_err(|error| {
            ApiError::new(Code::Malformed, format!("the body has not arrived: {error}"))
        })?;
        let request = Request::from_parts(parts, Body::empty());
        let sent = request_to(&request, bytes.clone());
        let may_repeat = is_repeatable(&request);
        let answered = match without_wait(&sent) {
            None => self.send(&sent, None, client, to).await,
            Some(at_once) => tokio::select! {
                answered = self.send(&sent, None, client, to) => answered,
                // A server that stops lets nobody wait.
                () = stop.cancelled() => self.send(&at_once, None, client, to).await,
            },
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
            Location::Here => Ok(Routed::Here(with_body(request, bytes))),
            Location::At(next) => match self.send(&sent, None, client, &next).await {
                Ok(response) if !is_elsewhere(&response) => Ok(Routed::Answered(response)),
                Err(Failed::Unknown) if !may_repeat => Err(unknown()),
                Ok(_) | Err(_) => {
                    self.forget(target);
                    Err(moved())
                }
            },
        }
    }

    /// Where a request is answered now that a server has not answered it: waits for another to take what that had.
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
                    // What it had is free from now on.
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

    /// Sends a request to the server that plays what it is about, with this body in the place of its own where there is one. One
    /// that is stopped, or cut off, is waited for until the others have taken over what it had.
    async fn send(
        &self,
        request: &hyper::Request<Bytes>,
        body: Option<Body>,
        client: Client,
        to: &Other,
    ) -> Result<Response, Failed> {
        let gone = self.cluster.gone(to.incarnation);
        tokio::select! {
            answered = self.send_now(request, body, client, to) => answered,
            () = gone => Err(Failed::Unknown),
        }
    }

    async fn send_now(
        &self,
        request: &hyper::Request<Bytes>,
        body: Option<Body>,
        client: Client,
        to: &Other,
    ) -> Result<Response, Failed> {
        let Other { incarnation, address } = to;
        let authority: Authority = address.parse().map_err(|_| Failed::NotSent)?;
        let path = request.uri().path_and_query().cloned();
        let uri = Uri::builder().scheme(Scheme::HTTP).authority(authority);
        let uri = uri.path_and_query(path.map_or_else(|| "/".to_owned(), |path| path.to_string()));
        let mut sent =
            hyper::Request::new(body.unwrap_or_else(|| Body::from(request.body().clone())));
        *sent.method_mut() = request.method().clone();
        *sent.uri_mut() = uri.build().map_err(|_| Failed::NotSent)?;
        let headers = sent.headers_mut();
        *headers = request.headers().clone();
        remove_of_connection(headers);
        headers.remove(header::EXPECT);
        let credential = self.secret.credential(self.cluster.incarnation(), *incarnation);
        headers.insert(HOP, HeaderValue::try_from(credential).expect("digits"));
        let shown =
            format!("{} {}", client.address, if client.is_local { "local" } else { "remote" });
        headers.insert(CLIENT, HeaderValue::try_from(shown).expect("an address"));
        match self.http.request(sent).await {
            Ok(response) => {
                let gone = self.cluster.gone(*incarnation);
                let mut response = response.map(|body| until_gone(gone, body));
                let headers = response.headers_mut();
                remove_of_connection(headers);
                Ok(response)
            }
            Err(error) if error.is_connect() => Err(Failed::NotSent),
            Err(error) => {
                tracing::debug!(%error, to = address, "a request was forwarded and not answered");
                Err(Failed::Unknown)
            }
        }
    }
}

/// The same request without its wait, if it may wait.
fn without_wait(request: &hyper::Request<Bytes>) -> Option<hyper::Request<Bytes>> {
    let uri = request.uri();
    let may_wait = matches!(uri.path(), "/obs" | "/act" | "/swarm/obs" | "/swarm/act");
    let query = uri.query().filter(|_| may_wait)?;
    let is_wait = |part: &&str| part.split('=').next() == Some("wait");
    query.split('&').find(is_wait)?;
    let rest: Vec<&str> = query.split('&').filter(|part| !is_wait(part)).collect();
    let mut at_once = request.clone();
    *at_once.uri_mut() = format!("{}?{}", uri.path(), rest.join("&")).parse().ok()?;
    Some(at_once)
}

/// The body of an answer of another server. It breaks off when that server is gone.
fn until_gone(gone: impl Future<Output = ()> + Send + 'static, body: Incoming) -> Body {
    if body.is_end_stream()
        || body.size_hint().exact().is_some_and(|bytes| bytes <= LIGHT_BODY_BYTES_MAX as u64)
    {
        return Body::new(body);
    }
    let parts = Body::new(body).into_data_stream();
    let parts = stream::unfold(Some((parts, Box::pin(gone))), async |state| {
        let (mut parts, mut gone) = state?;
        tokio::select! {
            biased;
            part = parts.next() => Some((part?, Some((parts, gone)))),
            () = &mut gone => Some((Err(axum::Error::new("the server that sent it is gone")), None)),
        }
    });
    Body::from_stream(parts)
}

fn is_event_stream(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    kind.is_some_and(|kind| kind.as_bytes().starts_with(b"text/event-stream"))
}

/// Ends a stream of events when this server stops.
fn until_stop(stop: &CancellationToken, response: Response) -> Response {
    if !is_event_stream(&response) {
        return response;
    }
    let stop = stop.clone().cancelled_owned();
    response.map(|body| Body::from_stream(body.into_data_stream().take_until(stop)))
}

/// Another number each time.
fn drawn() -> u64 {
    static DRAWN: AtomicU64 = AtomicU64::new(0);
    DRAWN.fetch_add(1, Ordering::Relaxed)
}

fn remove_of_connection(headers: &mut HeaderMap) {
    for name in &OF_A_CONNECTION {
        headers.remove(name);
    }
}

/// What is sent of a request, with its body.
fn request_to(request: &Request, body: Bytes) -> hyper::Request<Bytes> {
    let mut sent = hyper::Request::new(body);
    *sent.method_mut() = request.method().clone();
    *sent.uri_mut() = request.uri().clone();
    *sent.headers_mut() = request.headers().clone();
    sent
}

fn with_body(request: Request, bytes: Bytes) -> Request {
    request.map(|_| Body::from(bytes))
}

/// Whether a request may be sent twice: it only reads, or it is an act, which is the same act again.
fn is_repeatable(request: &Request) -> bool {
    let method = request.method();
    method == Method::GET
        || method == Method::HEAD
        || matches!(request.uri().path(), "/act" | "/swarm/act")
}

fn is_elsewhere(response: &Response) -> bool {
    response.status() == StatusCode::MISDIRECTED_REQUEST
        && response.headers().contains_key(ELSEWHERE)
}

/// The answer to a forwarded request about what this server does not play.
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
