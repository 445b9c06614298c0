//! Keys for people.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

/// What an organizer asks for somebody.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct KeyRequest {
    /// Whose it is: 1 to 100 characters.
    #[cfg_attr(
        feature = "openapi",
        schema(example = "team blue", min_length = 1, max_length = 100)
    )]
    pub name: String,
    /// `entrant`, `member` (the default) or `organizer`.
    #[cfg_attr(feature = "openapi", schema(example = "member"))]
    pub role: Option<String>,
    /// From when on it is worth nothing; never where it is left out.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub expires_at: Option<Timestamp>,
}

/// A key as it is shown: all but the key itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct KeySummary {
    /// Its id.
    #[cfg_attr(feature = "openapi", schema(example = "key_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Whose it is.
    pub name: String,
    /// `entrant`, `member` or `organizer`.
    pub role: String,
    /// `good`, `expired` or `revoked`.
    pub state: String,
    /// When it was made.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub created_at: Timestamp,
    /// From when on it is worth nothing.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub expires_at: Option<Timestamp>,
    /// When it was revoked.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub revoked_at: Option<Timestamp>,
}

/// A new key, shown this once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedKey {
    /// What is stored of it.
    #[serde(flatten)]
    pub key: KeySummary,
    /// The key itself, to be sent as `Authorization: Bearer …`; it cannot be shown again.
    pub secret: String,
}

/// All keys that were ever made.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct KeyList {
    /// The keys, oldest first.
    pub items: Vec<KeySummary>,
    /// Where the next page begins; null on the last one.
    pub next_cursor: Option<String>,
}
