//! Connections to the other servers: forwarded requests and their answers.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, HttpBody as _};
use axum::http::request::Parts;
use axum::http::uri::{Authority, PathAndQuery, Scheme};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Uri, header};
use axum::response::Response;
use bytes::Bytes;
use futures::{StreamExt as _, stream};
use hyper::body::Incoming;
use hyper_util::client::legacy::Client as HttpClient;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use quick_cache::sync::Cache;

use super::super::body::LIGHT_BODY_BYTES_MAX;
use super::super::client::Client;
use super::super::error::{ApiError, Code};
use super::Other;
use super::credential::Secret;

/// Timeout for another server to accept a connection.
const CONNECT_PATIENCE: Duration = Duration::from_millis(500);

/// Silence before a TCP keepalive probe, and the number of unanswered probes that ends a connection.
const KEEPALIVE: Duration = Duration::from_secs(2);
const KEEPALIVE_RETRIES: u32 = 3;

/// Idle time after which a connection is closed.
const UNUSED: Duration = Duration::from_secs(30);

/// Capacity of the caches of other servers, which include servers that are gone.
const PEERS_MAX: usize = 1000;

/// Header of a forwarded request: the credential of the server that forwards it.
const HOP: HeaderName = HeaderName::from_static("x-swarmbench-hop");

/// Header of a forwarded request: the client's address, and whether it is a program on the machine to which it sent the request.
const CLIENT: HeaderName = HeaderName::from_static("x-swarmbench-client");

/// Client of requests that a server makes for itself.
pub(super) const OF_A_SERVER: Client =
    Client { address: IpAddr::V4(Ipv4Addr::LOCALHOST), is_local: false };

/// Hop-by-hop headers, which are not forwarded.
const OF_A_CONNECTION: [HeaderName; 7] = [
    header::CONNECTION,
    HeaderName::from_static("keep-alive"),
    header::PROXY_AUTHENTICATE,
    header::PROXY_AUTHORIZATION,
    header::TE,
    header::TRANSFER_ENCODING,
    header::UPGRADE,
];

/// A request to another server, which may be sent more than once. A streamed body is not part of it.
#[derive(Clone)]
pub(super) struct Question {
    pub(super) method: Method,
    pub(super) path: PathAndQuery,
    /// Headers that are not hop-by-hop.
    pub(super) headers: HeaderMap,
    pub(super) body: Bytes,
}

impl Question {
    /// A server's own request, without a body.
    pub(super) fn bare(method: Method, path: PathAndQuery) -> Self {
        Self { method, path, headers: HeaderMap::new(), body: Bytes::new() }
    }

    /// Takes the headers out of a client's request, and copies what else is forwarded.
    pub(super) fn of(parts: &mut Parts, body: Bytes) -> Self {
        let mut headers = std::mem::take(&mut parts.headers);
        remove_of_connection(&mut headers);
        // A client could forge the headers that only servers set.
        for name in [header::EXPECT, HOP, CLIENT] {
            headers.remove(name);
        }
        let path = parts.uri.path_and_query().cloned();
        let path = path.unwrap_or_else(|| PathAndQuery::from_static("/"));
        Self { method: parts.method.clone(), path, headers, body }
    }

    /// The same request without its wait; `None` if it has none.
    pub(super) fn without_wait(&self) -> Option<Self> {
        let query = self.path.query()?.as_bytes();
        let mut rest = form_urlencoded::Serializer::new(String::new());
        let mut waits = false;
        for (name, value) in form_urlencoded::parse(query) {
            if name == "wait" {
                waits = true;
            } else {
                rest.append_pair(&name, &value);
            }
        }
        let path = format!("{}?{}", self.path.path(), rest.finish());
        waits.then(|| Self { path: path.parse().expect("a part of a path"), ..self.clone() })
    }
}

/// Failure of a forwarded request.
pub(super) enum Failed {
    /// The request did not arrive.
    NotSent,
    /// The request may or may not have been handled.
    Unknown,
}

/// Connections of this server to the others.
pub(super) struct Links {
    /// Incarnation of this server.
    own: i64,
    secret: Secret,
    http: HttpClient<HttpConnector, Body>,
    peers: Cache<i64, Arc<Peer>>,
    /// Verified credentials, with their recipients.
    checked: Cache<HeaderValue, i64>,
}

/// Address and credential for requests to another server.
struct Peer {
    address: String,
    authority: Authority,
    credential: HeaderValue,
}

