//! Requests and responses for episodes.

use serde::{Deserialize, Serialize};
use swarmbench_engine::{AgentState, Seed, SpectatorView};

use super::status::Status;
use super::{Position, Seconds};
use crate::carried::Carried;
use crate::game_settings;
use crate::time::Timestamp;

/// End of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EpisodeResult {
    /// Reason of the end: `task_done`, `rounds_played`, `aborted`, `closed` (the window of its attempt closed) or `idle`.
    #[cfg_attr(feature = "openapi", schema(example = "rounds_played"))]
    pub reason: String,
    /// Final score.
    pub score: f64,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Head of the journal's hash chain, which identifies the journal.
    pub journal_head: String,
}

game_settings! {
    partial
    /// Settings of a new episode. All but `task` have defaults.
    #[serde_with::skip_serializing_none]
    #[derive(Clone, Debug, Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"task": "Transport", "seed": 27, "model": "my-model"})))]
    pub struct EpisodeRequest {
        /// Task: `Transport`, `Pursuit`, `Synchronization`, `Foraging` or `Flocking`.
        #[serialize_always]
        #[cfg_attr(feature = "openapi", schema(required))]
        #[serde(default, deserialize_with = "crate::any_case::task")]
        pub task: Option<String>,
        /// Seed of the layout, 0 to 2⁵³ − 1; drawn at random by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 9_007_199_254_740_991_i64))]
        pub seed: Option<i64>,
        /// Rule set: `paper` or `reference`.
        #[cfg_attr(feature = "openapi", schema(default = "paper"))]
        #[serde(default, deserialize_with = "crate::any_case::rules")]
        pub rules: Option<String>,
        ..settings {
            /// `decentralized` or `centralized`.
            #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
            #[serde(default, deserialize_with = "crate::any_case::control")]
            pub control: Option<String>
        },
        /// Clock of a round in seconds; none by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
        pub round_deadline_s: Option<f64>,
        /// Time that a seat may overspend in all rounds together, in seconds.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
        pub bank_s: Option<f64>,
        /// Start of the episode: `now` or `manual`.
        #[cfg_attr(feature = "openapi", schema(default = "now"))]
        pub start: Option<String>,
        /// Seconds without any act after which the episode ends as abandoned.
        #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
        pub idle_timeout_s: Option<f64>,
        /// Readers of state, events and resolved rounds before the end: `public` (anyone) or `owner` (the creator).
        #[cfg_attr(feature = "openapi", schema(default = "public"))]
        pub visibility: Option<String>,
        /// Name of the model that plays; at most 200 characters.
        #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
        pub model: Option<String>,
        /// Further facts about the player; at most 16 KiB of JSON.
        #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
        pub agent_meta: Option<Carried>,
        /// Prompt template of the episode's own; at most 32 KiB.
        pub prompt_template: Option<String>,
        /// Number of seats that are open to claims, those of the last agents; the creator gets no tokens for them.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 1024))]
        pub open_seats: Option<i64>,
        /// Seconds after which built-in players take the unclaimed seats; never by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 604_800))]
        pub fill_after_s: Option<f64>,
        /// Built-in player that takes unclaimed seats; `default` is the task's own player.
        #[cfg_attr(feature = "openapi", schema(default = "default"))]
        pub fill_with: Option<String>,
        /// Built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the task's own
        /// player.
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
        /// Seed of the layout; null while the caller may not know it.
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
        #[cfg_attr(feature = "openapi", schema(value_type = serde_json::Map<String, serde_json::Value>))]
        pub agent_meta: Carried,
        /// Prompt template of the episode's own; null for the built-in template. The journal has the text of either.
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

/// Start and settings of a fork. Settings that are left out are as for a new episode, except the visibility and the prompt
/// template, which are the parent's. The settings of the simulation are the parent's and cannot be named.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"round": 12, "model": "my-model"})))]
pub struct ForkRequest {
    /// Number of rounds that are taken over, from 0 to the number of resolved rounds; also the first round to be played.
    #[serialize_always]
    #[cfg_attr(feature = "openapi", schema(required, minimum = 0, maximum = 10_000))]
    pub round: Option<i64>,
    /// Number of forks of the same state.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 64))]
    pub count: Option<i64>,
    /// Clock of a round in seconds; none by default. Banks are full, whatever was used before the fork.
    #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
    pub round_deadline_s: Option<f64>,
    /// Time that a seat may overspend in all rounds together, in seconds.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<f64>,
    /// Start of the fork: `now` or `manual`.
    #[cfg_attr(feature = "openapi", schema(default = "now"))]
    pub start: Option<String>,
    /// Seconds without any act after which the episode ends as abandoned.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<f64>,
    /// Readers of state, events and resolved rounds before the end: `public` (anyone) or `owner` (the creator); the parent's
    /// by default.
    pub visibility: Option<String>,
    /// Name of the model that plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
    pub model: Option<String>,
    /// Further facts about the player; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// Prompt template of the fork's own; at most 32 KiB. The parent's by default.
    pub prompt_template: Option<String>,
    /// Number of seats that are open to claims, those of the last agents; the creator gets no tokens for them.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 1024))]
    pub open_seats: Option<i64>,
    /// Seconds after which built-in players take the unclaimed seats; never by default.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 604_800))]
    pub fill_after_s: Option<f64>,
    /// Built-in player that takes unclaimed seats; `default` is the task's own player.
    #[cfg_attr(feature = "openapi", schema(default = "default"))]
    pub fill_with: Option<String>,
    /// Built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the task's own
    /// player.
    pub player: Option<String>,
}

/// Point at which an episode continues another one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Fork {
    /// Id of the other episode, the parent.
    pub episode: String,
    /// Number of rounds of the parent that were taken over.
    pub round: u32,
    /// Head of the parent's hash chain before that round; null while the caller may not know the seed.
    pub head: Option<String>,
}

/// New forks of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedForks {
    /// Point at which the forks continue their parent.
    pub fork: Fork,
    /// Forks, as many as requested.
    pub episodes: Vec<CreatedEpisode>,
}

