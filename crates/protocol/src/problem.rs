//! Errors in the form of RFC 9457.

use serde::{Deserialize, Serialize};

/// Error, with facts that help to recover.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Problem {
    /// Kind of the problem as a URI; the same as `code`.
    #[cfg_attr(feature = "openapi", schema(example = "urn:swarmbench:problem:round_over"))]
    pub r#type: String,
    /// Kind of the problem, in words.
    #[cfg_attr(feature = "openapi", schema(example = "The round is over"))]
    pub title: String,
    /// HTTP status.
    #[cfg_attr(feature = "openapi", schema(example = 409))]
    pub status: u16,
    /// Explanation of this occurrence, and advice.
    pub detail: String,
    /// Kind of the problem, for programs.
    #[cfg_attr(feature = "openapi", schema(example = "round_over"))]
    pub code: String,
    /// Current round of the episode.
    pub round: Option<u32>,
    /// Milliseconds after which to try again.
    pub retry_after_ms: Option<u64>,
    /// Limit that was reached.
    pub limit: Option<Limit>,
    /// Fields that were refused.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<FieldProblem>,
}

/// Limit with its name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Limit {
    /// Name of the limit; the unit is its last part.
    #[cfg_attr(feature = "openapi", schema(example = "body_bytes_max"))]
    pub name: String,
    /// Value of the limit.
    #[cfg_attr(feature = "openapi", schema(example = 262_144))]
    pub value: u64,
}

/// Field that was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct FieldProblem {
    /// Name of the field.
    #[cfg_attr(feature = "openapi", schema(example = "width"))]
    pub field: String,
    /// Allowed values, and the value that was sent.
    #[cfg_attr(feature = "openapi", schema(example = "must be from 8 to 256, is 4"))]
    pub problem: String,
}