impl Links {
    pub(super) fn new(own: i64, secret: &[u8]) -> Self {
        let mut connector = HttpConnector::new();
        connector.set_nodelay(true);
        connector.set_connect_timeout(Some(CONNECT_PATIENCE));
        // Keepalive ends a connection where packets are lost between two servers that both reach the database: nobody else would.
        connector.set_keepalive(Some(KEEPALIVE));
        connector.set_keepalive_interval(Some(KEEPALIVE));
        connector.set_keepalive_retries(Some(KEEPALIVE_RETRIES));
        #[cfg(target_os = "linux")]
        connector.set_tcp_user_timeout(Some(KEEPALIVE * (KEEPALIVE_RETRIES + 1)));
        let http = HttpClient::builder(TokioExecutor::new())
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(UNUSED)
            .build(connector);
        Self {
            own,
            secret: Secret::new(secret),
            http,
            peers: Cache::new(PEERS_MAX),
            checked: Cache::new(PEERS_MAX),
        }
    }

    /// Client of a request that another server forwarded; `None` where the credential is for an earlier server of this address.
    /// Fails without a valid credential.
    pub(super) fn client_of(&self, headers: &HeaderMap) -> Result<Option<Client>, ApiError> {
        let refuse = || {
            let detail = "this address is for the other servers of the cluster, and the request is of none of them: send it to the \
                          public address. A server that sees this has another --cluster-secret-file";
            ApiError::new(Code::Forbidden, detail)
        };
        let hop = headers.get(HOP).ok_or_else(refuse)?;
        if self.recipient(hop).ok_or_else(refuse)? != self.own {
            return Ok(None);
        }
        let client =
            headers.get(CLIENT).and_then(|value| value.to_str().ok()).ok_or_else(refuse)?;
        let (address, is_local) = client.split_once(' ').ok_or_else(refuse)?;
        let address = address.parse().map_err(|_| refuse())?;
        Ok(Some(Client { address, is_local: is_local == "local" }))
    }

    /// Recipient of a credential; `None` where the credential is invalid.
    fn recipient(&self, credential: &HeaderValue) -> Option<i64> {
        if let Some(recipient) = self.checked.get(credential) {
            return Some(recipient);
        }
        let recipient = self.secret.recipient(credential.to_str().ok()?)?;
        self.checked.insert(credential.clone(), recipient);
        Some(recipient)
    }

    fn peer(&self, to: &Other) -> Option<Arc<Peer>> {
        if let Some(peer) =
            self.peers.get(&to.incarnation).filter(|peer| peer.address == to.address)
        {
            return Some(peer);
        }
        let credential = self.secret.credential(self.own, to.incarnation);
        let peer = Arc::new(Peer {
            address: to.address.clone(),
            authority: to.address.parse().ok()?,
            credential: HeaderValue::try_from(credential).expect("digits"),
        });
        self.peers.insert(to.incarnation, Arc::clone(&peer));
        Some(peer)
    }

    /// Sends a client's request to another server; `body` replaces the body of the question. `gone` completes when that server
    /// leaves the cluster: the request fails if it has no answer yet, and the body of its answer breaks off.
    pub(super) async fn send<Gone>(
        &self,
        question: &Question,
        body: Option<Body>,
        client: Client,
        to: &Other,
        gone: impl Fn() -> Gone,
    ) -> Result<Response, Failed>
    where
        Gone: Future<Output = ()> + Send + 'static,
    {
        let peer = self.peer(to).ok_or(Failed::NotSent)?;
        let body = body.unwrap_or_else(|| Body::from(question.body.clone()));
        let request = peer.request(question, client, body).ok_or(Failed::NotSent)?;
        let answered = tokio::select! {
            answered = self.http.request(request) => answered,
            () = gone() => return Err(Failed::Unknown),
        };
        match answered {
            Ok(response) => {
                let mut response = response.map(|body| until_gone(gone(), body));
                remove_of_connection(response.headers_mut());
                Ok(response)
            }
            Err(error) if error.is_connect() => Err(Failed::NotSent),
            Err(error) => {
                tracing::debug!(%error, to = to.address, "a forwarded request was not answered");
                Err(Failed::Unknown)
            }
        }
    }
}

impl Peer {
    /// Headers that authenticate this server, and name the client.
    fn headers(&self, client: Client) -> [(HeaderName, HeaderValue); 2] {
        let kind = if client.is_local { "local" } else { "remote" };
        let shown = HeaderValue::try_from(format!("{} {kind}", client.address));
        [(HOP, self.credential.clone()), (CLIENT, shown.expect("an address"))]
    }

    fn request<T>(
        &self,
        question: &Question,
        client: Client,
        body: T,
    ) -> Option<hyper::Request<T>> {
        let mut request = hyper::Request::new(body);
        *request.method_mut() = question.method.clone();
        let uri = Uri::builder().scheme(Scheme::HTTP).authority(self.authority.clone());
        *request.uri_mut() = uri.path_and_query(question.path.clone()).build().ok()?;
        *request.headers_mut() = question.headers.clone();
        request.headers_mut().extend(self.headers(client));
        Some(request)
    }
}

/// Body of another server's answer. A body that is not small breaks off when that server is gone.
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

fn remove_of_connection(headers: &mut HeaderMap) {
    for name in &OF_A_CONNECTION {
        headers.remove(name);
    }
}
