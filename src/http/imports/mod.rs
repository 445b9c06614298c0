//! Imported games: games read from files, listed and shown to spectators.

pub(super) mod agent;
pub(super) mod list;
pub(super) mod metrics;
pub(super) mod replay;
pub(super) mod scores;
pub(super) mod show;
pub(super) mod state;
pub(super) mod worth;

use super::App;
use super::auth::Caller;
use super::error::{ApiError, Code};
use crate::budget::Reservation;
use crate::dataset::bounds::IMPORT_STATE_BYTES_MAX;
use crate::dataset::imported::{Unreadable, fitting};
use crate::store::entries::ImportedRound;
use crate::store::imports::StoredImport;
use swarmbench_protocol::import::ImportSummary;

/// Bytes of memory for a cell while a state is read.
const CELL_BYTES: usize = 64;

impl App {
    /// An imported game. Imports are public like ended episodes.
    async fn import(&self, caller: &Caller, id: &str) -> Result<StoredImport, ApiError> {
        let unknown = || ApiError::not_found("the imported game");
        if !caller.may_read_ended(&self.access) {
            return Err(unknown());
        }
        self.store.find_import(id).await?.ok_or_else(unknown)
    }

    /// States of an imported game from `from` on: as many of `from..to` as are read at once, with a reservation for them and what
    /// is made of them.
    async fn imported_rounds(
        &self,
        stored: &StoredImport,
        from: u32,
        to: u32,
    ) -> Result<(Vec<ImportedRound>, Reservation), ApiError> {
        let mut bytes = self.store.imported_bytes(stored.key, from, to).await?;
        let to = fitting(from, &bytes).map_err(unreadable)?;
        bytes.truncate((to - from) as usize);
        let cells = stored.settings.width.saturating_mul(stored.settings.height) as usize;
        let bytes = usize::try_from(bytes.iter().sum::<u64>()).unwrap_or(usize::MAX);
        let taken = bytes.saturating_mul(2).saturating_add(cells.saturating_mul(CELL_BYTES));
        let memory = self.registry.room(taken)?;
        Ok((self.store.imported_rounds(stored.key, from, to).await?, memory))
    }

    async fn imported_state(
        &self,
        stored: &StoredImport,
        round: u32,
    ) -> Result<(ImportedRound, Reservation), ApiError> {
        let (mut found, memory) = self.imported_rounds(stored, round, round + 1).await?;
        Ok((found.remove(0), memory))
    }
}

/// Error of a stored game that cannot be read.
#[expect(clippy::needless_pass_by_value, reason = "the shape that `map_err` calls")]
fn unreadable(problem: Unreadable) -> ApiError {
    let detail = format!("the game cannot be read: {problem}");
    match problem {
        Unreadable::TooLarge(_) => {
            let most = usize::try_from(IMPORT_STATE_BYTES_MAX).unwrap_or(usize::MAX);
            ApiError::limit(Code::Invalid, "import_state_bytes_max", most, detail)
        }
        Unreadable::Broken(_) => ApiError::new(Code::Internal, detail),
    }
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
