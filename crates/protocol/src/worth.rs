//! What could still be scored in a game (`docs/evaluate/worth.md`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Method by which worth was computed. Values of different methods cannot be compared.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct WorthMethod {
    /// Name of the reference: the default built-in player of the task.
    pub reference: String,
    /// Revision of the reference's decisions and of all definitions.
    pub worth_revision: u32,
}

/// Worth of the states of a game, and losses of its decisions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GameWorth {
    /// Id of the game; null for a file that does not say it.
    pub episode: Option<String>,
    /// Name of the task.
    pub task: String,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Score after these rounds.
    pub score: f64,
    /// Method by which the worth was computed.
    #[serde(flatten)]
    pub method: WorthMethod,
    /// Worth of each state, `rounds + 1` numbers: the score that the reference reaches from there. Null if it is missing.
    pub values: Option<Vec<f64>>,
    /// Losses of the rounds, in order. Null if it is missing.
    pub losses: Option<Vec<RoundLoss>>,
    /// The first round from which on the reference would have scored nothing more; null if it would still score.
    pub settled_round: Option<u32>,
    /// The score of a game that has ended, or else the last worth, as a share of the first worth: what could be scored and was not lost.
    /// Above 1 where the swarm did better than the reference; null where nothing could be scored.
    pub accuracy: Option<f64>,
    /// Whether the game scored more than the reference would have from the start: the reference is weak here.
    pub reference_is_weak: Option<bool>,
    /// Losses of each seat, by the name of its agent. Null if they are missing.
    pub seats: Option<BTreeMap<String, LossSum>>,
    /// Losses of seats by kind of decision: `moved`, `waited`, `blocked`, `switched`, `invalid`, `late`.
    pub kinds: Option<BTreeMap<String, LossSum>>,
    /// The ten decisions that lost most, the dearest first. Null if they are missing.
    pub dearest: Option<Vec<DearDecision>>,
    /// Missing parts, with reasons.
    pub missing: Vec<MissingPart>,
}

/// Loss of a round: worth before it minus worth after it. Below 0 where the swarm found something better than the reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RoundLoss {
    /// Number of the round.
    pub round: u32,
    /// Worth before the round minus worth after it.
    pub loss: f64,
    /// By agent: worth after the round if this agent alone had done what the reference would have done, minus worth after the
    /// round. Null if they are missing.
    pub seats: Option<BTreeMap<String, f64>>,
}

/// Losses of all decisions of a seat, or of a kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LossSum {
    /// Number of decisions.
    pub decisions: u64,
    /// Sum of their losses above 0.
    pub lost: f64,
    /// Sum of their losses below 0, as a number above 0.
    pub gained: f64,
    /// Share in what all decisions of the game lost; null where nothing was lost.
    pub share: Option<f64>,
}

/// A decision that lost much.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct DearDecision {
    /// Number of the round.
    pub round: u32,
    /// Name of the agent.
    pub agent: String,
    /// Loss of the decision.
    pub loss: f64,
    /// Kind of the decision: `moved`, `waited`, `blocked`, `switched`, `invalid` or `late`.
    pub kind: String,
    /// Action of the agent; null for none.
    pub action: Option<String>,
    /// Action of the reference in its place.
    pub reference_action: Option<String>,
    /// The decision in words.
    pub words: String,
}

/// A part of the answer that is missing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MissingPart {
    /// The part: `values` or `seats`.
    pub part: String,
    /// Reason for which it is missing.
    pub detail: String,
}

/// How the reference would play on from a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReferenceLine {
    /// Id of the game; null for a file that does not say it.
    pub episode: Option<String>,
    /// Round from whose state the reference plays.
    pub round: u32,
    /// Method by which the line was computed.
    #[serde(flatten)]
    pub method: WorthMethod,
    /// Its rounds, in order; fewer than asked for where the game ends.
    pub rounds: Vec<LineRound>,
}

/// A round of the reference's line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LineRound {
    /// Number of the round.
    pub round: u32,
    /// Score after the round.
    pub score: f64,
    /// Agents after the round, in the order of their numbers.
    pub agents: Vec<LineAgent>,
}

/// An agent of the reference's line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LineAgent {
    /// Name of the agent.
    pub agent: String,
    /// Its action; null for an agent that had escaped.
    pub action: Option<String>,
    /// Row and column after the round.
    pub at: [i32; 2],
    /// True while it is on the map, after the round.
    pub alive: bool,
}
