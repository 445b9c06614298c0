//! One HTTP request of a client: streamable HTTP without sessions, every answer one JSON object.

use std::sync::Arc;

use bytes::Bytes;
use http::header::{ACCEPT, CONTENT_TYPE};
use http::{HeaderValue, Request, Response, StatusCode};
use http_body_util::{BodyExt, Full};
use rmcp::model::ClientJsonRpcMessage;
use rmcp::transport::streamable_http_server::session::never::NeverSessionManager;
use rmcp::transport::streamable_http_server::{StreamableHttpServerConfig, StreamableHttpService};
use serde::de::IgnoredAny;
use serde_json::json;
use tokio_util::sync::CancellationToken;

use crate::Seat;
use crate::player::Player;

/// The codes of JSON-RPC for bodies that are no JSON, and for JSON that is no request.
const PARSE_ERROR: i32 = -32700;
const INVALID_REQUEST: i32 = -32600;

/// Answers one request with a whole body, for the seat of its sender. If the future is dropped, whatever waits for the
/// request is ended.
///
/// Whether the sender may ask at all (its address, its `Host` and `Origin`, the length of the body) is for the caller to
/// decide. The seat's own refusals are results of tools, which models can read.
pub async fn answer<S: Seat>(seat: S, mut request: Request<Bytes>) -> Response<Bytes> {
    let gone = CancellationToken::new();
    let _on_drop = gone.clone().drop_guard();
    if let Err(error) = serde_json::from_slice::<ClientJsonRpcMessage>(request.body()) {
        let is_json = serde_json::from_slice::<IgnoredAny>(request.body()).is_ok();
        return if is_json {
            refused(INVALID_REQUEST, &format!("the body is no message of MCP: {error}"))
        } else {
            refused(PARSE_ERROR, &format!("the body is not JSON: {error}"))
        };
    }
    // There is one kind of answer, so it does not matter which ones the client takes.
    let both = HeaderValue::from_static("application/json, text/event-stream");
    request.headers_mut().insert(ACCEPT, both);
    let most = request.body().len();
    let config = StreamableHttpServerConfig::default()
        .with_legacy_session_mode(false)
        .with_json_response(true)
        .with_max_request_body_bytes(most)
        .disable_allowed_hosts();
    let player = Player::new(seat, gone);
    let service = StreamableHttpService::new(
        move || Ok(player.clone()),
        Arc::new(NeverSessionManager::default()),
        config,
    );
    let (parts, body) = service.handle(request.map(Full::new)).await.into_parts();
    let Ok(body) = body.collect().await;
    Response::from_parts(parts, body.to_bytes())
}

fn refused(code: i32, message: &str) -> Response<Bytes> {
    let body =
        json!({ "jsonrpc": "2.0", "id": null, "error": { "code": code, "message": message } });
    let mut response = Response::new(Bytes::from(body.to_string()));
    *response.status_mut() = StatusCode::BAD_REQUEST;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("application/json"));
    response
}
