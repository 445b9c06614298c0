//! Games that were read from files: list, show, and what spectators read.

pub(super) mod agent;
pub(super) mod list;
pub(super) mod metrics;
pub(super) mod replay;
pub(super) mod scores;
pub(super) mod show;
pub(super) mod state;

use super::App;
use super::auth::Caller;
use super::error::{ApiError, Code};
use crate::store::imports::StoredImport;
use swarmbench_protocol::import::ImportSummary;

impl App {
    /// An imported game. They are public like episodes that have ended.
    async fn import(&self, caller: &Caller, id: &str) -> Result<StoredImport, ApiError> {
        let unknown = || ApiError::not_found("the imported game");
        if !caller.may_read_what_is_over(&self.access) {
            return Err(unknown());
        }
        self.store.find_import(id).await?.ok_or_else(unknown)
    }
}

/// The error of a stored game that cannot be read.
#[expect(clippy::needless_pass_by_value, reason = "the shape that `map_err` calls")]
fn broken(problem: String) -> ApiError {
    ApiError::new(Code::Internal, format!("the game cannot be read: {problem}"))
}

impl From<StoredImport> for ImportSummary {
    fn from(stored: StoredImport) -> Self {
        Self {
            id: stored.id,
            run_id: stored.run_id,
            verified: false,
            task: stored.task,
            model: stored.model,
            seed: stored.seed,
            score: stored.score,
            rounds: stored.rounds,
            acts: stored.acts,
            settings: stored.settings,
            imported_at: stored.imported_at.into(),
        }
    }
}
