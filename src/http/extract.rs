//! Strict reading of requests: an error names what is wrong.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use axum::http::{Uri, header};
use serde::de::{Deserialize, DeserializeOwned, Deserializer, Error as _, Visitor};
use serde::forward_to_deserialize_any;

use super::App;
use super::auth::needs_token;
use super::body::Arrived;
use super::error::{ApiError, Code};
use swarmbench_protocol::carried::{any_json, count_values};
use swarmbench_protocol::problem::FieldProblem;

/// A JSON body of the usual size, parsed and as received. Bodies are read from callers with a token only, whom earlier extractors
/// have identified.
pub(super) struct Json<T>(pub(super) T, pub(super) Arrived);

impl<T: DeserializeOwned> FromRequest<App> for Json<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        check_has_token(&request)?;
        let (value, body) = Unread(request).read(app).await?;
        Ok(Self(value, body))
    }
}

fn check_has_token(request: &Request) -> Result<(), ApiError> {
    let has_token = request.headers().contains_key(header::AUTHORIZATION);
    if has_token { Ok(()) } else { Err(needs_token("a key")) }
}

/// A request whose body the handler reads after checking that the caller may send one: some callers need no token.
pub(super) struct Unread(Request);

impl FromRequest<App> for Unread {
    type Rejection = Infallible;

    async fn from_request(request: Request, _: &App) -> Result<Self, Infallible> {
        Ok(Self(request))
    }
}

impl Unread {
    pub(super) async fn read<T: DeserializeOwned>(
        self,
        app: &App,
    ) -> Result<(T, Arrived), ApiError> {
        let body = self.body(app).await?;
        Ok((read(body.as_ref())?, body))
    }

    async fn body(self, app: &App) -> Result<Arrived, ApiError> {
        app.bodies.json(self.0, app.limits.body_bytes_max, "body_bytes_max").await
    }
}

/// Variant of [`Json`] where an empty body stands for one with all fields left out.
pub(super) struct OptionalJson<T>(pub(super) T, pub(super) Arrived);

impl<T: DeserializeOwned + Default> FromRequest<App> for OptionalJson<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, app: &App) -> Result<Self, ApiError> {
        check_has_token(&request)?;
        let body = Unread(request).body(app).await?;
        let value = if body.as_ref().is_empty() { T::default() } else { read(body.as_ref())? };
        Ok(Self(value, body))
    }
}

/// Maximum characters of a value, or of another text of the body, in an error.
const PROBLEM_CHARS_MAX: usize = 400;

/// Maximum unknown fields that an error names.
const UNKNOWN_FIELDS_MAX: usize = 20;

/// Maximum values and names of a body: in memory each takes more than the shortest of them take in the text.
pub(super) const BODY_VALUES_MAX: usize = 8192;

/// Parses JSON. The error tells invalid JSON from wrong fields.
pub fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ApiError> {
    let most = BODY_VALUES_MAX;
    if bytes.len() > most && count_values(bytes) > most {
        any_json(bytes).map_err(|error| no_json(&error))?;
        let detail = format!("the body has more than {most} values and names");
        return Err(ApiError::limit(Code::TooLarge, "body_values_max", most, detail));
    }
    read_envelope(bytes)
}

/// Variant of [`read`] for a body whose parts are kept as received, to be parsed one by one.
pub(super) fn read_envelope<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, ApiError> {
    serde_json::from_slice(bytes).map_err(|error| diagnose::<T>(bytes, &error))
}

fn no_json(error: &serde_json::Error) -> ApiError {
    ApiError::new(Code::Malformed, format!("the body is not JSON: {error}"))
}

