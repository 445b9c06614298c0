//! Measures a game round by round.

use std::collections::BTreeMap;

use crate::game::{Decision, Heard, Setup, State};
use crate::metric::{Definition, Metric, RunValue};

/// What to compute beside what is always computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Whether the values of all rounds are wanted, not those of the game alone.
    pub series: bool,
    /// Whether text vectors are compared ([`Metric::Homogeneity`] and what follows from it).
    pub vectors: bool,
    /// Whether texts are compared character by character ([`Metric::EditConsistency`], [`Metric::SelfRepeat`], [`Metric::Echo`]).
    pub edits: bool,
}

/// The whole numbers of a state and the round that led to it. All but `explored` are 0 for the layout, where they
/// are not defined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[expect(missing_docs, reason = "defined in docs/evaluate/metrics.md")]
pub struct Counts {
    pub alive: u32,
    pub moves_up: u32,
    pub moves_down: u32,
    pub moves_left: u32,
    pub moves_right: u32,
    pub stays: u32,
    pub switches: u32,
    pub no_actions: u32,
    pub invalid: u32,
    pub timeouts: u32,
    pub messages: u32,
    pub distinct_messages: u32,
    pub questions: u32,
    pub message_chars: u64,
    pub message_digits: u64,
    pub message_chars_squared: u64,
    pub distance: u32,
    pub explored: u32,
    pub kept_pairs: u32,
    pub pushes: u32,
    pub pushes_strict: u32,
    pub blocked: u32,
    pub components: u32,
}

/// All that was measured of a game.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Resolved rounds.
    pub rounds: u32,
    /// Whether texts were left out of a comparison because a round had too many.
    pub sampled: bool,
    /// Of each definition the values of the game, for all metrics of that definition in the order of [`Metric::ALL`].
    pub values: BTreeMap<(Definition, Metric), RunValue>,
    /// The whole numbers of each state, `0..=rounds`; empty unless [`Options::series`].
    pub counts: Vec<Counts>,
    /// The values of each state (`paper`) or frame (`toolkit`), `0..=rounds`; empty unless [`Options::series`].
    pub series: BTreeMap<(Definition, Metric), Vec<Option<f64>>>,
}

/// Turns texts into vectors of length 1. Values of two embedders never meet.
pub trait Embedder: Send + Sync {
    /// Its id, which is part of every value that depends on it.
    fn id(&self) -> &str;

    /// The vector of a text, of Euclidean length 1; `None` if it has none, then values of its round are undefined.
    fn vector(&self, text: &str) -> Option<std::sync::Arc<[f64]>>;
}

/// A game that is being measured.
pub struct Meter<'a> {
    setup: Setup,
    state: State,
    options: Options,
    embedder: &'a dyn Embedder,
}

impl<'a> Meter<'a> {
    /// Begins with the layout.
    #[must_use]
    pub fn new(setup: Setup, layout: State, options: Options, embedder: &'a dyn Embedder) -> Self {
        Self { setup, state: layout, options, embedder }
    }

    /// Adds a round: what each agent decided, in order of their numbers, the state after it, and the messages that were
    /// delivered with that state; `None` where an imported game does not tell them.
    ///
    /// # Panics
    /// Where there is not one decision for each agent.
    pub fn round(&mut self, decisions: &[Decision], after: State, heard: Option<&[Heard]>) {
        let _ = (decisions, heard, &self.setup, self.options, self.embedder.id());
        self.state = after;
        todo!("filled in by the metrics part")
    }

    /// The counts and values so far, as if the game ended now.
    #[must_use]
    pub fn metrics(&self) -> Metrics {
        todo!("filled in by the metrics part")
    }
}
