//! The interface of a seat for the tools.

use std::time::Duration;

use futures::future::BoxFuture;
use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::problem::Problem;

/// A seat of an episode, accessed with its token. Its futures are boxed, so that the library behind the tools is compiled once, in
/// this crate, for all kinds of seats.
pub trait SeatAccess: Send + Sync + 'static {
    /// The body of `GET /obs`, unparsed; with the text for language models if `prompt` is set. With `after` it waits
    /// until the round is past that one, the episode is over, or `wait` has passed.
    fn obs(
        &self,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> BoxFuture<'_, Result<Vec<u8>, Refusal>>;

    /// The receipt of `POST /act`.
    fn act(&self, act: ActRequest) -> BoxFuture<'_, Result<Receipt, Refusal>>;
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
