//! Everything that a request passes before its handler, and its answer after it: the request's id and log lines, its client and
//! the limits of one client, its rank, the metrics, and the headers that all answers have.
//!
//! The routes by which games are played are called from here, without the router: a game needs thousands of such requests, and the
//! router would cost more than most of them. The router has all other routes.

use std::any::Any;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{FromRequest, FromRequestParts, MatchedPath, Request};
use axum::http::header::X_CONTENT_TYPE_OPTIONS;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use futures::FutureExt;
use metrics::{Counter, Histogram};
use tower::Service;
use tracing::{Instrument, Level, Span};

use super::admit::check_host;
use super::auth::{Swarm, TokenSeat};
use super::body::is_light;
use super::client::{Client, Peer, check_site};
use super::error::{ApiError, Code};
use super::forward::{self, Routed};
use super::in_flight::RequestContext;
use super::prelude::*;
use super::revoked::SentToken;
use super::routes::{At, Facts, PLAYS, Play};
use super::serve::Counted;
use super::{agent, router, swarm};
use crate::fair::Origin;

pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
const NOSNIFF: HeaderValue = HeaderValue::from_static("nosniff");

/// The whole HTTP service. Clones share it.
#[derive(Clone)]
pub struct Front {
    inner: Arc<Inner>,
    /// Only the other servers of the cluster use it.
    is_for_servers: bool,
}

struct Inner {
    app: App,
    router: Router,
    /// Number of requests so far. A request's id is the run of the server and this number: a random id would ask the host for
    /// randomness with every request.
    requests: AtomicU64,
    plays: [Meter; PLAYS.len()],
}

/// An answer, and the context that lives until it is sent.
pub(super) struct Answered {
    pub(super) response: Response,
    /// `None` if the request was refused before it was counted.
    pub(super) context: Option<RequestContext>,
}

impl Front {
    pub fn new(app: App) -> Self {
        let router = router::router(app.clone());
        let meter = |place: usize| Meter::new(PLAYS[place].path, PLAYS[place].method);
        let plays = std::array::from_fn(meter);
        let inner = Arc::new(Inner { app, router, requests: AtomicU64::new(0), plays });
        Self { inner, is_for_servers: false }
    }

    /// The same service, for the other servers of a cluster.
    #[must_use]
    pub fn for_servers(&self) -> Self {
        Self { inner: Arc::clone(&self.inner), is_for_servers: true }
    }

    /// Answers a request of a connection from `peer`.
    pub(super) async fn answer(
        &self,
        mut request: Request,
        peer: Peer,
        connection: Arc<Counted>,
    ) -> Answered {
        let started = Instant::now();
        let name = RequestName::of(&request, self.id_of(&request));
        if self.inner.app.forwarder.is_some() {
            // Another server may answer the request, under the same id.
            request.headers_mut().insert(REQUEST_ID, name.id.clone());
        }
        let facts = Facts::of(request.method(), request.uri().path());
        // Playing requests write log lines at the level debug only, unless the server fails.
        let span = match facts.play {
            Some(_) if !tracing::enabled!(Level::DEBUG) => Span::none(),
            _ => name.span(),
        };
        let mut context = None;
        let admitted = self.admit(request, peer, connection, facts, &mut context);
        let answered = AssertUnwindSafe(admitted).catch_unwind().instrument(span.clone()).await;
        let mut response = match answered {
            Ok(Ok(response)) => response,
            Ok(Err(error)) => error.into_response(),
            Err(panic) => name.within(&span, || panicked(&*panic)),
        };
        self.measure(&name, &span, facts, &mut response, started.elapsed());
        let headers = response.headers_mut();
        headers.entry(X_CONTENT_TYPE_OPTIONS).or_insert(NOSNIFF);
        headers.insert(REQUEST_ID, name.id);
        Answered { response, context }
    }

    /// Id that came with a request, or else a new one. An invalid id is neither logged nor sent on.
    pub(super) fn id_of(&self, request: &Request) -> HeaderValue {
        let Inner { app, requests, .. } = &*self.inner;
        request
            .headers()
            .get(REQUEST_ID)
            .filter(|id| {
                (1..=app.limits.name_chars_max).contains(&id.len())
                    && id.as_bytes().iter().all(u8::is_ascii_graphic)
            })
            .cloned()
            .unwrap_or_else(|| numbered(app.boot, requests.fetch_add(1, Ordering::Relaxed)))
    }

