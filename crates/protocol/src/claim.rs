//! Seats of an episode that belong to several holders.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::episode::SeatToken;
use super::status::Status;

/// Which open seats somebody wants, and who plays there.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", schema(example = json!({"seats": 2, "model": "my-model"})))]
pub struct ClaimRequest {
    /// The agent whose seat is wanted; any that is open where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(example = "Agent_7"))]
    pub agent: Option<String>,
    /// How many open seats are wanted, whichever they are; all of them or none are given.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 1024))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seats: Option<i64>,
    /// Who plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// What else is known of who plays; at most 16 KiB of JSON.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub agent_meta: Option<Map<String, Value>>,
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
    /// How many seats nobody holds.
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
    /// The name on the holder's key, where one was shown; `server` where the server plays.
    pub holder: Option<String>,
    /// Who plays.
    pub model: Option<String>,
    /// The built-in player that the server hosts here.
    pub player: Option<String>,
    /// Since when.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub claimed_at: Option<Timestamp>,
}