/// New episode, with tokens that are shown only once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedEpisode {
    /// Id of the episode.
    pub id: String,
    /// Status of the episode.
    pub status: Status,
    /// All settings of the episode.
    pub config: EpisodeConfig,
    /// Tokens of the creator's seats, one for each seat.
    pub seats: Vec<SeatToken>,
    /// Token for all of these seats. It also has the rights of the creator, so it exists even without any seat.
    pub swarm_token: String,
}

/// Token of one agent.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatToken {
    /// Name of the agent.
    pub agent: String,
    /// Token of the agent.
    pub token: String,
}

/// Episode as it is listed.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EpisodeSummary {
    /// Id of the episode.
    pub id: String,
    /// Status of the episode.
    pub status: Status,
    /// Name of the task.
    pub task: String,
    /// Name of the model that plays.
    pub model: String,
    /// Id of the episode's run; null without a run.
    pub run: Option<String>,
    /// Number of resolved rounds.
    pub round: u32,
    /// Score so far.
    pub score: f64,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which the episode ended; null before.
    pub ended_at: Option<Timestamp>,
    /// End of the episode; null before.
    pub result: Option<EpisodeResult>,
    /// Reason for which the episode was voided; null if it was not.
    pub void_reason: Option<String>,
    /// Point at which the episode continues another one; null if it is no fork.
    #[serde(default)]
    pub fork: Option<Fork>,
    /// True if a person takes part, as declared by `agent_meta.kind`; false in an open episode with several holders.
    #[serde(default)]
    pub people: bool,
    /// True if seats are, or were, open to several holders.
    #[serde(default)]
    pub mixed: bool,
    /// Scores in equal steps of rounds, the first before round 0 and the last at the end: at most 32. Only in lists that ask for
    /// them, and only of ended episodes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve: Option<Vec<f64>>,
    /// All settings of the episode.
    pub config: EpisodeConfig,
}

/// Reason for voiding an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"reason": "power cut in round 40"})))]
pub struct VoidRequest {
    /// Fault that happened: 1 to 500 characters. It is shown to everybody who may see the episode.
    #[cfg_attr(feature = "openapi", schema(min_length = 1, max_length = 500))]
    pub reason: String,
}

page! {
    /// Page of episodes, newest first.
    EpisodeList of EpisodeSummary
}

page! {
    /// Page of the names of models, in order.
    ModelList of String
}

/// Whole world after some round.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct State {
    /// Number of resolved rounds.
    pub round: u32,
    /// Score so far.
    pub score: f64,
    /// Rows of the map, one character a cell: `.` `W` `B` `P` `F` `N`, agents `A`.
    pub grid: Vec<String>,
    /// All agents.
    pub agents: Vec<StateAgent>,
    /// Position of the prey (Pursuit).
    pub prey: Option<Position>,
    /// Top-left cell of the block's shape (Transport).
    pub block: Option<Position>,
    /// Cost of the placement (Flocking).
    pub distance: Option<f64>,
}

/// Agent as a spectator sees it.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StateAgent {
    /// Name of the agent.
    pub agent: String,
    /// Row of the agent; after an escape the row of the exit.
    pub i: i32,
    /// Column of the agent.
    pub j: i32,
    /// Whether the agent is on the map.
    pub alive: bool,
    /// Whether the agent's light is on (Synchronization).
    pub light_on: Option<bool>,
    /// Whether the agent carries food (Foraging).
    pub carrying_food: Option<bool>,
}

/// Event of a resolved round for spectators; the grid is in the state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RoundEvent {
    /// Number of resolved rounds, this one included.
    pub round: u32,
    /// Score after the round.
    pub score: f64,
    /// All agents after the round.
    pub agents: Vec<StateAgent>,
}

/// Fields of one Server-Sent Event. This type only describes them: a stream writes its events itself.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamedEvent {
    /// Kind of the event: `round` or `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "round"))]
    pub event: String,
    /// Number of resolved rounds; left out in `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "12"))]
    pub id: Option<String>,
    /// JSON: a `RoundEvent`, or in `finished` the `EpisodeResult`.
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
