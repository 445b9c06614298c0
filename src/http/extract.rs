//! Requests, read strictly: every error is reported by name.

use std::time::Duration;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::HeaderMap;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;

use super::App;
use super::body::Arrived;
use super::error::{ApiError, Code};
use super::limits::Limits;
use super::page::Page;
use crate::keys::OwnerKey;
use crate::wire::act::{ActRequest, SwarmAct};
use crate::wire::claim::ClaimRequest;
use crate::wire::competition::{
    AttemptRequest, CodesRequest, CompetitionRequest, EntrantChange, EntrantRequest,
};
use crate::wire::episode::{EpisodeRequest, VoidRequest};
use crate::wire::key::KeyRequest;
use crate::wire::problem::FieldProblem;
use crate::wire::run::RunRequest;

/// A body that knows the names of its fields.
pub(super) trait Named: DeserializeOwned {
    /// The names of all fields.
    const FIELDS: &'static [&'static str];
}

impl Named for ActRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for SwarmAct {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for KeyRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for ClaimRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for CompetitionRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for CodesRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for EntrantRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for EntrantChange {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for AttemptRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for RunRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for VoidRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

impl Named for EpisodeRequest {
    const FIELDS: &'static [&'static str] = Self::FIELDS;
}

/// A JSON body of the usual size, as it was read and as it came.
pub(super) struct Json<T>(pub(super) T, pub(super) Arrived);

impl<T: Named> FromRequest<App> for Json<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        let limit = app.limits.body_bytes_max;
        let body = app.json_body(request, limit, "body_bytes_max").await?;
        Ok(Self(read(body.as_ref())?, body))
    }
}

/// Reads JSON; an error says whether it is none, or which fields are wrong.
pub(super) fn read<T: Named>(bytes: &[u8]) -> Result<T, ApiError> {
    serde_json::from_slice(bytes).map_err(|error| diagnose::<T>(bytes, &error))
}

/// Finds the errors of a body that was refused.
fn diagnose<T: Named>(bytes: &[u8], error: &serde_json::Error) -> ApiError {
    let value = match serde_json::from_slice::<serde_json::Value>(bytes) {
        Ok(value) => value,
        Err(error) => {
            return ApiError::new(Code::Malformed, format!("the body is not JSON: {error}"));
        }
    };
    let serde_json::Value::Object(object) = value else {
        return ApiError::new(Code::Invalid, "the body must be a JSON object");
    };
    let unknown: Vec<FieldProblem> = (object.keys())
        .filter(|key| !T::FIELDS.contains(&key.as_str()))
        .take(20)
        .map(|key| FieldProblem {
            field: key.chars().take(100).collect(),
            problem: format!("is unknown; the fields are {}", T::FIELDS.join(", ")),
        })
        .collect();
    if !unknown.is_empty() {
        return ApiError::fields(unknown);
    }
    // The field that is wrong is the one without which the rest is read differently. Alone it leaves out
    // others, which is not its fault; but what is missing inside of it is.
    let is_left_out = |error: &str| {
        let named = error.strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
        named.is_some_and(|named| T::FIELDS.contains(&named))
    };
    let wrong = (object.keys()).find(|key| {
        let alone = serde_json::Map::from_iter([((*key).clone(), object[*key].clone())]);
        let result = serde_json::from_value::<T>(serde_json::Value::Object(alone));
        result.is_err_and(|error| !is_left_out(&error.to_string()))
    });
    let problem = error.to_string();
    // Where in the text it went wrong helps nobody who did not write it by hand.
    let problem = problem.split(" at line ").next().unwrap_or_default().to_owned();
    match wrong {
        Some(field) => ApiError::field(field, problem),
        None => match problem.strip_prefix("missing field `").and_then(|p| p.strip_suffix('`')) {
            Some(missing) => ApiError::field(missing, "is missing"),
            None => ApiError::new(Code::Invalid, problem),
        },
    }
}

/// The query, read strictly.
pub(super) struct Params<T>(pub(super) T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for Params<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let read = Query::<T>::try_from_uri(&parts.uri);
        read.map(|Query(params)| Self(params)).map_err(|error| {
            use std::error::Error;
            let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            ApiError::new(Code::Malformed, format!("the query cannot be read: {cause}"))
        })
    }
}

