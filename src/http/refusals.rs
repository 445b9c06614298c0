//! The common error responses of routes, for the OpenAPI document.

use std::collections::BTreeMap;

use utoipa::IntoResponses;
use utoipa::openapi::{ContentBuilder, Ref, RefOr, Response, ResponseBuilder};

/// What every route that reads a token may answer beside its own.
pub(super) struct TokenRefusals;

impl IntoResponses for TokenRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems(&[
            (401, "`unauthorized`: a token is needed, or the one that came is unknown"),
            (429, "`rate_limited`, naming the `limit`; `Retry-After` says when to come again"),
            (500, "`internal`: a fault of the server, which was logged"),
            (503, "`overloaded` or `unavailable`; `Retry-After` says when to come again"),
        ])
    }
}

/// What every route may answer, token or not.
pub(super) struct RateRefusals;

impl IntoResponses for RateRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems(&[
            (429, "`rate_limited`, naming the `limit`; `Retry-After` says when to come again"),
            (503, "`overloaded` or `unavailable`; `Retry-After` says when to come again"),
        ])
    }
}

/// What every route with a query may answer beside its own.
pub(super) struct QueryRefusals;

impl IntoResponses for QueryRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems(&[(400, "`malformed`: the query, or the body, cannot be read")])
    }
}

/// What every route with a body may answer beside its own.
pub(super) struct BodyRefusals;

impl IntoResponses for BodyRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems(&[
            (400, "`malformed`: not JSON, or not UTF-8"),
            (413, "`too_large`, naming the `limit`"),
            (415, "`unsupported_media_type`: not sent as `application/json`"),
            (422, "`invalid`, naming the `fields` and what is allowed; nothing was changed"),
        ])
    }
}

/// What every route with an id may answer beside its own.
pub(super) struct IdRefusals;

impl IntoResponses for IdRefusals {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems(&[(404, "`not_found`: unknown, or not for this token to know of")])
    }
}

fn problems(rows: &[(u16, &str)]) -> BTreeMap<String, RefOr<Response>> {
    let schema = Ref::from_schema_name("Problem");
    let content = ContentBuilder::new().schema(Some(schema)).build();
    let response = |description: &str| {
        ResponseBuilder::new()
            .description(description)
            .content("application/problem+json", content.clone())
            .build()
    };
    rows.iter().map(|(status, text)| (status.to_string(), response(text).into())).collect()
}
