//! The interface of a seat for the tools.

use std::time::Duration;

use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::problem::Problem;

/// A seat of an episode, accessed with its token.
pub trait SeatAccess: Send + Sync + 'static {
    /// The body of `GET /obs`, unparsed; with the text for language models if `prompt` is set. With `after` it waits
    /// until the round is past that one, the episode is over, or `wait` has passed.
    fn obs(
        &self,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> impl Future<Output = Result<Vec<u8>, Refusal>> + Send;

    /// The receipt of `POST /act`.
    fn act(&self, act: ActRequest) -> impl Future<Output = Result<Receipt, Refusal>> + Send;
}

/// The reason why a seat gave no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The server refused.
    Problem(Box<Problem>),
    /// No server answered; the text gives the reason and advice.
    NoAnswer(String),
}

impl Refusal {
    /// True if the server refused with this code.
    pub(crate) fn is(&self, code: &str) -> bool {
        matches!(self, Self::Problem(problem) if problem.code == code)
    }
}
