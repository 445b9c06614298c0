//! `/mcp`: the tools of a seat for language models, over the Model Context Protocol.
//!
//! The tools show and do the same as `GET /obs?prompt=true` and `POST /act`, with the same code, tokens and limits. The OpenAPI
//! document omits this route: clients of the protocol ask for the list of tools.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::{FromRequestParts as _, Request};
use axum::http::header;
use axum::routing::post;
use bytes::Bytes;
use futures::future::BoxFuture;
use swarmbench_mcp::{Refusal, SeatAccess};
use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::loopback::is_loopback;

use super::agent::act::submit;
use super::agent::obs::see;
use super::app::Access;
use super::auth::{self, Caller};
use super::body::FREE_BODY_BYTES;
use super::client::{host, is_own, name_of};
use super::prelude::*;
use crate::fair::Origin;

pub(super) fn routes() -> Router<App> {
    Router::new().route("/mcp", post(post_mcp))
}

/// Headers that the MCP library reads.
const HEADERS: [&str; 6] =
    ["accept", "content-type", "host", "mcp-protocol-version", "mcp-method", "mcp-name"];

async fn post_mcp(State(app): State<App>, request: Request) -> Result<Response, ApiError> {
    check_names(&app.access, &request)?;
    let (mut parts, body) = request.into_parts();
    let caller = Caller::from_request_parts(&mut parts, &app).await;
    let (most, limit) = if let Ok(Caller::Seat(..)) = &caller {
        (app.limits.body_bytes_max, "body_bytes_max")
    } else {
        // The memory that is reserved for those with a token is for tokens of seats.
        parts.headers.remove(header::AUTHORIZATION);
        (app.limits.mcp_anonymous_body_bytes_max, "mcp_anonymous_body_bytes_max")
    };
    let mut asked = Request::new(Bytes::new());
    *asked.method_mut() = parts.method.clone();
    for name in HEADERS {
        for value in parts.headers.get_all(name) {
            asked.headers_mut().append(name, value.clone());
        }
    }
    let body = app.bodies.json(Request::from_parts(parts, body), most, limit).await?;
    *asked.body_mut() = match swarmbench_mcp::essential(body.as_ref()) {
        Ok(body) => body,
        Err(answer) => return Ok((*answer).map(Body::from)),
    };
    // Clients that play by tools wait most of the time: a waiting request keeps only what it needs, and the memory of a long one is
    // reserved until it is answered.
    let _body = (asked.body().len() > FREE_BODY_BYTES).then_some(body);
    let seat = Arc::new(ServerSeat { app, caller, origin: Origin::current() });
    Ok(swarmbench_mcp::answer(seat, asked).await.map(Body::from))
}

/// Refuses requests that a page of another site may have sent through a browser. Such a page reaches a server on this machine, or
/// on its network, under a name that its owner points there, and `Host` shows that name; addresses cannot be borrowed in this way.
/// Or the page asks under the server's own address: then `Origin` is another origin, which may well be an address.
fn check_names(access: &Access, request: &Request) -> Result<(), ApiError> {
    let host = host(request.headers(), request.uri());
    let origin = request.headers().get(header::ORIGIN);
    let origin = origin.map(|origin| origin.to_str().unwrap_or_default());
    let wrong = match (host, origin) {
        (Some(host), _) if !name_of(host).is_some_and(|name| is_expected(access, name)) => {
            ("Host", host)
        }
        (_, Some(origin)) if !is_own(origin, request, &access.hosts) => ("Origin", origin),
        _ => return Ok(()),
    };
    let (field, name) = wrong;
    let shown: String = name.chars().take(100).collect();
    let detail = format!(
        "the header `{field}` names {shown:?}: /mcp answers to addresses, to localhost, and to the names that the server was \
         started with (`swarmbench serve --host NAME`), and to pages of these alone"
    );
    Err(ApiError::new(Code::Forbidden, detail))
}

fn is_expected(access: &Access, name: &str) -> bool {
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    is_loopback(name)
        || bare.parse::<IpAddr>().is_ok()
        || access.hosts.iter().any(|host| host.eq_ignore_ascii_case(name))
}

/// Seat of the token that came with a request. Only calls of tools need a token: without one, tools can be listed, and a refused
/// call is a result that the model can read.
struct ServerSeat {
    app: App,
    caller: Result<Caller, ApiError>,
    /// Party and rank of the request, for the tasks in which tools run.
    origin: Origin,
}

impl ServerSeat {
    async fn find(&self) -> Result<auth::TokenSeat, ApiError> {
        auth::TokenSeat::of(self.caller.clone()?, &self.app).await
    }
}

impl SeatAccess for ServerSeat {
    fn obs(
        &self,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> BoxFuture<'_, Result<Vec<u8>, Refusal>> {
        let seen = async move {
            see(&self.app, &self.find().await.map_err(refusal)?, after, wait, prompt)
                .await
                .map_err(refusal)
        };
        Box::pin(self.origin.scope(seen))
    }

    fn act(&self, act: ActRequest) -> BoxFuture<'_, Result<Receipt, Refusal>> {
        let receipt = async move {
            submit(&self.app, &self.find().await.map_err(refusal)?, act).await.map_err(refusal)
        };
        Box::pin(self.origin.scope(receipt))
    }
}

#[expect(clippy::needless_pass_by_value, reason = "the shape that is called with an error")]
fn refusal(error: ApiError) -> Refusal {
    Refusal::Problem(Box::new(error.sent()))
}
