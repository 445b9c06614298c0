//! Replays: the states of a game page by page, single acts with all that led to them, scores, and results of verifications.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::act::{Harness, Usage};
use crate::failure::Failure;
use crate::observation::Sight;
use crate::time::Timestamp;

/// Page of the states of a game.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Replay {
    /// Part that is the same on all pages, or changes while the game runs.
    #[serde(flatten)]
    pub head: ReplayHead,
    /// States of this page.
    #[serde(flatten)]
    pub page: ReplayPage,
}

/// Facts about the whole game.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayHead {
    /// Id of the game.
    pub episode: String,
    /// Name of the task.
    pub task: String,
    /// Rule set: `paper` or `reference`; left out if an imported game does not name it.
    pub rules: Option<String>,
    /// `decentralized` or `centralized`; left out if an imported game does not name it.
    pub control: Option<String>,
    /// Status of the episode; `imported` for an imported game.
    pub status: String,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Number of rounds after which the game ends.
    pub max_round: Option<u32>,
    /// Score after the resolved rounds.
    pub score: f64,
    /// Columns of the map.
    pub width: u32,
    /// Rows of the map.
    pub height: u32,
    /// Number of agents.
    pub num_agents: u32,
    /// Rows and columns of an agent's window.
    pub view_size: Option<u32>,
    /// Cells that never change, one text a row: `.` free, `W` wall, `N` nest, `F` food. Left out with `ground=false`.
    pub ground: Option<Vec<String>>,
    /// Cells of the block relative to its position (Transport).
    pub block_cells: Option<Vec<[i32; 2]>>,
    /// Value of `from` for the next page; null if this page has the newest state.
    #[serialize_always]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub next: Option<u32>,
}

/// States of a page. Pages overlap by one state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayPage {
    /// First state: 0 is the layout, `n` the state after `n` rounds.
    pub from: u32,
    /// Number of states.
    pub length: u32,
    /// Metrics by name: a number or null for each state. The values of a state are those of the round that led to it.
    pub metrics: BTreeMap<String, Vec<Option<f64>>>,
    /// States in order.
    pub states: Vec<ReplayState>,
}

/// State, and the decisions of the round that led to it.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayState {
    /// Number of rounds that led to the state.
    pub round: u32,
    /// Score of the state.
    pub score: f64,
    /// Row and column of each agent, one agent after another; for an agent that escaped, those of the cell to which it went.
    pub at: Vec<i32>,
    /// Numbers of the agents that are not on the map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gone: Vec<u16>,
    /// Numbers of the agents whose light is on (Synchronization).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lit: Vec<u16>,
    /// Numbers of the agents that carry food (Foraging).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loaded: Vec<u16>,
    /// Row and column of the prey (Pursuit).
    pub prey: Option<[i32; 2]>,
    /// Row and column of the block's position (Transport).
    pub block: Option<[i32; 2]>,
    /// Cost of the placement (Flocking).
    pub distance: Option<f64>,
    /// Actions, one character for each agent: `U`, `D`, `L`, `R`, `S` stay, `X` switch the light, `-` none.
    pub actions: Option<String>,
    /// Numbers of the agents that chose a direction and did not move that way.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocked: Vec<u16>,
    /// Numbers of the agents that moved in another way than they chose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pushed: Vec<u16>,
    /// Numbers of the agents whose answer was invalid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid: Vec<u16>,
    /// Numbers of the agents whose clock expired.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub timeouts: Vec<u16>,
    /// Messages of the round.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub said: Vec<ReplayMessage>,
    /// Messages that are read with this state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub heard: Vec<ReplayHeard>,
    /// Remarkable facts about the round: `points` and `drop` (the score rose, fell), `invalid`, `timeout`, `silence` (nobody
    /// spoke, after a round in which somebody did), `convergence` (at least two spoke and all said the same, not so in the
    /// round before).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marks: Vec<ReplayMark>,
}

/// Message as it was sent.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayMessage {
    /// Number of the sender.
    pub from: u16,
    /// Text of the message.
    pub text: String,
    /// Only receiver of a commander's message.
    pub to: Option<u16>,
}

/// Message as it is read.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayHeard {
    /// Number of the sender.
    pub from: u16,
    /// Numbers of the agents that read the message.
    pub by: Vec<u16>,
    /// Round in which the message was sent, if that is not the round that led to this state.
    pub sent: Option<u32>,
    /// Text as the agents read it, if that is not what the sender said in the round that led to this state: noise changed it,
    /// or it came late.
    pub text: Option<String>,
}

