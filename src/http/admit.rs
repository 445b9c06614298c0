//! What happens to every request first: its client is found out and counted, and the request gets its rank.

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderValue, Method, Version, header};
use axum::middleware::Next;
use axum::response::Response;

use super::App;
use super::body::is_light;
use super::client::{Client, Peer};
use super::error::{ApiError, Code};
use super::in_flight::RequestContext;
use crate::fair::{Origin, Rank};

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

/// Finds out the client of a request, and counts the request.
pub(super) async fn admit(
    State(app): State<App>,
    mut request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let peer = request.extensions().get::<Peer>().map(|Peer(peer)| *peer);
    let peer = peer.ok_or_else(|| ApiError::new(Code::Internal, "the peer is not known"))?;
    let trusted = &app.access.trusted_proxies;
    let client = Client::of(peer, request.headers(), request.uri(), trusted);
    app.rates.check_address(client.address)?;
    request.extensions_mut().insert(client);
    let in_flight = app.in_flight.take(client.address)?;
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

/// The rank of a request: playing, entering and changing come first, reading comes after them.
fn rank(method: &Method, path: &str) -> Rank {
    match path {
        _ if method != Method::GET && method != Method::HEAD => Rank::Urgent,
        "/obs" | "/swarm/obs" | "/healthz" | "/readyz" | "/metrics" => Rank::Urgent,
        _ => Rank::Normal,
    }
}
