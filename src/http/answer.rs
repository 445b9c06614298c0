//! Answers that several routes give.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// Something was created, and lies there; its tokens must not lie in caches on the way.
pub(super) fn created(location: &str, body: impl Serialize) -> Response {
    let mut response = with_tokens(StatusCode::CREATED, body);
    if let Ok(location) = HeaderValue::try_from(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

/// An answer with tokens, which must not lie in caches on the way.
pub(super) fn with_tokens(status: StatusCode, body: impl Serialize) -> Response {
    let mut response = (status, axum::Json(body)).into_response();
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}
