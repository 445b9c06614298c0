//! Requests, read strictly: every error is reported by name.

use std::time::Duration;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use serde::de::{DeserializeOwned, Deserializer, Error as _, Visitor};
use serde::forward_to_deserialize_any;
use serde_path_to_error::Segment;

use super::App;
use super::body::{Arrived, is_light};
use super::error::{ApiError, Code};
use crate::fair::Party;
use swarmbench_protocol::problem::FieldProblem;

/// A JSON body of the usual size, as it was read and as it came.
pub(super) struct Json<T>(pub(super) T, pub(super) Arrived);

impl<T: DeserializeOwned> FromRequest<App> for Json<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        let limit = app.limits.body_bytes_max;
        let body = app.json_body(request, limit, "body_bytes_max").await?;
        Ok(Self(read(body.as_ref())?, body))
    }
}

impl App {
    /// Reads a body of at most `limit` bytes that says it is JSON and is text. A large one counts against the rates of its
    /// sender, and has a permit until the result is dropped.
    pub(super) async fn json_body(
        &self,
        request: Request,
        limit: usize,
        limit_name: &str,
    ) -> Result<Arrived, ApiError> {
        use hyper::body::Body as _;

        if !is_light(&request) {
            let bytes = request.body().size_hint().upper().and_then(|bytes| bytes.try_into().ok());
            let bytes = bytes.unwrap_or(limit).min(limit);
            self.rates.check_body(Party::current(), bytes)?;
        }
        self.bodies.json(request, limit, limit_name).await
    }
}

/// Unknown fields of a body that an error names.
const UNKNOWN_FIELDS_MAX: usize = 20;

/// Reads JSON; an error says whether it is none, or which fields are wrong.
pub(super) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ApiError> {
    serde_json::from_slice(bytes).map_err(|error| diagnose::<T>(bytes, &error))
}

/// Finds the errors of a body that was refused.
fn diagnose<T: DeserializeOwned>(bytes: &[u8], error: &serde_json::Error) -> ApiError {
    let value = match serde_json::from_slice::<serde_json::Value>(bytes) {
        Ok(value) => value,
        Err(error) => {
            return ApiError::new(Code::Malformed, format!("the body is not JSON: {error}"));
        }
    };
    let serde_json::Value::Object(object) = value else {
        return ApiError::new(Code::Invalid, "the body must be a JSON object");
    };
    let known = fields::<T>();
    let unknown: Vec<FieldProblem> = (object.keys())
        .filter(|key| !known.contains(&key.as_str()))
        .take(UNKNOWN_FIELDS_MAX)
        .map(|key| FieldProblem {
            field: key.chars().take(100).collect(),
            problem: format!("is unknown; the fields are {}", known.join(", ")),
        })
        .collect();
    if !unknown.is_empty() {
        return ApiError::fields(unknown);
    }
    let problem = error.to_string();
    // The place in the text is of no use to a client whose JSON was written by a program.
    let problem = problem.split(" at line ").next().unwrap_or_default().to_owned();
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let located = serde_path_to_error::deserialize::<_, T>(&mut json).err();
    let field = located.as_ref().and_then(|error| error.path().iter().next());
    match (field, problem.strip_prefix("missing field `").and_then(|p| p.strip_suffix('`'))) {
        (Some(Segment::Map { key }), _) => ApiError::field(key, problem),
        (_, Some(missing)) => ApiError::field(missing, "is missing"),
        _ => ApiError::new(Code::Invalid, problem),
    }
}

/// The names of the fields of a body.
pub(super) fn fields<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut fields = Fields(&[]);
    // It always fails, after it has named its fields.
    drop(T::deserialize(&mut fields));
    fields.0
}

/// Notes the fields for which a struct asks.
struct Fields(&'static [&'static str]);

impl<'de> Deserializer<'de> for &mut Fields {
    type Error = serde::de::value::Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Self::Error> {
        Err(Self::Error::custom("there is no value"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Self::Error> {
        self.0 = fields;
        self.deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
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

/// The id in a path, with a round and the name of an agent behind it.
pub(super) struct AgentPlace {
    pub(super) id: String,
    pub(super) round: u32,
    pub(super) agent: String,
}

impl<S: Sync + Send> FromRequestParts<S> for AgentPlace {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let place = Path::<(String, String, String)>::from_request_parts(parts, state).await;
        let Path((id, round, agent)) = place.map_err(|_| ApiError::not_found("the id"))?;
        let round = round.parse().map_err(|_| ApiError::not_found("the round"))?;
        Ok(Self { id, round, agent })
    }
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