    /// Finds the client of a request, counts the request, and gives it its rank.
    async fn admit(
        &self,
        mut request: Request,
        Peer(peer): Peer,
        connection: Arc<Counted>,
        facts: Facts,
        context: &mut Option<RequestContext>,
    ) -> Result<Response, ApiError> {
        let Inner { app, .. } = &*self.inner;
        let (client, in_flight) = if self.is_for_servers {
            // The server that received the request has counted it.
            let forwarder = app.forwarder.as_deref();
            let refuse = || ApiError::not_found("a cluster");
            match forwarder.ok_or_else(refuse)?.client_of_hop(request.headers())? {
                Some(client) => (client, None),
                None => return Ok(forward::elsewhere()),
            }
        } else {
            let trusted = &app.access.trusted_proxies;
            let client = Client::of(peer, request.headers(), request.uri(), trusted);
            app.rates.check_address(client.address)?;
            (client, app.in_flight.take(client.address)?)
        };
        if facts.play.is_none() {
            request.extensions_mut().insert(client);
        }
        let is_of_a_server = self.is_for_servers && request.uri().path().starts_with(forward::PATH);
        let plays = facts.play.is_some() && is_light(&request);
        let may_run_here = is_of_a_server || plays || facts.is_about_health;
        let front = self.clone();
        // Large futures are boxed: each layer would move them, which costs more than everything else here.
        let answered =
            Box::pin(async move { (front.route(request, facts, client).await, Origin::current()) });
        let answered = connection.scope(facts.rank.scope(client.party().scope(answered)));
        let (response, origin) =
            if may_run_here { answered.await } else { app.workers.in_background(answered).await? };
        // The request counts until the body of its answer is sent; the body is made for the same party.
        *context = Some(RequestContext { origin, _in_flight: in_flight });
        response
    }

    async fn route(
        self,
        request: Request,
        facts: Facts,
        client: Client,
    ) -> Result<Response, ApiError> {
        if !self.is_for_servers {
            // The server that received the request has done these checks.
            check_host(&request)?;
            check_site(&request, &self.inner.app.access.hosts)?;
        }
        match self.inner.app.forwarder.as_deref() {
            None => self.handle(request, facts).await,
            // This branch has by far the larger future: a server without a cluster shall not reserve memory for it.
            Some(forwarder) => Box::pin(self.route_among(forwarder, request, facts, client)).await,
        }
    }

    /// Answers a request, or forwards it to another server of the cluster.
    async fn route_among(
        &self,
        forwarder: &forward::Forwarder,
        request: Request,
        facts: Facts,
        client: Client,
    ) -> Result<Response, ApiError> {
        let Inner { app, .. } = &*self.inner;
        if self.is_for_servers && request.uri().path().starts_with(forward::PATH) {
            return forwarder.answer(app, request).await;
        }
        if facts.at == At::Host {
            return self.handle(request, facts).await;
        }
        forwarder.check_may_answer()?;
        let response = match forwarder
            .route(app, request, facts, client, self.is_for_servers)
            .await?
        {
            Routed::Answered(response) => response,
            Routed::Here(request) => {
                if facts.play.is_none() {
                    // All reads from now on see the commits of other servers.
                    app.store.catch_up().await?;
                }
                let response =
                    self.handle(request, facts).await.unwrap_or_else(IntoResponse::into_response);
                // This process may have been stopped, and excluded meanwhile.
                forwarder.check_may_answer()?;
                response
            }
        };
        if self.is_for_servers && response.extensions().get::<forward::IsElsewhere>().is_some() {
            return Ok(forward::elsewhere());
        }
        Ok(response)
    }

    async fn handle(&self, request: Request, facts: Facts) -> Result<Response, ApiError> {
        let Inner { app, router, .. } = &*self.inner;
        // A look or an act waits by a parameter alone. Other requests may revoke the token with which they come.
        let may_wait = facts.waits && (facts.play.is_none() || request.uri().query().is_some());
        let sent = if may_wait { SentToken::of(app, &request) } else { None };
        let response = match facts.play {
            Some(play) => play.call(app, request).await?,
            None => match router.clone().call(request).await {
                Ok(response) => response,
                Err(never) => match never {},
            },
        };
        let response = match sent {
            Some(sent) => Box::pin(sent.check(app, response)).await?,
            None => response,
        };
        app.unsent.reserve(facts.is_repeatable, response).await
    }

    /// Counts and times a request by its route, and logs it.
    fn measure(
        &self,
        name: &RequestName,
        span: &Span,
        facts: Facts,
        response: &mut Response,
        taken: Duration,
    ) {
        let status = response.status();
        let path = response.extensions_mut().remove::<MatchedPath>();
        match facts.play {
            Some(play) => self.inner.plays[play as usize].note(status, taken),
            // Only known routes become labels: unknown paths would create unlimited series.
            None if status == StatusCode::METHOD_NOT_ALLOWED => {}
            None => {
                if let Some(path) = &path {
                    Meter::new(path.as_str(), known(&name.method)).note(status, taken);
                }
            }
        }
        let taken_us = micros(taken);
        // An answer that the server is not ready is no failure.
        if status.is_server_error() && !facts.is_about_health {
            let warn = || tracing::warn!(status = status.as_u16(), taken_us, "answered");
            name.within(span, warn);
        } else {
            let _entered = span.enter();
            tracing::debug!(status = status.as_u16(), taken_us, "answered");
        }
    }
}