/// Remarkable fact about a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum ReplayMark {
    /// The score rose.
    Points,
    /// The score fell.
    Drop,
    /// An answer was invalid.
    Invalid,
    /// A clock expired.
    Timeout,
    /// Nobody spoke, after a round in which somebody did.
    Silence,
    /// At least two agents spoke and all said the same; it was not so in the round before.
    Convergence,
}

impl ReplayState {
    /// Approximate number of bytes as JSON.
    #[must_use]
    pub fn approximate_bytes(&self) -> usize {
        const NUMBER: usize = 4;
        const OBJECT: usize = 40;
        let numbers = self.at.len()
            + self.gone.len()
            + self.lit.len()
            + self.loaded.len()
            + self.blocked.len()
            + self.pushed.len()
            + self.invalid.len()
            + self.timeouts.len();
        let said = self.said.iter().map(|said| OBJECT + said.text.len());
        let heard = self.heard.iter().map(|heard| {
            OBJECT + NUMBER * heard.by.len() + heard.text.as_ref().map_or(0, String::len)
        });
        let actions = self.actions.as_ref().map_or(0, String::len);
        4 * OBJECT + NUMBER * numbers + actions + said.sum::<usize>() + heard.sum::<usize>()
    }

    /// State without the decisions of the round that led to it.
    #[must_use]
    pub fn without_decisions(self) -> Self {
        let Self { round, score, at, gone, lit, loaded, prey, block, distance, .. } = self;
        Self { round, score, at, gone, lit, loaded, prey, block, distance, ..Self::default() }
    }
}

/// Knowledge of an agent in a round, and its act.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AgentRound {
    /// Id of the game.
    pub episode: String,
    /// Round that the observation answers: the number of resolved rounds.
    pub round: u32,
    /// Name of the agent.
    pub agent: String,
    /// Observation of the agent, without clocks; missing in an imported game.
    pub observation: Option<Sight>,
    /// Messages that the agent read, with their senders; missing in an imported game.
    pub inbox: Option<Vec<InboxMessage>>,
    /// Text for a language model.
    pub prompt: Option<String>,
    /// Reason for which there is no prompt, if the template fails.
    pub prompt_problem: Option<String>,
    /// Act of the agent; left out if the round is not resolved or the agent did not act.
    pub act: Option<ShownAct>,
}

/// Message that an agent read.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InboxMessage {
    /// Name of the sender.
    pub from: String,
    /// Round in which the message was sent.
    pub sent: u32,
    /// Text as the agent read it.
    pub text: String,
    /// Text as it was sent, if noise changed it.
    pub original: Option<String>,
}

/// Act as it was recorded.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShownAct {
    /// Source of the decision: `player` or `clock`; missing in an imported game.
    pub source: Option<String>,
    /// Action of the agent.
    pub action: Option<String>,
    /// Message of the agent.
    pub message: Option<String>,
    /// Name of the only receiver of a commander's message.
    pub to: Option<String>,
    /// False for an invalid answer of a language model; missing in an imported game.
    pub valid: Option<bool>,
    /// Reason for which the answer was invalid. Games of earlier versions did not record it.
    pub failure: Option<Failure>,
    /// Answer of the language model.
    pub response: Option<String>,
    /// Reasons that the player gave.
    pub reasoning: Option<String>,
    /// Cost of the answer.
    pub usage: Option<Usage>,
    /// What the player's program added to the prompt, and kept.
    pub harness: Option<Box<Harness>>,
    /// Milliseconds of the seat's bank that the act used.
    pub bank_spent_ms: Option<u64>,
    /// Time at which the act was taken.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub at: Option<Timestamp>,
}

/// Scores of a game in equal steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Scores {
    /// Id of the game.
    pub episode: String,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Number of rounds between two scores.
    pub every: u32,
    /// Scores after 0, `every`, twice `every` … rounds, and the newest score.
    pub scores: Vec<f64>,
}

/// Scores of the games of a run, or a page of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunScores {
    /// Id of the run.
    pub run: String,
    /// Games that were opened and not voided, in the order of the plan.
    pub items: Vec<Scores>,
    /// Cursor of the next page; null on the last page.
    pub next_cursor: Option<String>,
}

/// Result of playing a journal again.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Verification {
    /// Id of the episode.
    pub episode: String,
    /// Whether all hashes, digests, acts and scores are right.
    pub ok: bool,
    /// First fault; left out if there is none.
    pub problem: Option<String>,
    /// Number of rounds that were played again.
    pub rounds: u32,
    /// Score after these rounds.
    pub score: f64,
    /// Head of the hash chain.
    pub journal_head: String,
    /// Digest of the layout.
    pub layout_digest: Option<String>,
    /// Digest of the newest state.
    pub final_digest: Option<String>,
    /// Revision of the rules by which the episode was played.
    pub rules_revision: u32,
    /// Version of the program that played the journal again.
    pub version: String,
}
