//! Seats of an episode that belong to several holders.

use serde::{Deserialize, Serialize};

use super::episode::SeatToken;
use super::status::Status;
use crate::carried::Carried;
use crate::time::Timestamp;

/// Claim to open seats, and the player of these seats.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"seats": 2, "model": "my-model"})))]
pub struct ClaimRequest {
    /// Agent whose seat is claimed; any open seat by default.
    #[cfg_attr(feature = "openapi", schema(example = "Agent_7"))]
    pub agent: Option<String>,
    /// Number of open seats to claim. The claim gets all of them, or is refused.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 1024))]
    pub seats: Option<i64>,
    /// Name of the model that plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
    pub model: Option<String>,
    /// Further facts about the player; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
}

/// Claimed seats, with tokens that are shown only once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedClaim {
    /// Id of the episode.
    pub episode: String,
    /// Status of the episode now: the claim of the last open seat starts it.
    pub status: Status,
    /// Number of the claim in its episode, from 1.
    pub claim: u32,
    /// Tokens of the claimed seats, one for each seat.
    pub seats: Vec<SeatToken>,
    /// Token for all of these seats, and for no others.
    pub swarm_token: String,
}

/// Holders of the seats of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatList {
    /// Number of unclaimed seats.
    pub open: u16,
    /// All seats, in order of the agents' numbers.
    pub seats: Vec<SeatHolder>,
}

/// Holder of a seat. All fields but the agent are null while the seat is open.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatHolder {
    /// Name of the agent.
    pub agent: String,
    /// Number of the claim; 0 is the creator.
    pub claim: Option<u32>,
    /// Name on the key of the claim, if one was sent; `server` if the server plays. Seats of the creator have none.
    pub holder: Option<String>,
    /// Name of the model that plays.
    pub model: Option<String>,
    /// Built-in player that the server hosts on this seat.
    pub player: Option<String>,
    /// Time from which the holder has the seat.
    pub claimed_at: Option<Timestamp>,
}