/// Formats the id of a request: the run of the server in 16 hexadecimal digits, and the number of the request.
fn numbered(boot: u64, number: u64) -> HeaderValue {
    // A boot has 16 digits and a number up to 20. Formatting them by `format!` takes as long as finding the route.
    let mut id = [0; 16 + 1 + 20];
    for (place, digit) in id[..16].iter_mut().enumerate() {
        *digit = b"0123456789abcdef"[(boot >> (60 - 4 * place) & 15) as usize];
    }
    id[16] = b'-';
    let (mut rest, mut first) = (number, id.len());
    loop {
        first -= 1;
        id[first] = b"0123456789"[(rest % 10) as usize];
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    id.copy_within(first.., 17);
    HeaderValue::from_bytes(&id[..17 + id.len() - first]).expect("digits")
}

/// Maximum bytes of the method and of the path of a request in its log lines.
const LOGGED_BYTES_MAX: usize = 200;

/// Parts of a request in its log lines; never its headers or its query, which may hold tokens.
struct RequestName {
    id: HeaderValue,
    method: Method,
    uri: axum::http::Uri,
}

impl RequestName {
    fn of(request: &Request, id: HeaderValue) -> Self {
        Self { id, method: request.method().clone(), uri: request.uri().clone() }
    }

    fn span(&self) -> Span {
        let id = self.id.to_str().unwrap_or_default();
        let [method, path] = [self.method.as_str(), self.uri.path()]
            .map(|text| &text[..text.floor_char_boundary(LOGGED_BYTES_MAX)]);
        tracing::info_span!("request", id, %method, path)
    }

    /// Writes log lines within the span of the request, which is created here where it was not needed before.
    fn within<T>(&self, span: &Span, log: impl FnOnce() -> T) -> T {
        if span.is_none() { self.span().in_scope(log) } else { span.in_scope(log) }
    }
}

impl Play {
    async fn call(self, app: &App, request: Request) -> Result<Response, ApiError> {
        let state = State(app.clone());
        let (mut parts, body) = request.into_parts();
        match self {
            Self::Look => {
                let seat = TokenSeat::from_request_parts(&mut parts, app).await?;
                let params = Params::from_request_parts(&mut parts, app).await?;
                Box::pin(agent::obs::get_obs(state, seat, params)).await
            }
            Self::Act => {
                let seat = TokenSeat::from_request_parts(&mut parts, app).await?;
                let params = Params::from_request_parts(&mut parts, app).await?;
                let body = Json::from_request(Request::from_parts(parts, body), app).await?;
                Box::pin(agent::act::post_act(state, seat, params, body)).await
            }
            Self::SwarmLook => {
                let swarm = Swarm::from_request_parts(&mut parts, app).await?;
                let params = Params::from_request_parts(&mut parts, app).await?;
                Box::pin(swarm::obs::get_swarm_obs(state, swarm, params)).await
            }
            Self::SwarmAct => {
                let swarm = Swarm::from_request_parts(&mut parts, app).await?;
                let params = Params::from_request_parts(&mut parts, app).await?;
                let request = Request::from_parts(parts, body);
                Box::pin(swarm::act::post_swarm_act(state, swarm, params, request)).await
            }
        }
    }
}

/// Metrics of a route.
struct Meter {
    route: String,
    method: &'static str,
    seconds: Histogram,
    ok: Counter,
}

impl Meter {
    fn new(route: &str, method: &'static str) -> Self {
        let route = route.to_owned();
        let seconds =
            metrics::histogram!("swarmbench_http_request_seconds", "route" => route.clone());
        let ok = Self::requests(&route, method, StatusCode::OK);
        Self { route, method, seconds, ok }
    }

    fn requests(route: &str, method: &'static str, status: StatusCode) -> Counter {
        metrics::counter!(
            "swarmbench_http_requests_total",
            "route" => route.to_owned(), "method" => method, "status" => status.as_u16().to_string()
        )
    }

    fn note(&self, status: StatusCode, taken: Duration) {
        self.seconds.record(taken);
        if status == StatusCode::OK {
            self.ok.increment(1);
        } else {
            Self::requests(&self.route, self.method, status).increment(1);
        }
    }
}

/// Name of a method for labels; methods without a route are `other`.
fn known(method: &Method) -> &'static str {
    let all = [
        (Method::GET, "GET"),
        (Method::POST, "POST"),
        (Method::PATCH, "PATCH"),
        (Method::DELETE, "DELETE"),
    ];
    let found = all.into_iter().find(|(known, _)| known == method);
    found.map_or("other", |(_, name)| name)
}

fn micros(taken: Duration) -> u64 {
    u64::try_from(taken.as_micros()).unwrap_or(u64::MAX)
}

fn panicked(panic: &(dyn Any + Send)) -> Response {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
    tracing::error!(panic = text, "a handler panicked");
    let error = ApiError::new(Code::Internal, "the server has a fault; it was logged");
    (StatusCode::INTERNAL_SERVER_ERROR, error).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_named_by_the_run_and_their_number() {
        for (boot, number) in [(0, 0), (1, 9), (0xfedc_ba98_7654_3210, 10), (u64::MAX, u64::MAX)] {
            assert_eq!(numbered(boot, number), format!("{boot:016x}-{number}").as_str());
        }
    }
}