/// Finds the errors of a refused body.
fn diagnose<T: DeserializeOwned>(bytes: &[u8], error: &serde_json::Error) -> ApiError {
    let object = match any_json(bytes) {
        Ok(Some(object)) => object,
        Ok(None) => return ApiError::new(Code::Invalid, "the body must be a JSON object"),
        Err(error) => return no_json(&error),
    };
    let known = fields::<T>();
    let mut unknown = Vec::new();
    object.each(|field, _| {
        if !known.contains(&field) && unknown.len() < UNKNOWN_FIELDS_MAX {
            let field = field.chars().take(100).collect();
            let problem = format!("is unknown; the fields are {}", known.join(", "));
            unknown.push(FieldProblem { field, problem });
        }
    });
    if !unknown.is_empty() {
        return ApiError::fields(unknown);
    }
    let problem = error.to_string();
    // The position in the text is useless to clients whose JSON was written by a program.
    let problem = problem.split(" at line ").next().unwrap_or_default();
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let located = serde_path_to_error::deserialize::<_, T>(&mut json).err();
    let path = located.as_ref().map(serde_path_to_error::Error::path);
    let path = path.filter(|path| path.iter().len() > 0).map(ToString::to_string);
    let missing = problem.strip_prefix("missing field `").and_then(|p| p.strip_suffix('`'));
    let Some(path) = path else {
        return match missing {
            Some(missing) => ApiError::field(missing, "is missing"),
            None => ApiError::new(Code::Invalid, plain(problem)),
        };
    };
    // `field` is a top-level field; the path within it becomes part of the problem.
    let end = path.find(['.', '[']).unwrap_or(path.len());
    let (field, inside) = path.split_at(end);
    let inside = shortened(inside.trim_start_matches('.'));
    match (missing, &*inside) {
        (Some(missing), "") => ApiError::field(field, format!("must have `{missing}`")),
        (Some(missing), inside) => {
            ApiError::field(field, format!("must have `{missing}` in {inside}"))
        }
        (None, "") => ApiError::field(field, plain(problem)),
        (None, inside) => {
            ApiError::field(field, format!("is wrong at {inside}: {}", plain(problem)))
        }
    }
}

/// A deserializer's error in the terms of JSON, without types of Rust.
fn plain(problem: &str) -> String {
    let wrong =
        problem.strip_prefix("invalid type: ").or_else(|| problem.strip_prefix("invalid value: "));
    if let Some((is, expected)) = wrong.and_then(|wrong| wrong.rsplit_once(", expected ")) {
        let is = match is.split_once(' ') {
            Some(("string", text)) => text,
            Some((_, value)) if value.ends_with('`') => {
                value.rsplit('`').nth(1).unwrap_or_default()
            }
            _ => in_json(is),
        };
        return format!("must be {}, is {}", in_json(expected), shortened(is));
    }
    match problem.strip_prefix("unknown field ").and_then(|rest| rest.split_once(", expected ")) {
        Some((_, known)) => {
            format!("is unknown; the fields are {}", known.replacen("one of ", "", 1))
        }
        None => shortened(problem),
    }
}

/// The beginning of a text that may hold a value of the body, so that a refusal is not as large as the body.
fn shortened(text: &str) -> String {
    text.chars().take(PROBLEM_CHARS_MAX).collect()
}

/// JSON name of a Rust type.
fn in_json(kind: &str) -> &str {
    match kind {
        "i8" | "i16" | "i32" | "i64" => "a whole number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number that is not negative",
        "f32" | "f64" => "a number",
        "a string" => "a text",
        "a boolean" => "true or false",
        "sequence" | "a sequence" => "a list",
        "map" | "a map" => "an object",
        kind if kind.starts_with("struct ") => "an object",
        kind => kind,
    }
}

/// Names of a body's fields.
fn fields<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut fields = Fields(&[]);
    // Deserialization always fails, but only after the struct has passed on its fields.
    drop(T::deserialize(&mut fields));
    fields.0
}

/// A deserializer that records the fields of a struct.
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

/// The query, parsed strictly.
pub(super) struct Params<T>(pub(super) T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for Params<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let read = Query::<T>::try_from_uri(&parts.uri);
        read.map(|Query(params)| Self(params)).map_err(|error| {
            use std::error::Error;
            let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            let cause = in_words(cause, &parts.uri);
            ApiError::new(Code::Malformed, format!("the query cannot be read: {cause}"))
        })
    }
}

