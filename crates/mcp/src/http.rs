//! One HTTP request of a client: streamable HTTP without sessions; every answer is one JSON object.

use std::sync::Arc;

use bytes::Bytes;
use http::header::ACCEPT;
use http::{HeaderValue, Request, Response};
use http_body_util::{BodyExt, Full};
use rmcp::transport::streamable_http_server::session::never::NeverSessionManager;
use rmcp::transport::streamable_http_server::{StreamableHttpServerConfig, StreamableHttpService};
use tokio_util::sync::CancellationToken;

use crate::SeatAccess;
use crate::player::Player;

/// Answers one request for the seat of its sender; the body must have passed [`essential`](crate::essential). Dropping
/// the future cancels all waits of the request.
///
/// The caller checks whether the sender may ask at all (its address, its `Host` and `Origin`, the length of the body).
/// The seat's own refusals are results of tools, which models can read.
pub async fn answer(seat: Arc<dyn SeatAccess>, mut request: Request<Bytes>) -> Response<Bytes> {
    let gone = CancellationToken::new();
    let _on_drop = gone.clone().drop_guard();
    // There is one kind of answer, so the client's `Accept` does not matter.
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
