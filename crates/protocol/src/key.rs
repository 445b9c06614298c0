//! Keys of people.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// New key, which an organizer creates for somebody.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct KeyRequest {
    /// Name of the holder: 1 to 100 characters.
    #[cfg_attr(
        feature = "openapi",
        schema(example = "team blue", min_length = 1, max_length = 100)
    )]
    pub name: String,
    /// Role: `entrant`, `member` (the default), `judge` or `organizer`.
    #[cfg_attr(feature = "openapi", schema(example = "member"))]
    pub role: Option<String>,
    /// Time at which the key expires; never by default.
    pub expires_at: Option<Timestamp>,
}

/// Key as it is shown: everything except the key itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct KeySummary {
    /// Id of the key.
    #[cfg_attr(feature = "openapi", schema(example = "key_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Name of the holder.
    pub name: String,
    /// Role: `entrant`, `member`, `judge` or `organizer`.
    pub role: String,
    /// State: `good`, `expired` or `revoked`.
    pub state: String,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which the key expires; null if it never does.
    pub expires_at: Option<Timestamp>,
    /// Time at which the key was revoked; null if it was not.
    pub revoked_at: Option<Timestamp>,
}

/// New key, shown only once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedKey {
    /// Stored facts about the key.
    #[serde(flatten)]
    pub key: KeySummary,
    /// The key itself, to be sent as `Authorization: Bearer …`; it cannot be shown again.
    pub secret: String,
}

page! {
    /// All keys that were ever made, oldest first.
    KeyList of KeySummary
}
