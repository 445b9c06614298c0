//! Errors, as RFC 9457 has them.

use serde::{Deserialize, Serialize};

/// What went wrong, and what helps to recover.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Problem {
    /// Names the kind of problem; the same as `code`, as a URI.
    #[cfg_attr(feature = "openapi", schema(example = "urn:swarmbench:problem:round_over"))]
    pub r#type: String,
    /// The kind of problem, in words.
    #[cfg_attr(feature = "openapi", schema(example = "The round is over"))]
    pub title: String,
    /// The HTTP status.
    #[cfg_attr(feature = "openapi", schema(example = 409))]
    pub status: u16,
    /// What happened this time, and what to do.
    pub detail: String,
    /// The kind of problem, for programs.
    #[cfg_attr(feature = "openapi", schema(example = "round_over"))]
    pub code: String,
    /// The current round of the episode.
    pub round: Option<u32>,
    /// After how many milliseconds to try again.
    pub retry_after_ms: Option<u64>,
    /// The limit that was reached.
    pub limit: Option<Limit>,
    /// The fields that were refused.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<FieldProblem>,
}

/// A limit by its name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Limit {
    /// Its name; the unit is its last part.
    #[cfg_attr(feature = "openapi", schema(example = "body_bytes_max"))]
    pub name: String,
    /// Its value.
    #[cfg_attr(feature = "openapi", schema(example = 262_144))]
    pub value: u64,
}

/// A field that was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct FieldProblem {
    /// Its name.
    #[cfg_attr(feature = "openapi", schema(example = "width"))]
    pub field: String,
    /// What is allowed, and what came.
    #[cfg_attr(feature = "openapi", schema(example = "must be from 8 to 256, is 4"))]
    pub problem: String,
}
