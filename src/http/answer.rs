//! Responses that several routes give.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// 201 with `Location`. The body may have tokens, so caches must not store it.
pub(super) fn created(location: &str, body: impl Serialize) -> Response {
    let mut response = with_tokens(StatusCode::CREATED, body);
    if let Ok(location) = HeaderValue::try_from(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

/// A response with tokens, which caches must not store.
pub(super) fn with_tokens(status: StatusCode, body: impl Serialize) -> Response {
    let mut response = (status, axum::Json(body)).into_response();
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// Initial capacity of a small response.
const USUAL_BYTES: usize = 512;

pub(super) fn small(body: &impl Serialize) -> Response {
    let mut bytes = Vec::with_capacity(USUAL_BYTES);
    serde_json::to_writer(&mut bytes, body).expect("string keys");
    json(bytes)
}

/// A response whose body is already serialized.
pub(super) fn json(body: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

/// A JSON object with one more field, whose value is already serialized.
pub(super) fn with_field(object: &impl Serialize, name: &str, value: &[u8]) -> Vec<u8> {
    add_field(serde_json::to_vec(object).expect("string keys"), name, value)
}

/// Variant of [`with_field`] for an object that is already serialized.
pub(super) fn add_field(mut body: Vec<u8>, name: &str, value: &[u8]) -> Vec<u8> {
    let end = body.pop();
    debug_assert!(end == Some(b'}') && body.len() > 1, "an object with fields");
    body.reserve(name.len() + value.len() + 8);
    body.extend_from_slice(b",\"");
    body.extend_from_slice(name.as_bytes());
    body.extend_from_slice(b"\":");
    body.extend_from_slice(value);
    body.push(b'}');
    body
}

/// Two objects merged into one; the second is already serialized.
pub(super) fn joined(object: &impl Serialize, rest: &[u8]) -> Vec<u8> {
    let mut body = serde_json::to_vec(object).expect("string keys");
    let end = body.pop();
    debug_assert!(end == Some(b'}') && body.len() > 1 && rest.len() > 2, "objects with fields");
    body.reserve(rest.len());
    body.push(b',');
    body.extend_from_slice(&rest[1..]);
    body
}
