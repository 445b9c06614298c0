//! What the tools need of a seat.

use std::time::Duration;

use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::problem::Problem;

/// A seat of an episode, as the holder of its token reaches it.
pub trait Seat: Send + Sync + 'static {
    /// What `GET /obs` answers, as it was written; with the text for language models where `prompt` is set. With
    /// `after` it waits until the round is past that one, the episode is over, or `wait` has passed.
    fn obs(
        &self,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> impl Future<Output = Result<Vec<u8>, Refusal>> + Send;

    /// What `POST /act` answers.
    fn act(&self, act: ActRequest) -> impl Future<Output = Result<Receipt, Refusal>> + Send;
}

/// Why a seat gave no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The server refused.
    Problem(Box<Problem>),
    /// There was no answer of a server; the text says why, and what to do.
    NoAnswer(String),
}

impl Refusal {
    /// Whether the server refused with this code.
    pub(crate) fn is(&self, code: &str) -> bool {
        matches!(self, Self::Problem(problem) if problem.code == code)
    }
}
