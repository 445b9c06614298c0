//! Replays: the states of a game page by page, one act with all that led to it, scores, and what a verification found.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::act::Usage;
use crate::failure::Failure;
use crate::observation::Sight;
use crate::time::Timestamp;

/// A page of the states of a game.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Replay {
    /// What is the same on all pages, or changes while the game runs.
    #[serde(flatten)]
    pub head: ReplayHead,
    /// The states of this page.
    #[serde(flatten)]
    pub page: ReplayPage,
}

/// What a page says of the whole game.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayHead {
    /// The id of the game.
    pub episode: String,
    /// The task.
    pub task: String,
    /// `paper` or `reference`; left out where an imported game does not say it.
    pub rules: Option<String>,
    /// `decentralized` or `centralized`; left out where an imported game does not say it.
    pub control: Option<String>,
    /// The status of the episode; `imported` for an imported game.
    pub status: String,
    /// How many rounds are resolved.
    pub rounds: u32,
    /// After how many rounds the game ends.
    pub max_round: Option<u32>,
    /// The score after the resolved rounds.
    pub score: f64,
    /// Columns of the map.
    pub width: u32,
    /// Rows of the map.
    pub height: u32,
    /// How many agents play.
    pub num_agents: u32,
    /// Rows and columns of an agent's window.
    pub view_size: Option<u32>,
    /// What never moves, one text a row: `.` free, `W` wall, `N` nest, `F` food. Left out with `ground=false`.
    pub ground: Option<Vec<String>>,
    /// The cells of the block relative to its position (Transport).
    pub block_cells: Option<Vec<[i32; 2]>>,
    /// The `from` of the next page; null where this page has the newest state.
    #[serialize_always]
    #[cfg_attr(feature = "openapi", schema(required))]
    pub next: Option<u32>,
}

/// The states of a page. Pages overlap by one state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayPage {
    /// The first state: 0 is the layout, `n` the state after `n` rounds.
    pub from: u32,
    /// How many states there are.
    pub length: u32,
    /// Metrics by name: a number or null for each state. Those of a state are of the round that led to it.
    pub metrics: BTreeMap<String, Vec<Option<f64>>>,
    /// The states in order.
    pub states: Vec<ReplayState>,
}

/// A state, and what was decided in the round that led to it.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayState {
    /// After how many rounds.
    pub round: u32,
    /// The score.
    pub score: f64,
    /// Row and column of each agent, one agent after another; of one that escaped those of the cell to which it went.
    pub at: Vec<i32>,
    /// The numbers of the agents that are not on the map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gone: Vec<u16>,
    /// The numbers of the agents whose light is on (Synchronization).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lit: Vec<u16>,
    /// The numbers of the agents that carry food (Foraging).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loaded: Vec<u16>,
    /// Row and column of the prey (Pursuit).
    pub prey: Option<[i32; 2]>,
    /// Row and column of the block's position (Transport).
    pub block: Option<[i32; 2]>,
    /// The cost of the placement (Flocking).
    pub distance: Option<f64>,
    /// The action of each agent, one character for one agent: `U`, `D`, `L`, `R`, `S` stay, `X` switch the light, `-` none.
    pub actions: Option<String>,
    /// The agents that chose a direction and did not move that way.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocked: Vec<u16>,
    /// The agents that moved in another way than they chose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pushed: Vec<u16>,
    /// The agents whose answer was invalid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid: Vec<u16>,
    /// The agents whose clock expired.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub timeouts: Vec<u16>,
    /// The messages of the round.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub said: Vec<ReplayMessage>,
    /// The messages that are read with this state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub heard: Vec<ReplayHeard>,
    /// What is remarkable about the round: `points` and `drop` (the score rose, fell), `invalid`, `timeout`, `silence` (nobody
    /// spoke, after a round in which somebody did), `convergence` (at least two spoke and all said the same, not so in the
    /// round before).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marks: Vec<ReplayMark>,
}

/// A message as it was sent.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayMessage {
    /// The number of the sender.
    pub from: u16,
    /// The text.
    pub text: String,
    /// The only receiver of a commander's message.
    pub to: Option<u16>,
}

