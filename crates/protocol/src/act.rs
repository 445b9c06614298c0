//! Acts of agents and their receipts.

use serde::{Deserialize, Serialize};

use super::failure::Failure;
use super::observation::Observation;
use super::problem::Problem;
use super::replay::ShownAct;

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
            /// What the player's program added to the prompt, and keeps for the next one. With `response` only; no other seat
            /// reads it.
            pub harness: Option<Box<Harness>>,
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

/// An act with the fields that all acts share, and its own.
macro_rules! shared {
    ($act:ident, $name:ident { $($own:ident),* }) => {
        $name {
            $($own,)*
            round: $act.round,
            action: $act.action,
            message: $act.message,
            to: $act.to,
            response: $act.response,
            usage: $act.usage,
            reasoning: $act.reasoning,
            failure: $act.failure,
            harness: $act.harness,
        }
    };
}

impl SwarmAct {
    /// Episode, agent, and the act as for a single seat.
    #[must_use]
    pub fn split(self) -> (String, String, ActRequest) {
        (self.episode, self.agent, shared!(self, ActRequest {}))
    }

    /// Act of one seat among several.
    #[must_use]
    pub fn of(episode: String, agent: String, act: ActRequest) -> Self {
        shared!(act, SwarmAct { episode, agent })
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
    /// Time from the beginning of the request to the first token of a streamed answer, its reasoning included, in milliseconds.
    pub first_token_ms: Option<u64>,
    /// Tokens of the prompt that were read from a cache; part of `prompt_tokens`.
    pub cached_tokens: Option<u64>,
    /// Tokens of the prompt that were written into a cache; part of `prompt_tokens`.
    pub cache_write_tokens: Option<u64>,
    /// Tokens of reasoning; part of `completion_tokens`.
    pub reasoning_tokens: Option<u64>,
    /// Cost in billionths of a US dollar: as the endpoint reported it, or else by the client's prices.
    pub cost_nano_usd: Option<u64>,
}

/// Sums over answers of what was reported beside the tokens of prompts and answers. Sums of 0 are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(default)]
pub struct UsageSums {
    /// Tokens of prompts that were read from a cache.
    #[serde(skip_serializing_if = "is_zero")]
    pub cached_tokens: u64,
    /// Tokens of prompts that were written into a cache.
    #[serde(skip_serializing_if = "is_zero")]
    pub cache_write_tokens: u64,
    /// Tokens of reasoning.
    #[serde(skip_serializing_if = "is_zero")]
    pub reasoning_tokens: u64,
    /// Cost in billionths of a US dollar, of the answers whose cost is known.
    #[serde(skip_serializing_if = "is_zero")]
    pub cost_nano_usd: u64,
    /// Answers whose cost is known.
    #[serde(skip_serializing_if = "is_zero")]
    pub priced: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(sum: &u64) -> bool {
    *sum == 0
}

impl UsageSums {
    /// Nothing was reported.
    pub const NONE: Self = Self {
        cached_tokens: 0,
        cache_write_tokens: 0,
        reasoning_tokens: 0,
        cost_nano_usd: 0,
        priced: 0,
    };

    /// Adds the usage of an answer. Players may report any number, so the sums saturate.
    pub fn count(&mut self, usage: &Usage) {
        self.add(&Self {
            cached_tokens: usage.cached_tokens.unwrap_or(0),
            cache_write_tokens: usage.cache_write_tokens.unwrap_or(0),
            reasoning_tokens: usage.reasoning_tokens.unwrap_or(0),
            cost_nano_usd: usage.cost_nano_usd.unwrap_or(0),
            priced: u64::from(usage.cost_nano_usd.is_some()),
        });
    }

    /// Adds the sums of other answers.
    pub fn add(&mut self, more: &Self) {
        for (sum, more) in [
            (&mut self.cached_tokens, more.cached_tokens),
            (&mut self.cache_write_tokens, more.cache_write_tokens),
            (&mut self.reasoning_tokens, more.reasoning_tokens),
            (&mut self.cost_nano_usd, more.cost_nano_usd),
            (&mut self.priced, more.priced),
        ] {
            *sum = sum.saturating_add(more);
        }
    }

