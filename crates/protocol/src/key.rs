//! Keys for people.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// A key that an organizer creates for somebody.
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
    /// `entrant`, `member` (the default), `judge` or `organizer`.
    #[cfg_attr(feature = "openapi", schema(example = "member"))]
    pub role: Option<String>,
    /// When it expires; never by default.
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
    /// `entrant`, `member`, `judge` or `organizer`.
    pub role: String,
    /// `good`, `expired` or `revoked`.
    pub state: String,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it expires.
    pub expires_at: Option<Timestamp>,
    /// When it was revoked.
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

page! {
    /// All keys that were ever made, oldest first.
    KeyList of KeySummary
}
