//! Counts of acts.

use super::record::{ActRecord, Source, Usage};
use swarmbench_protocol::act::UsageSums;
use swarmbench_protocol::failure::{Failure, Failures};

/// Counts of the acts of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Acts that players decided.
    pub acts: u64,
    /// Invalid answers of language models among these acts.
    pub invalid: u64,
    /// Reasons why they were invalid. Journals of earlier versions have none, so the sum may be less than `invalid`.
    pub failures: Failures,
    /// Acts that a clock decided.
    pub timeouts: u64,
    /// Tokens of prompts, as reported by players.
    pub prompt_tokens: u64,
    /// Tokens of answers, as reported by players.
    pub completion_tokens: u64,
    /// What else players reported.
    pub usage: UsageSums,
}

impl Tally {
    /// Counts an act.
    pub fn add(&mut self, record: &ActRecord) {
        self.count(record.source, record.valid, record.failure, record.usage.as_deref());
    }

    /// Adds the counts of other acts.
    pub fn merge(&mut self, other: &Self) {
        self.acts += other.acts;
        self.invalid += other.invalid;
        self.failures.add(other.failures);
        self.timeouts += other.timeouts;
        self.prompt_tokens = self.prompt_tokens.saturating_add(other.prompt_tokens);
        self.completion_tokens = self.completion_tokens.saturating_add(other.completion_tokens);
        self.usage.add(&other.usage);
    }

    /// Counts an act by its origin, validity, failure and usage.
    pub fn count(
        &mut self,
        source: Source,
        valid: bool,
        failure: Option<Failure>,
        usage: Option<&Usage>,
    ) {
        match source {
            Source::Clock => self.timeouts += 1,
            Source::Player => {
                self.acts += 1;
                self.invalid += u64::from(!valid);
                if let Some(failure) = failure {
                    self.failures.count(failure);
                }
            }
        }
        let usage = usage.copied().unwrap_or_default();
        // Players may report any number, so the sums saturate.
        let add = |sum: &mut u64, more: Option<u64>| *sum = sum.saturating_add(more.unwrap_or(0));
        add(&mut self.prompt_tokens, usage.prompt_tokens);
        add(&mut self.completion_tokens, usage.completion_tokens);
        self.usage.count(&usage);
    }
}