/// A message as it is read.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplayHeard {
    /// The number of the sender.
    pub from: u16,
    /// The numbers of the agents that read it.
    pub by: Vec<u16>,
    /// The round in which it was sent, where that is not the round that led to this state.
    pub sent: Option<u32>,
    /// The text as they read it, where that is not what the sender said in the round that led to this state: noise
    /// changed it, or it came late.
    pub text: Option<String>,
}

/// What is remarkable about a round.
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
    /// About how many bytes it takes as JSON.
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

    /// The state without what was decided in the round that led to it.
    #[must_use]
    pub fn without_decisions(self) -> Self {
        let Self { round, score, at, gone, lit, loaded, prey, block, distance, .. } = self;
        Self { round, score, at, gone, lit, loaded, prey, block, distance, ..Self::default() }
    }
}

/// What an agent knew in a round, and what it did.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AgentRound {
    /// The id of the game.
    pub episode: String,
    /// The round that the observation answers: how many rounds were resolved.
    pub round: u32,
    /// The agent's name.
    pub agent: String,
    /// What it observed, without clocks. An imported game does not tell it.
    pub observation: Option<Sight>,
    /// The messages that it read, with their senders. An imported game does not tell them.
    pub inbox: Option<Vec<InboxMessage>>,
    /// The text for a language model.
    pub prompt: Option<String>,
    /// Why there is no prompt, where the template fails.
    pub prompt_problem: Option<String>,
    /// What it did; left out where the round is not resolved or the agent did not act.
    pub act: Option<ShownAct>,
}

/// A message that an agent read.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InboxMessage {
    /// The name of the sender.
    pub from: String,
    /// The round in which it was sent.
    pub sent: u32,
    /// The text as the agent read it.
    pub text: String,
    /// The text as it was sent, where noise changed it.
    pub original: Option<String>,
}

/// An act as it was recorded.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShownAct {
    /// Who decided: `player` or `clock`. An imported game does not tell it.
    pub source: Option<String>,
    /// The action.
    pub action: Option<String>,
    /// The message.
    pub message: Option<String>,
    /// The name of the only receiver of a commander's message.
    pub to: Option<String>,
    /// False for an invalid answer of a language model. An imported game does not tell it.
    pub valid: Option<bool>,
    /// Why the answer was invalid. Games of earlier versions do not tell it.
    pub failure: Option<Failure>,
    /// The language model's answer.
    pub response: Option<String>,
    /// What the player said about its reasons.
    pub reasoning: Option<String>,
    /// What the answer cost.
    pub usage: Option<Usage>,
    /// The part of the seat's bank that it used, in milliseconds.
    pub bank_spent_ms: Option<u64>,
    /// When it was taken.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = DateTime))]
    pub at: Option<Timestamp>,
}

/// Scores of a game in equal steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Scores {
    /// The id of the game.
    pub episode: String,
    /// How many rounds are resolved.
    pub rounds: u32,
    /// Rounds between two scores.
    pub every: u32,
    /// The score after 0, `every`, twice `every` … rounds, and the newest.
    pub scores: Vec<f64>,
}

/// Scores of the games of a run, or a page of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunScores {
    /// The run.
    pub run: String,
    /// Games that were opened and not voided, in the order of the plan.
    pub items: Vec<Scores>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// What was found when a journal was played again.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Verification {
    /// The episode.
    pub episode: String,
    /// Whether all hashes, digests, acts and scores are right.
    pub ok: bool,
    /// The first fault, where there is one.
    pub problem: Option<String>,
    /// How many rounds were played again.
    pub rounds: u32,
    /// The score after them.
    pub score: f64,
    /// The head of the chain of hashes.
    pub journal_head: String,
    /// The digest of the layout.
    pub layout_digest: Option<String>,
    /// The digest of the newest state.
    pub final_digest: Option<String>,
    /// The revision of the rules by which it was played.
    pub rules_revision: u32,
    /// The version of the program that played it again.
    pub version: String,
}