    /// True if nothing was reported.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::NONE
    }

    /// Cost in US dollars; `None` if no cost is known. It is less than the whole where `priced` is less than the answers.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "dollars are rounded anyway")]
    pub fn cost_usd(&self) -> Option<f64> {
        (self.priced > 0).then(|| self.cost_nano_usd as f64 / 1e9)
    }
}

/// What stood between a prompt of the server and a model: with the prompt, what the model was sent, and what is kept for its
/// next question. Parts without content are left out.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Harness {
    /// Earlier rounds whose prompts and answers of this seat came before the prompt, in ascending order; at most 20.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "openapi", schema(max_items = 20))]
    pub history: Vec<u32>,
    /// Those of these rounds whose encrypted reasoning came with their answers, which is stored nowhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "openapi", schema(max_items = 20))]
    pub carried: Vec<u32>,
    /// Text after the prompt, such as the notes of earlier rounds.
    pub added: Option<String>,
    /// Notes of the seat after the answer, for its next question.
    pub scratchpad: Option<String>,
    /// Invalid answers before the one of the act, in order; at most 8. The usage of the act counts them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "openapi", schema(max_items = 8))]
    pub tries: Vec<Try>,
}

/// Invalid answer of a model, and the reply to it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Try {
    /// Answer of the model.
    pub response: String,
    /// What the model was told, with which it was asked again.
    pub told: String,
}

impl Harness {
    /// Maximum rounds in `history`, and in `carried`.
    pub const ROUNDS_MAX: u8 = 20;

    /// Maximum number of tries.
    pub const TRIES_MAX: u8 = 8;

    /// Maximum bytes of all texts together.
    pub const BYTES_MAX: usize = 64 * 1024;

    /// Texts, from the one that is missed least to the one that is missed most.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let tries = self.tries.iter().flat_map(|one| [&one.response, &one.told]);
        tries.chain(&self.added).chain(&self.scratchpad).map(String::as_str)
    }

    /// Leaves out the texts that are missed least, all but the notes; false if there are none.
    pub fn shorten(&mut self) -> bool {
        let has_texts = !self.tries.is_empty() || self.added.is_some();
        (self.tries, self.added) = (Vec::new(), None);
        has_texts
    }

    /// Fault of the contents for an act of `round`: the field and what is wrong.
    #[must_use]
    pub fn fault(&self, round: u32) -> Option<(&'static str, String)> {
        let Self { history, carried, tries, .. } = self;
        let bytes: usize = self.texts().map(str::len).sum();
        let [rounds, most] = [Self::ROUNDS_MAX, Self::TRIES_MAX].map(usize::from);
        let texts = Self::BYTES_MAX;
        let is_past =
            history.is_sorted_by(|a, b| a < b) && history.last().is_none_or(|last| *last < round);
        let is_known = carried.is_sorted_by(|a, b| a < b)
            && carried.iter().all(|round| history.contains(round));
        if history.len() > rounds || !is_past {
            let problem =
                format!("must be at most {rounds} rounds before {round}, in ascending order");
            Some(("harness.history", problem))
        } else if !is_known {
            Some(("harness.carried", "must be rounds of `history`, in ascending order".to_owned()))
        } else if tries.len() > most {
            Some(("harness.tries", format!("must be at most {most}, are {}", tries.len())))
        } else {
            let problem = format!("must have at most {texts} bytes of text, has {bytes}");
            (bytes > texts).then_some(("harness", problem))
        }
    }
}

/// Earlier acts of a seat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatActs {
    /// Acts of the newest resolved rounds in which the seat acted, in ascending order of rounds.
    pub acts: Vec<SeatAct>,
}

/// Earlier act of a seat.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeatAct {
    /// Round of the act.
    pub round: u32,
    /// Text for a language model in that round; only if requested.
    pub prompt: Option<String>,
    /// Act as it was recorded.
    pub act: ShownAct,
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
