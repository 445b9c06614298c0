//! Acts of agents and their receipts.

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
            /// Round that the act answers.
            pub round: u32,
            /// Action of the agent: one of the observation's `actions`.
            pub action: Option<String>,
            /// Message of the agent: one line. A longer message is cut to 120 characters and `...`. With `action` only.
            pub message: Option<String>,
            /// Only receiver of a commander's message (centralized control only). With `action` only.
            #[cfg_attr(feature = "openapi", schema(example = "Agent_7"))]
            pub to: Option<String>,
            /// Whole answer of a language model, with `ACTION: …` and/or `MSG: …`.
            pub response: Option<String>,
            /// Cost of the answer.
            pub usage: Option<Usage>,
            /// Free text, stored for replays.
            pub reasoning: Option<String>,
            /// Reason for which the model gave no answer, if only its client knows it: `refusal`, `content_filter`,
            /// `truncated`, `tool_call`, `reasoning_only` or `rejected`. With `response` only; recorded if the response is
            /// invalid.
            pub failure: Option<Failure>,
        }
    };
}

act! {
    /// Act of the token's agent: exactly one of `action` and `response`.
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"round": 12, "action": "UP", "message": "pushing left on row 3"})))]
    ActRequest {}
}

act! {
    /// Act for one of several seats: exactly one of `action` and `response`.
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"episode": "ep_0199f0c2a1d87c3e9b5a4d6f10e2b3c4", "agent": "Agent_3", "round": 12, "action": "UP"})))]
    SwarmAct {
        /// Id of the episode.
        episode,
        /// Name of the agent.
        agent,
    }
}

impl SwarmAct {
    /// Episode, agent, and the act as for a single seat.
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

    /// Act of one seat among several.
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
    /// Acts, each accepted or refused independently.
    pub acts: Vec<SwarmAct>,
}

/// Cost of a language model's answer.
#[serde_with::skip_serializing_none]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Usage {
    /// Tokens of the prompt.
    pub prompt_tokens: Option<u64>,
    /// Tokens of the answer.
    pub completion_tokens: Option<u64>,
    /// Time that the answer took, in milliseconds.
    pub latency_ms: Option<u64>,
}

/// Receipt of a durable act.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Receipt {
    /// Id of the episode.
    pub episode: String,
    /// Name of the agent.
    pub agent: String,
    /// Round of the act.
    pub round: u32,
    /// Action that counts; null without one.
    pub action: Option<String>,
    /// Message that is delivered; null without one.
    pub message: Option<String>,
    /// False for an invalid answer of a language model: the agent does nothing in this round.
    pub valid: bool,
    /// Reason for which the answer is invalid; left out if it is valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Whether the same act was sent before.
    pub duplicate: bool,
    /// Number of seats for which the round waited after this act.
    pub waiting_for: u32,
}

/// Receipt and, if requested, the next observation.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ActResponse {
    /// Receipt of the act.
    #[serde(flatten)]
    pub receipt: Receipt,
    /// Next observation, with `wait`; null after a timeout.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(nullable))]
    pub obs: Option<Observation>,
}

/// Result of one of several acts.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged, expecting = "a receipt or a problem was expected")]
pub enum SwarmReceipt {
    /// The act is durable.
    Receipt(Receipt),
    /// The act was refused, with a `status` of its own.
    Problem(Problem),
}

/// Results of several acts and, if requested, the next observations of their seats.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SwarmActResponse {
    /// Results in the order of the acts.
    pub receipts: Vec<SwarmReceipt>,
    /// Next observations, with `wait`: of each seat whose act counts, in the order of the acts. Observations that are not
    /// available yet are left out.
    #[cfg_attr(feature = "openapi", schema(value_type = Vec<Observation>, required = false))]
    pub observations: Option<Vec<Observation>>,
    /// Whether all episodes of the token have ended, with `wait`.
    #[cfg_attr(feature = "openapi", schema(value_type = bool, required = false))]
    pub finished: Option<bool>,
    /// Reason for which the request did not wait or has no observations, with `wait`; left out if nothing failed.
    #[cfg_attr(feature = "openapi", schema(value_type = Problem, required = false))]
    pub problem: Option<Problem>,
}

/// Observations that wait for an act.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SwarmObsResponse {
    /// Observations, oldest first.
    pub observations: Vec<Observation>,
    /// Cursor for `after`: the next call returns only what was opened since.
    pub cursor: String,
    /// Whether all episodes of the token have ended.
    pub finished: bool,
}
