//! Games that were read from files.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::store::imports::StoredImport;

/// An imported game. Nobody vouches for it: what it tells is what its files told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImportSummary {
    /// Its id.
    #[schema(example = "imp_5f0c1e6a7d9b48f2a3c4d5e6f7081920")]
    pub id: String,
    /// As its files call it.
    pub run_id: String,
    /// Always false: its acts were not played by this server, and its states not computed by it.
    pub verified: bool,
    /// The task.
    pub task: String,
    /// Who played, as the files say.
    pub model: String,
    /// The seed.
    pub seed: u64,
    /// The last score.
    pub score: f64,
    /// How many rounds were resolved.
    pub rounds: u32,
    /// How many acts it has; 0 where the file with them was missing or broken.
    pub acts: u64,
    /// The settings, as far as the files tell them.
    pub settings: ImportConfig,
    /// When it was imported.
    #[schema(value_type = String, format = DateTime)]
    pub imported_at: jiff::Timestamp,
}

/// The settings of an imported game. The toolkit's files tell only the first five.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[expect(missing_docs, reason = "the same as of an episode")]
pub struct ImportConfig {
    pub num_agents: u32,
    pub max_round: u32,
    pub width: u32,
    pub height: u32,
    pub view_size: u32,
    pub rules: Option<String>,
    pub control: Option<String>,
    pub memory: Option<i64>,
    pub noise: Option<f64>,
    pub max_delay: Option<i64>,
}

/// A page of imported games, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImportList {
    /// The games of this page.
    pub items: Vec<ImportSummary>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
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
