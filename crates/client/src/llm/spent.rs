//! Requests and their results, counted for progress and reports.

use std::sync::{Mutex, MutexGuard};

use super::completion::{Completion, Failure, ModelAnswer};
use super::endpoint::Kind;
use swarmbench_protocol::act::Usage;
use swarmbench_protocol::failure::Failures;

/// Requests and tokens of a model since its creation. No number is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spent {
    /// Requests that were begun, including retries.
    pub requests: u64,
    /// Requests in flight.
    pub in_flight: u64,
    /// Questions that the endpoint answered.
    pub answers: u64,
    /// Questions that a cassette answered; their tokens are not counted again.
    pub replayed: u64,
    /// Retries of questions.
    pub retries: u64,
    /// Tokens of prompts that the endpoint reported.
    pub prompt_tokens: u64,
    /// Tokens of answers that the endpoint reported.
    pub completion_tokens: u64,
    /// Answers without usage.
    pub unmetered: u64,
    /// Answers with a reported cost that cannot be one, which is ignored, or that cost more than their prompt and limit of tokens
    /// allow by the price.
    pub odd_costs: u64,
    /// Tokens of prompts and answers that a cassette replayed.
    pub replayed_tokens: [u64; 2],
    /// Requests that were dropped when everything stopped. The endpoint may charge for them.
    pub dropped: u64,
    /// Empty, refused or cut answers and rejected questions, including those of a cassette.
    pub failures: Failures,
    /// Failed requests.
    pub troubles: Troubles,
}

/// Failed requests that were retried, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Troubles {
    /// Refusals for the endpoint's load.
    pub load: u64,
    /// Requests without an answer in time.
    pub time_outs: u64,
    /// Failed or broken connections.
    pub connections: u64,
    /// Errors of the server.
    pub server: u64,
    /// Unreadable answers.
    pub unreadable: u64,
}

impl Troubles {
    /// Number of all failed requests.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.load + self.time_outs + self.connections + self.server + self.unreadable
    }
}

/// Growing [`Spent`].
#[derive(Debug, Default)]
pub(super) struct Counters {
    spent: Mutex<Spent>,
    trouble: Mutex<Option<String>>,
}

impl Counters {
    fn get(&self) -> MutexGuard<'_, Spent> {
        self.spent.lock().expect("nothing panics while it holds this")
    }

    fn last(&self) -> MutexGuard<'_, Option<String>> {
        self.trouble.lock().expect("nothing panics while it holds this")
    }

    pub(super) fn last_trouble(&self) -> Option<String> {
        self.last().clone()
    }

    pub(super) fn spent(&self) -> Spent {
        *self.get()
    }

    /// Counts a new request, which is in flight until the guard is dropped.
    pub(super) fn request(&self) -> InFlight<'_> {
        let mut spent = self.get();
        spent.requests += 1;
        spent.in_flight += 1;
        InFlight { counters: self, is_over: false }
    }

    pub(super) fn retry(&self) {
        self.get().retries += 1;
    }

    pub(super) fn replayed(&self, answer: &ModelAnswer) {
        let mut spent = self.get();
        spent.replayed += 1;
        let Usage { prompt_tokens, completion_tokens, .. } = answer.usage;
        for (sum, more) in spent.replayed_tokens.iter_mut().zip([prompt_tokens, completion_tokens])
        {
            *sum = sum.saturating_add(more.unwrap_or(0));
        }
        if let Some(failure) = answer.failure {
            spent.failures.count(failure);
        }
    }

    pub(super) fn answered(&self, Completion { answer, tokens, .. }: &Completion, is_odd: bool) {
        *self.last() = None;
        let mut spent = self.get();
        spent.answers += 1;
        let Usage { prompt_tokens, completion_tokens, .. } = answer.usage;
        spent.prompt_tokens = spent.prompt_tokens.saturating_add(prompt_tokens.unwrap_or(0));
        spent.completion_tokens =
            spent.completion_tokens.saturating_add(completion_tokens.unwrap_or(0));
        spent.unmetered += u64::from(tokens.is_none());
        spent.odd_costs += u64::from(is_odd);
        if let Some(failure) = answer.failure {
            spent.failures.count(failure);
        }
    }

    /// Counts a rejected question. Rejections are no answers and have no tokens.
    pub(super) fn rejected(&self) {
        self.get().failures.count(Failure::Rejected);
    }

    pub(super) fn trouble(&self, kind: Kind, said: &str) {
        *self.last() = Some(said.to_owned());
        let troubles = &mut self.get().troubles;
        *match kind {
            Kind::Load => &mut troubles.load,
            Kind::TimeOut => &mut troubles.time_outs,
            Kind::Connection => &mut troubles.connections,
            Kind::Server => &mut troubles.server,
            Kind::Unreadable => &mut troubles.unreadable,
        } += 1;
    }
}

/// A request in flight.
pub(super) struct InFlight<'a> {
    counters: &'a Counters,
    is_over: bool,
}

impl InFlight<'_> {
    /// Marks the request as answered or failed, rather than dropped.
    pub(super) fn over(mut self) {
        self.is_over = true;
    }
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        let mut spent = self.counters.get();
        spent.in_flight -= 1;
        spent.dropped += u64::from(!self.is_over);
    }
}