/// Describes an error of the query. `cause` begins with the name of the parameter; the parsers of numbers do not say what they
/// expect.
fn in_words(cause: String, uri: &Uri) -> String {
    let Some((field, problem)) = cause.split_once(": ") else { return cause };
    let expected = match problem {
        "invalid digit found in string" | "cannot parse integer from empty string" => {
            "must be a whole number that is not negative"
        }
        "number too large to fit in target type" => "is too large",
        "invalid float literal" | "cannot parse float from empty string" => "must be a number",
        problem if problem.starts_with("must be ") => return format!("{field} {problem}"),
        problem if problem.starts_with("unknown field ") => return problem.to_owned(),
        _ => return cause,
    };
    let fields = Query::<Vec<(String, String)>>::try_from_uri(uri).unwrap_or_default();
    let value = fields.0.into_iter().find_map(|(name, value)| (name == field).then_some(value));
    let shown: String = value.unwrap_or_default().chars().take(SHOWN_CHARS_MAX).collect();
    format!("{field} {expected}, is {shown:?}")
}

/// Maximum characters of a refused value in an error.
const SHOWN_CHARS_MAX: usize = 40;

/// Deserializes the boolean spellings of common clients, for `deserialize_with`.
pub(super) fn flag<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    let text = String::deserialize(deserializer)?;
    match text.to_ascii_lowercase().as_str() {
        "true" | "1" | "yes" => Ok(true),
        "false" | "0" | "no" => Ok(false),
        _ => {
            let shown: String = text.chars().take(SHOWN_CHARS_MAX).collect();
            Err(D::Error::custom(format!(
                "must be true or false (also 1 or 0, yes or no), is {shown:?}"
            )))
        }
    }
}

/// Variant of [`flag`] for an optional value.
pub(super) fn optional_flag<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<bool>, D::Error> {
    flag(deserializer).map(Some)
}

/// Query of a route without parameters.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Nothing {}

/// The id in a path, or the ids, each within the one before. Invalid UTF-8 becomes an unknown id.
pub(super) struct Id<T = String>(pub(super) T);

impl<T: DeserializeOwned + Send, S: Sync + Send> FromRequestParts<S> for Id<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let ids = Path::<T>::from_request_parts(parts, state).await;
        ids.map(|Path(ids)| Self(ids)).map_err(|_| ApiError::not_found("the id"))
    }
}

/// An id in a path, followed by a round and the name of an agent.
pub(super) struct AgentPlace {
    pub(super) id: String,
    pub(super) round: u32,
    pub(super) agent: String,
}

impl<S: Sync + Send> FromRequestParts<S> for AgentPlace {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let Id((id, round, agent)) =
            Id::<(String, String, String)>::from_request_parts(parts, state).await?;
        let round = round.parse().map_err(|_| ApiError::not_found("the round"))?;
        Ok(Self { id, round, agent })
    }
}

/// Refuses a filter that is not one of `names`.
pub(super) fn one_of(field: &str, value: Option<&str>, names: &[&str]) -> Result<(), ApiError> {
    match value {
        Some(value) if !names.contains(&value) => {
            let detail = format!("{field} must be one of {}", names.join(", "));
            Err(ApiError::new(Code::Malformed, detail))
        }
        _ => Ok(()),
    }
}

/// Validates the time that a request wants to wait.
pub(super) fn wait(app: &App, seconds: Option<f64>) -> Result<Duration, ApiError> {
    let most = app.limits.wait_s_max;
    let seconds = seconds.unwrap_or(0.0);
    if !(0.0..=f64::from(most)).contains(&seconds) {
        let detail = format!("wait must be from 0 to {most} seconds, is {seconds}");
        return Err(ApiError::limit(Code::Malformed, "wait_s_max", most as usize, detail));
    }
    Ok(Duration::from_secs_f64(seconds))
}

#[cfg(test)]
mod tests {
    use allocation_counter::measure;
    use swarmbench_protocol::act::ActRequest;

    use super::*;

    #[test]
    fn a_body_that_is_refused_takes_a_small_multiple_of_its_bytes() {
        for (part, code) in
            [(r#"{"":0}"#, Code::Invalid), ("[],[]", Code::TooLarge), ("[[", Code::Malformed)]
        {
            let body = format!(r#"{{"x":[{}]}}"#, vec![part; 2500].join(","));
            let mut refused = None;
            let counted = measure(|| refused = read::<ActRequest>(body.as_bytes()).err());
            let refused = refused.map(|error| error.sent().code);
            assert_eq!(refused.as_deref(), Some(code.name()), "{part}");
            let most = 4 * body.len() as u64 + 8192;
            assert!(counted.bytes_max < most, "{part}: {counted:?} for {} bytes", body.len());
        }
    }
}
