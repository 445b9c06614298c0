//! Heavy work of requests: its threads, and the permits for large responses and replays.

use std::time::Duration;

use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::fair::{FairLimit, Party, Permit, Rank, Shares, WAITING_MAX};
use crate::work::Workers;

/// Time that a request waits for a permit to render a prompt or a board.
const RENDER_TIMEOUT: Duration = Duration::from_secs(5);

/// Time that a request waits for a permit to replay an earlier round.
const REPLAY_TIMEOUT: Duration = Duration::from_secs(10);

/// Time that a request waits for a permit to compute a worth.
const WORTH_TIMEOUT: Duration = Duration::from_secs(30);

pub(super) struct Heavy {
    workers: Workers,
    large_answers: FairLimit,
    /// Permits for replays, each of which may use as much memory as the texts of several rounds.
    replays: FairLimit,
    /// Permits for worths, each of which may occupy a worker thread for a minute.
    worths: FairLimit,
}

impl Heavy {
    pub(super) fn new(workers: Workers, limits: &Limits) -> Self {
        // One group gets at most half of the permits.
        let shares = Shares { slots_per_member: 1, ..Shares::halved(limits.heavy_at_once_max) };
        Self {
            workers,
            worths: FairLimit::heavy(shares, WORTH_TIMEOUT),
            large_answers: FairLimit::heavy(shares, RENDER_TIMEOUT),
            replays: FairLimit::replays(limits.replays_max, REPLAY_TIMEOUT),
        }
    }

    /// Runs work that keeps a core busy for milliseconds off the async threads, when a thread is free for the party.
    pub(super) async fn render<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, ApiError> {
        let work = self.workers.run("render", Party::current(), Rank::Normal, |_| work());
        let Ok(done) = tokio::time::timeout(RENDER_TIMEOUT, work).await else {
            let detail =
                "too much heavy work (prompts, boards, large worlds) is queued; try again later";
            let error = ApiError::limit(Code::Overloaded, "waiting_max", WAITING_MAX, detail);
            return Err(error.retry_after(Duration::from_secs(1)));
        };
        Ok(done?)
    }

    /// A permit to make a large response. Bounds the parts that are made on the async threads at the same time.
    pub(super) async fn large_answer(&self) -> Result<Permit, ApiError> {
        let detail = "too many large answers are requested; try again later, or ask for less";
        permit(&self.large_answers, detail).await
    }

    /// A permit for a large response, if one is free at once.
    pub(super) fn large_answer_at_once(&self) -> Option<Permit> {
        self.large_answers.acquire_at_once(Party::current(), Rank::Normal)
    }

    pub(super) async fn worth(&self) -> Result<Permit, ApiError> {
        let detail = "too many worths are being computed; try again later";
        permit(&self.worths, detail).await
    }

    pub(super) async fn replay(&self) -> Result<Permit, ApiError> {
        let detail = "too many earlier rounds are being replayed; try again later";
        permit(&self.replays, detail).await
    }
}

async fn permit(limit: &FairLimit, detail: &str) -> Result<Permit, ApiError> {
    let permit = limit.acquire(Party::current(), Rank::Normal).await;
    permit.map_err(|busy| ApiError::no_permit(busy, detail))
}
