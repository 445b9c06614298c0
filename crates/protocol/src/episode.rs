//! Episodes: requests and responses.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use swarmbench_engine::{AgentState, Seed, SpectatorView};

use super::status::Status;
use super::{Position, Seconds};
use crate::game_settings;

/// How an episode ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EpisodeResult {
    /// `task_done`, `rounds_played`, `aborted` or `idle`.
    #[cfg_attr(feature = "openapi", schema(example = "rounds_played"))]
    pub reason: String,
    /// The final score.
    pub score: f64,
    /// How many rounds were resolved.
    pub rounds: u32,
    /// The head of the journal's chain: it proves that a journal is this one.
    pub journal_head: String,
}

game_settings! {
    partial
    /// What an episode is to be. Everything but `task` has a default.
    #[derive(Clone, Debug, Default, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[serde(deny_unknown_fields)]
    #[cfg_attr(feature = "openapi", schema(example = json!({"task": "Transport", "seed": 27, "model": "my-model"})))]
    pub struct EpisodeRequest {
        /// `Transport`, `Pursuit`, `Synchronization`, `Foraging` or `Flocking`.
        #[cfg_attr(feature = "openapi", schema(required))]
        pub task: Option<String>,
        /// The seed of the layout, 0 to 2⁵³ − 1; drawn at random where it is left out.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 9_007_199_254_740_991_i64))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub seed: Option<i64>,
        /// `paper` or `reference`.
        #[cfg_attr(feature = "openapi", schema(default = "paper"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub rules: Option<String>,
        ..settings {
            /// `decentralized` or `centralized`.
            #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
            #[serde(skip_serializing_if = "Option::is_none")]
            pub control: Option<String>
        },
        /// A round's clock in seconds; none by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub round_deadline_s: Option<f64>,
        /// What a seat may overspend in all rounds together, in seconds.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub bank_s: Option<f64>,
        /// `now` or `manual`.
        #[cfg_attr(feature = "openapi", schema(default = "now"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub start: Option<String>,
        /// After so many seconds without any act it ends as abandoned.
        #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub idle_timeout_s: Option<f64>,
        /// `public` or `owner`: who reads state, events and resolved rounds before the end.
        #[cfg_attr(feature = "openapi", schema(default = "public"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub visibility: Option<String>,
        /// Who plays; at most 200 characters.
        #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub model: Option<String>,
        /// What else is known of who plays; at most 16 KiB of JSON.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub agent_meta: Option<Map<String, Value>>,
        /// A prompt template of the episode's own; at most 32 KiB.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub prompt_template: Option<String>,
        /// How many seats are open to claims, those of the last agents; the creator gets no tokens for them.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 1024))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub open_seats: Option<i64>,
        /// After so many seconds built-in players take the open seats that nobody claimed; never by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 604_800))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub fill_after_s: Option<f64>,
        /// Which built-in player takes them; `default` is the task's own.
        #[cfg_attr(feature = "openapi", schema(default = "default"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub fill_with: Option<String>,
        /// The built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the
        /// task's own.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub player: Option<String>,
    }
}

game_settings! {
    checked
    /// All settings of an episode, defaults filled in.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[expect(missing_docs, reason = "the same as in the request")]
    pub struct EpisodeConfig {
        pub task: String,
        /// Null as long as the episode runs and the caller may not know it.
        #[cfg_attr(feature = "openapi", schema(value_type = Option<u64>))]
        pub seed: Option<Seed>,
        pub rules: String,
        ..settings { pub control: String },
        pub round_deadline_s: Option<Seconds>,
        pub bank_s: Seconds,
        pub start: String,
        pub idle_timeout_s: Seconds,
        pub visibility: String,
        pub model: String,
        pub agent_meta: Map<String, Value>,
        /// Null for the built-in template; the journal has the text of either.
        pub prompt_template: Option<String>,
        #[serde(default)]
        pub open_seats: u16,
        #[serde(default)]
        pub fill_after_s: Option<Seconds>,
        #[serde(default)]
        pub fill_with: Option<String>,
        #[serde(default)]
        pub player: Option<String>,
    }
}

