//! Seats of an episode that belong to several holders.

use serde::{Deserialize, Serialize};

use super::episode::SeatToken;
use super::status::Status;
use crate::carried::Carried;
use crate::time::Timestamp;

/// A claim to open seats, and who plays there.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"seats": 2, "model": "my-model"})))]
pub struct ClaimRequest {
    /// The agent whose seat is wanted; by default any open seat.
    #[cfg_attr(feature = "openapi", schema(example = "Agent_7"))]
    pub agent: Option<String>,
    /// How many open seats are wanted. The claim gets all of them, or is refused.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 1024))]
    pub seats: Option<i64>,
    /// Who plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
    pub model: Option<String>,
    /// What else is known of who plays; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
}

/// Claimed seats, with tokens that are shown this once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedClaim {
    /// The episode.
    pub episode: String,
    /// Its status now: the last open seat starts it.
    pub status: Status,
    /// The number of the claim in its episode, from 1.
    pub claim: u32,
    /// A token for each of the seats.
    pub seats: Vec<SeatToken>,
    /// A token for all of them, and for no others.
    pub swarm_token: String,
}

/// Who holds which seat of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatList {
    /// How many seats are unclaimed.
    pub open: u16,
    /// All seats, in order of the agents' numbers.
    pub seats: Vec<SeatHolder>,
}

/// Who holds a seat. All but the agent is null where it is open.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatHolder {
    /// The agent.
    pub agent: String,
    /// The number of the claim; 0 is the creator.
    pub claim: Option<u32>,
    /// The name on the holder's key, if a key was sent; `server` if the server plays.
    pub holder: Option<String>,
    /// Who plays.
    pub model: Option<String>,
    /// The built-in player that the server hosts here.
    pub player: Option<String>,
    /// Since when.
    pub claimed_at: Option<Timestamp>,
}