/// The query of a route that has none.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Nothing {}

/// The id in a path. Whatever is no text is no id that is known.
pub(super) struct Id(pub(super) String);

impl<S: Sync + Send> FromRequestParts<S> for Id {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let id = Path::<String>::from_request_parts(parts, state).await;
        id.map(|Path(id)| Self(id)).map_err(|_| ApiError::not_found("the id"))
    }
}

/// The two ids in a path.
pub(super) struct Ids(pub(super) String, pub(super) String);

impl<S: Sync + Send> FromRequestParts<S> for Ids {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let ids = Path::<(String, String)>::from_request_parts(parts, state).await;
        ids.map(|Path((of, id))| Self(of, id)).map_err(|_| ApiError::not_found("the id"))
    }
}

/// The name of a creation that may be repeated, if it has one. Everybody has names of their own.
pub(super) fn idempotency_key(
    headers: &HeaderMap,
    owner: Option<OwnerKey>,
    limits: &Limits,
) -> Result<Option<String>, ApiError> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let most = limits.idempotency_key_chars_max;
    match (value.to_str(), owner) {
        (Ok(key), Some(OwnerKey(number))) if (1..=most).contains(&key.len()) => {
            Ok(Some(format!("{number}/{key}")))
        }
        (Ok(key), None) if (1..=most).contains(&key.len()) => Ok(Some(format!("/{key}"))),
        _ => Err(ApiError::new(
            Code::Malformed,
            format!("Idempotency-Key must be 1 to {most} printable ASCII characters"),
        )),
    }
}

/// Where a page of a list begins: after the item with this number.
pub(super) fn read_cursor(text: Option<&str>) -> Result<Option<i64>, ApiError> {
    let Some(text) = text else { return Ok(None) };
    let number = text.strip_prefix('c').and_then(|digits| i64::from_str_radix(digits, 16).ok());
    let number = number.filter(|number| *number >= 0).ok_or_else(|| {
        ApiError::new(Code::Malformed, "cursor must be the next_cursor of an earlier page")
    })?;
    Ok(Some(number))
}

/// The cursor of the page after the item with this number.
pub(super) fn write_cursor(number: i64) -> String {
    format!("c{number:x}")
}

/// Refuses a filter that is none of the names that there are.
pub(super) fn one_of(field: &str, value: Option<&str>, names: &[&str]) -> Result<(), ApiError> {
    match value {
        Some(value) if !names.contains(&value) => {
            let detail = format!("{field} must be one of {}", names.join(", "));
            Err(ApiError::new(Code::Malformed, detail))
        }
        _ => Ok(()),
    }
}

/// How many items somebody wants of a list, checked.
pub(super) fn page_limit(app: &App, asked: Option<u32>, usual: u32) -> Result<u32, ApiError> {
    let most = app.limits.page_items_max;
    let limit = asked.unwrap_or(usual);
    if !(1..=most).contains(&limit) {
        let detail = format!("limit must be from 1 to {most}, is {limit}");
        return Err(ApiError::limit(Code::Malformed, "page_items_max", most as usize, detail));
    }
    Ok(limit)
}

/// Which part of a list somebody wants that is shown as a whole where it fits into one answer.
#[derive(Debug, Default, serde::Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct PageParams {
    /// How many at most, up to 1,000; all that fit into one answer where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

impl PageParams {
    /// The page that it asks for, still empty.
    pub(super) async fn page(&self, app: &App) -> Result<Page, ApiError> {
        let limit = match self.limit {
            None => u32::MAX,
            asked => page_limit(app, asked, 0)?,
        };
        Page::new(app, read_cursor(self.cursor.as_deref())?, limit).await
    }
}

/// How long a request wants to wait, checked.
pub(super) fn wait(app: &App, seconds: Option<f64>) -> Result<Duration, ApiError> {
    let most = app.limits.wait_s_max;
    let seconds = seconds.unwrap_or(0.0);
    if !(0.0..=f64::from(most)).contains(&seconds) {
        let detail = format!("wait must be from 0 to {most} seconds, is {seconds}");
        return Err(ApiError::limit(Code::Malformed, "wait_s_max", most as usize, detail));
    }
    Ok(Duration::from_secs_f64(seconds))
}
