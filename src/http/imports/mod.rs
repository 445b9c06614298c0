//! Games that were read from files: list, show, and what spectators read.

pub(super) mod list;
pub(super) mod show;
pub(super) mod state;

use super::App;
use super::auth::Caller;
use super::error::ApiError;
use crate::store::imports::StoredImport;
use crate::wire::import::{ImportConfig, ImportSummary};

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

impl From<StoredImport> for ImportSummary {
    fn from(stored: StoredImport) -> Self {
        let settings = stored.settings;
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
            settings: ImportConfig {
                num_agents: settings.num_agents,
                max_round: settings.max_round,
                width: settings.width,
                height: settings.height,
                view_size: settings.view_size,
                rules: settings.rules,
                control: settings.control,
                memory: settings.memory,
                noise: settings.noise,
                max_delay: settings.max_delay,
            },
            imported_at: stored.imported_at,
        }
    }
}
