//! Keys for people.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What an organizer asks for somebody.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct KeyRequest {
    /// Whose it is: 1 to 100 characters.
    #[schema(example = "team blue", min_length = 1, max_length = 100)]
    pub name: String,
    /// `entrant`, `member` (the default) or `organizer`.
    #[schema(example = "member")]
    pub role: Option<String>,
    /// From when on it is worth nothing; never where it is left out.
    #[schema(value_type = Option<String>, format = "date-time")]
    pub expires_at: Option<Timestamp>,
}

/// A key as it is shown: all but the key itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct KeySummary {
    /// Its id.
    #[schema(example = "key_0198f2c55cf77c3e8f1be8a0c1a2b3c4")]
    pub id: String,
    /// Whose it is.
    pub name: String,
    /// `entrant`, `member` or `organizer`.
    pub role: String,
    /// `good`, `expired` or `revoked`.
    pub state: String,
    /// When it was made.
    #[schema(value_type = String, format = "date-time")]
    pub created_at: Timestamp,
    /// From when on it is worth nothing.
    #[schema(value_type = Option<String>, format = "date-time")]
    pub expires_at: Option<Timestamp>,
    /// When it was revoked.
    #[schema(value_type = Option<String>, format = "date-time")]
    pub revoked_at: Option<Timestamp>,
}

impl KeySummary {
    /// A key at a moment.
    #[must_use]
    pub fn of(key: &crate::keys::Key, now: Timestamp) -> Self {
        Self {
            id: key.id.clone(),
            name: key.name.clone(),
            role: key.role.name().to_owned(),
            state: key.state(now).to_owned(),
            created_at: key.created_at,
            expires_at: key.expires_at,
            revoked_at: key.revoked_at,
        }
    }
}

/// A new key, shown this once.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
pub struct CreatedKey {
    /// What is stored of it.
    #[serde(flatten)]
    pub key: KeySummary,
    /// The key itself, to be sent as `Authorization: Bearer …`; it cannot be shown again.
    pub secret: String,
}

/// All keys that were ever made.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
pub struct KeyList {
    /// The keys, oldest first.
    pub items: Vec<KeySummary>,
    /// Where the next page begins; null on the last one.
    pub next_cursor: Option<String>,
}
