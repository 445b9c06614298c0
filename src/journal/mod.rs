//! The journal: all that is stored of an episode, enough to replay it.
//!
//! An episode is its journal: the opening (configuration, rules, prompt template), every round's
//! acts with the digest of the state after them, and the end, in a chain of hashes. States, scores
//! and observations are recomputed from it.

pub mod chain;
pub mod record;
pub mod replay;

use record::{ActRecord, Source};

/// What the acts of an episode were, in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Acts that players decided.
    pub acts: u64,
    /// Of these, invalid answers of language models.
    pub invalid: u64,
    /// Acts that a clock decided.
    pub timeouts: u64,
    /// Tokens of prompts, as players reported.
    pub prompt_tokens: u64,
    /// Tokens of answers, as players reported.
    pub completion_tokens: u64,
}

impl Tally {
    /// Counts one more act.
    pub fn add(&mut self, record: &ActRecord) {
        match record.source {
            Source::Clock => self.timeouts += 1,
            Source::Player => {
                self.acts += 1;
                self.invalid += u64::from(!record.valid);
            }
        }
        let usage = record.usage.unwrap_or_default();
        // Players may report any numbers; a sum that overflows saturates.
        let add = |sum: &mut u64, more: Option<u64>| *sum = sum.saturating_add(more.unwrap_or(0));
        add(&mut self.prompt_tokens, usage.prompt_tokens);
        add(&mut self.completion_tokens, usage.completion_tokens);
    }
}
