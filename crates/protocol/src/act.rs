//! What an agent decides, and the receipts it gets.

use serde::{Deserialize, Serialize};

use super::failure::Failure;
use super::observation::Observation;
use super::problem::Problem;

/// Defines an act: its own names, then the fields that all acts share.
macro_rules! act {
    ($(#[$meta:meta])* $name:ident { $($(#[$own_meta:meta])* $own:ident,)* }) => {
        #[serde_with::skip_serializing_none]
        #[derive(Clone, Debug, Default, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        $(#[$meta])*
        pub struct $name {
            $($(#[$own_meta])* pub $own: String,)*
            /// The round that it answers.
            pub round: u32,
            /// What the agent does: one of the observation's `actions`.
            pub action: Option<String>,
            /// What it says: one line. Of a longer one than 120 characters 120 stay, and `...` follows. With `action` only.
            pub message: Option<String>,
            /// The only receiver of a commander's message (centralized control only). With `action` only.
            #[cfg_attr(feature = "openapi", schema(example = "Agent_7"))]
            pub to: Option<String>,
            /// The whole answer of a language model, with `ACTION: …` and/or `MSG: …`.
            pub response: Option<String>,
            /// What the answer cost.
            pub usage: Option<Usage>,
            /// Free text, stored for replays.
            pub reasoning: Option<String>,
            /// Why the model gave no answer, where only its client knows: `refusal`, `content_filter`, `truncated`,
            /// `tool_call`, `reasoning_only` or `rejected`. With `response` only; it is recorded if the response is invalid.
            pub failure: Option<Failure>,
        }
    };
}

act! {
    /// An act of the token's agent: exactly one of `action` and `response`.
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"round": 12, "action": "UP", "message": "pushing left on row 3"})))]
    ActRequest {}
}

act! {
    /// An act for one of several seats: exactly one of `action` and `response`.
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"episode": "ep_0199f0c2a1d87c3e9b5a4d6f10e2b3c4", "agent": "Agent_3", "round": 12, "action": "UP"})))]
    SwarmAct {
        /// The episode.
        episode,
        /// The agent's name.
        agent,
    }
}

impl SwarmAct {
    /// Whose act it is (episode and agent), and the act as for a single seat.
    #[must_use]
    pub fn split(self) -> (String, String, ActRequest) {
        let Self {
            episode,
            agent,
            round,
            action,
            message,
            to,
            response,
            usage,
            reasoning,
            failure,
        } = self;
        let act = ActRequest { round, action, message, to, response, usage, reasoning, failure };
        (episode, agent, act)
    }

    /// An act of one seat among several.
    #[must_use]
    pub fn of(episode: String, agent: String, act: ActRequest) -> Self {
        let ActRequest { round, action, message, to, response, usage, reasoning, failure } = act;
        Self { episode, agent, round, action, message, to, response, usage, reasoning, failure }
    }
}

/// Acts for several seats, at most 1,024 of at most 256 KiB each.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SwarmActRequest {
    /// The acts; each is accepted or refused on its own.
    pub acts: Vec<SwarmAct>,
}

/// What a language model's answer cost.
#[serde_with::skip_serializing_none]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Usage {
    /// Tokens of the prompt.
    pub prompt_tokens: Option<u64>,
    /// Tokens of the answer.
    pub completion_tokens: Option<u64>,
    /// How long the answer took, in milliseconds.
    pub latency_ms: Option<u64>,
}

/// An act is durable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Receipt {
    /// The episode.
    pub episode: String,
    /// The agent.
    pub agent: String,
    /// The round.
    pub round: u32,
    /// The action that counts; null without one.
    pub action: Option<String>,
    /// The message that is delivered; null without one.
    pub message: Option<String>,
    /// False for an invalid answer of a language model: the agent does nothing this round.
    pub valid: bool,
    /// Why the answer is invalid; left out where it is valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Whether the same act had been sent before.
    pub duplicate: bool,
    /// How many seats the round waited for after this act.
    pub waiting_for: u32,
}

/// A receipt and, if requested, the next observation.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ActResponse {
    /// The receipt.
    #[serde(flatten)]
    pub receipt: Receipt,
    /// With `wait`: the next observation; null after a timeout.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(nullable))]
    pub obs: Option<Observation>,
}

/// The result of one of several acts.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged, expecting = "a receipt or a problem was expected")]
pub enum SwarmReceipt {
    /// It is durable.
    Receipt(Receipt),
    /// It was refused, with a `status` of its own.
    Problem(Problem),
}

/// The results of several acts and, if requested, what their seats see next.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SwarmActResponse {
    /// In the order of the acts.
    pub receipts: Vec<SwarmReceipt>,
    /// With `wait`: the next observation of each seat whose act counts, in the order of the acts. Those that cannot be seen
    /// yet are left out.
    #[cfg_attr(feature = "openapi", schema(value_type = Vec<Observation>, required = false))]
    pub observations: Option<Vec<Observation>>,
    /// With `wait`: whether all episodes of the token have ended.
    #[cfg_attr(feature = "openapi", schema(value_type = bool, required = false))]
    pub finished: Option<bool>,
    /// With `wait`: why the request did not wait, or has no observations; left out where nothing failed.
    #[cfg_attr(feature = "openapi", schema(value_type = Problem, required = false))]
    pub problem: Option<Problem>,
}

/// The observations that wait for an act.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SwarmObsResponse {
    /// The oldest first.
    pub observations: Vec<Observation>,
    /// With `after`, the next call returns only what was opened since.
    pub cursor: String,
    /// Whether all episodes of the token have ended.
    pub finished: bool,
}
