//! Episodes: requests and responses.

use serde::{Deserialize, Serialize};
use swarmbench_engine::{AgentState, Seed, SpectatorView};

use super::status::Status;
use super::{Position, Seconds};
use crate::carried::Carried;
use crate::game_settings;
use crate::time::Timestamp;

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
    /// The head of the journal's chain, which identifies the journal.
    pub journal_head: String,
}

game_settings! {
    partial
    /// What an episode is to be. Everything but `task` has a default.
    #[serde_with::skip_serializing_none]
    #[derive(Clone, Debug, Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"task": "Transport", "seed": 27, "model": "my-model"})))]
    pub struct EpisodeRequest {
        /// `Transport`, `Pursuit`, `Synchronization`, `Foraging` or `Flocking`.
        #[serialize_always]
        #[cfg_attr(feature = "openapi", schema(required))]
        #[serde(default, deserialize_with = "crate::any_case::task")]
        pub task: Option<String>,
        /// The seed of the layout, 0 to 2⁵³ − 1; drawn at random where it is left out.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 9_007_199_254_740_991_i64))]
        pub seed: Option<i64>,
        /// `paper` or `reference`.
        #[cfg_attr(feature = "openapi", schema(default = "paper"))]
        #[serde(default, deserialize_with = "crate::any_case::rules")]
        pub rules: Option<String>,
        ..settings {
            /// `decentralized` or `centralized`.
            #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
            #[serde(default, deserialize_with = "crate::any_case::control")]
            pub control: Option<String>
        },
        /// A round's clock in seconds; none by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
        pub round_deadline_s: Option<f64>,
        /// What a seat may overspend in all rounds together, in seconds.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
        pub bank_s: Option<f64>,
        /// `now` or `manual`.
        #[cfg_attr(feature = "openapi", schema(default = "now"))]
        pub start: Option<String>,
        /// Seconds without any act after which the episode ends as abandoned.
        #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
        pub idle_timeout_s: Option<f64>,
        /// `public` or `owner`: who reads state, events and resolved rounds before the end.
        #[cfg_attr(feature = "openapi", schema(default = "public"))]
        pub visibility: Option<String>,
        /// Who plays; at most 200 characters.
        #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
        pub model: Option<String>,
        /// What else is known of who plays; at most 16 KiB of JSON.
        #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
        pub agent_meta: Option<Carried>,
        /// A prompt template of the episode's own; at most 32 KiB.
        pub prompt_template: Option<String>,
        /// How many seats are open to claims, those of the last agents; the creator gets no tokens for them.
        #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 1024))]
        pub open_seats: Option<i64>,
        /// Seconds after which built-in players take the unclaimed seats; never by default.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 604_800))]
        pub fill_after_s: Option<f64>,
        /// The built-in player that takes unclaimed seats; `default` is the task's own.
        #[cfg_attr(feature = "openapi", schema(default = "default"))]
        pub fill_with: Option<String>,
        /// The built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the
        /// task's own.
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
        /// Null while the caller may not know it.
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

/// From where a fork plays on, and how. What is left out is as for a new episode, but for the visibility and the prompt
/// template, which are those of the parent. The settings of the simulation are the parent's and cannot be named.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"round": 12, "model": "my-model"})))]
pub struct ForkRequest {
    /// How many rounds are taken over: from 0 to those that were resolved; also the first round to be played.
    #[serialize_always]
    #[cfg_attr(feature = "openapi", schema(required, minimum = 0, maximum = 10_000))]
    pub round: Option<i64>,
    /// How many forks of the same state are made.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 64))]
    pub count: Option<i64>,
    /// A round's clock in seconds; none by default. Banks are full, whatever was used before the fork.
    #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
    pub round_deadline_s: Option<f64>,
    /// What a seat may overspend in all rounds together, in seconds.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<f64>,
    /// `now` or `manual`.
    #[cfg_attr(feature = "openapi", schema(default = "now"))]
    pub start: Option<String>,
    /// Seconds without any act after which the episode ends as abandoned.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<f64>,
    /// `public` or `owner`: who reads state, events and resolved rounds before the end; the parent's by default.
    pub visibility: Option<String>,
    /// Who plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(default = "unnamed"))]
    pub model: Option<String>,
    /// What else is known of who plays; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// A prompt template of the fork's own; at most 32 KiB. The parent's by default.
    pub prompt_template: Option<String>,
    /// How many seats are open to claims, those of the last agents; the creator gets no tokens for them.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 1024))]
    pub open_seats: Option<i64>,
    /// Seconds after which built-in players take the unclaimed seats; never by default.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 604_800))]
    pub fill_after_s: Option<f64>,
    /// The built-in player that takes unclaimed seats; `default` is the task's own.
    #[cfg_attr(feature = "openapi", schema(default = "default"))]
    pub fill_with: Option<String>,
    /// The built-in player that the server hosts on the creator's seats, which then have no tokens; `default` is the
    /// task's own.
    pub player: Option<String>,
}

/// Where an episode continues another one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Fork {
    /// The id of the other episode, its parent.
    pub episode: String,
    /// How many rounds of the parent were taken over.
    pub round: u32,
    /// The head of the parent's chain before that round; null while the caller may not know the seed.
    pub head: Option<String>,
}

/// New forks of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedForks {
    /// Where they continue their parent.
    pub fork: Fork,
    /// The forks: as many as were asked for.
    pub episodes: Vec<CreatedEpisode>,
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
    /// A token for each seat of the creator.
    pub seats: Vec<SeatToken>,
    /// A token for all of these seats. It has the rights of the creator, too, so it exists even without any seat.
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
    /// The id of its run; null without a run.
    pub run: Option<String>,
    /// How many rounds were resolved.
    pub round: u32,
    /// The score so far.
    pub score: f64,
    /// When it was created.
    pub created_at: Timestamp,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
    /// How it ended.
    pub result: Option<EpisodeResult>,
    /// Why it was voided, if it was.
    pub void_reason: Option<String>,
    /// Where it continues another episode, if it is a fork.
    #[serde(default)]
    pub fork: Option<Fork>,
    /// All its settings.
    pub config: EpisodeConfig,
}

/// Why an episode is voided.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"reason": "power cut in round 40"})))]
pub struct VoidRequest {
    /// What went wrong: 1 to 500 characters. It is shown to everybody who may see the episode.
    #[cfg_attr(feature = "openapi", schema(min_length = 1, max_length = 500))]
    pub reason: String,
}

page! {
    /// A page of episodes, newest first.
    EpisodeList of EpisodeSummary
}

/// The whole world after some round.
#[serde_with::skip_serializing_none]
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
    pub prey: Option<Position>,
    /// The top-left cell of the block's shape (Transport).
    pub block: Option<Position>,
    /// The cost of the placement (Flocking).
    pub distance: Option<f64>,
}

/// An agent as a spectator sees it.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StateAgent {
    /// Its name.
    pub agent: String,
    /// Its row; after an escape the row of the exit.
    pub i: i32,
    /// Its column.
    pub j: i32,
    /// Whether it is on the map.
    pub alive: bool,
    /// Whether its light is on (Synchronization).
    pub light_on: Option<bool>,
    /// Whether it carries food (Foraging).
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

/// The fields of one Server-Sent Event. This type only describes them: a stream writes its events itself.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamedEvent {
    /// `round` or `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "round"))]
    pub event: String,
    /// How many rounds were resolved; left out in `finished`.
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