/// A new episode, with tokens that are shown this once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedEpisode {
    /// Its id.
    pub id: String,
    /// Its status.
    pub status: Status,
    /// All its settings.
    pub config: EpisodeConfig,
    /// A token for each agent whose seat is the creator's.
    pub seats: Vec<SeatToken>,
    /// A token for all of them, also if there are none; it has the rights of the creator, too.
    pub swarm_token: String,
}

/// The token of one agent.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatToken {
    /// The agent's name.
    pub agent: String,
    /// Its token.
    pub token: String,
}

/// An episode as it is listed.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EpisodeSummary {
    /// Its id.
    pub id: String,
    /// Its status.
    pub status: Status,
    /// The task.
    pub task: String,
    /// Who plays.
    pub model: String,
    /// The id of the run to which it belongs; null where it belongs to none.
    pub run: Option<String>,
    /// How many rounds were resolved.
    pub round: u32,
    /// The score so far.
    pub score: f64,
    /// When it was created.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = DateTime))]
    pub created_at: jiff::Timestamp,
    /// When it ended.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub ended_at: Option<jiff::Timestamp>,
    /// How it ended.
    pub result: Option<EpisodeResult>,
    /// Why it was voided, if it was.
    pub void_reason: Option<String>,
    /// All its settings.
    pub config: EpisodeConfig,
}

/// Why an episode counts for nothing.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", schema(example = json!({"reason": "power cut in round 40"})))]
pub struct VoidRequest {
    /// What went wrong: 1 to 500 characters. It is shown to everybody who may see the episode.
    #[cfg_attr(feature = "openapi", schema(min_length = 1, max_length = 500))]
    pub reason: String,
}

/// A page of episodes, newest first.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EpisodeList {
    /// The episodes of this page.
    pub items: Vec<EpisodeSummary>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// The whole world after some round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct State {
    /// How many rounds were resolved.
    pub round: u32,
    /// The score so far.
    pub score: f64,
    /// One character a cell, row by row: `.` `W` `B` `P` `F` `N`, agents `A`.
    pub grid: Vec<String>,
    /// All agents.
    pub agents: Vec<StateAgent>,
    /// Where the prey is (Pursuit).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prey: Option<Position>,
    /// The top-left cell of the block's shape (Transport).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block: Option<Position>,
    /// The cost of the placement (Flocking).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
}

/// An agent as a spectator sees it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StateAgent {
    /// Its name.
    pub agent: String,
    /// Its row; where it went when it escaped.
    pub i: i32,
    /// Its column.
    pub j: i32,
    /// Whether it is on the map.
    pub alive: bool,
    /// Whether its light is on (Synchronization).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_on: Option<bool>,
    /// Whether it carries food (Foraging).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carrying_food: Option<bool>,
}

/// What spectators get of a resolved round; the grid is in the state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RoundEvent {
    /// How many rounds were resolved with it.
    pub round: u32,
    /// The score after it.
    pub score: f64,
    /// All agents after it.
    pub agents: Vec<StateAgent>,
}

/// One Server-Sent Event, by the names of its fields. It is only described here: a stream writes its events itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamedEvent {
    /// `round` or `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "round"))]
    pub event: String,
    /// How many rounds were resolved; left out where it is `finished`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(example = "12"))]
    pub id: Option<String>,
    /// JSON: a `RoundEvent`, or the `EpisodeResult` where it is `finished`.
    pub data: String,
}

impl From<AgentState> for StateAgent {
    fn from(state: AgentState) -> Self {
        Self {
            agent: state.agent.to_string(),
            i: state.at.i,
            j: state.at.j,
            alive: state.alive,
            light_on: state.light_on,
            carrying_food: state.carrying_food,
        }
    }
}

impl From<SpectatorView> for State {
    fn from(seen: SpectatorView) -> Self {
        Self {
            round: seen.round,
            score: seen.score,
            grid: seen.grid,
            agents: seen.agents.into_iter().map(Into::into).collect(),
            prey: seen.prey.map(Into::into),
            block: seen.block.map(Into::into),
            distance: seen.distance,
        }
    }
}
