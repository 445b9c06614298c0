//! Games that were read from files of the public data format: stored beside journals, and never replayed
//! by the rules.

use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench_protocol::import::{ImportConfig, ImportSummary};

/// The number of an imported game; short, and never shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ImportKey(pub i64);

/// A game as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportRow {
    /// Its public id; it follows from the digest.
    pub id: String,
    /// Of its name, its settings and its states.
    pub digest: [u8; 32],
    /// As its files call it.
    pub run_id: String,
    /// Its entry in the index, as JSON.
    pub meta: String,
    /// Who played.
    pub model: String,
    /// The task.
    pub task: String,
    /// The seed.
    pub seed: u64,
    /// The settings that make games comparable.
    pub settings: ImportConfig,
    /// The score after the last round.
    pub score: f64,
    /// How many rounds were resolved.
    pub resolved: u32,
    /// How many acts it has.
    pub acts: u64,
    /// Its states, the layout first.
    pub rounds: Vec<ImportedRound>,
}

/// Computes the digest of an imported game, state by state.
#[derive(Debug)]
pub struct ImportHash(Sha256);

impl ImportHash {
    /// Begins with the name and the settings of the game.
    #[must_use]
    pub fn new(run_id: &str, meta: &str) -> Self {
        let mut hash = Sha256::new();
        for part in [run_id, meta] {
            hash.update((part.len() as u64).to_be_bytes());
            hash.update(part);
        }
        Self(hash)
    }

    /// Adds the next state.
    pub fn add(&mut self, score: f64, state: &str) {
        self.0.update(score.to_bits().to_be_bytes());
        self.0.update((state.len() as u64).to_be_bytes());
        self.0.update(state);
    }

    /// The digest of all that was added.
    #[must_use]
    pub fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

/// A state, and what was done in it.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedRound {
    /// How many rounds were resolved; also the round that was decided in this state.
    pub round: u32,
    /// The score.
    pub score: f64,
    /// The state, as JSON.
    pub state: String,
    /// The acts, packed.
    pub acts: Option<Vec<u8>>,
}

/// An imported game, as far as results are compared.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedGame {
    /// Its public id.
    pub id: String,
    /// Who played, as the files say.
    pub model: String,
    /// The task.
    pub task: String,
    /// The seed.
    pub seed: u64,
    /// The settings, as far as they are known.
    pub settings: ImportConfig,
    /// The last score.
    pub score: f64,
    /// How many rounds were resolved.
    pub rounds: u32,
}

/// An imported game without its states.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredImport {
    /// Its number.
    pub key: ImportKey,
    /// Its public id.
    pub id: String,
    /// As its files call it.
    pub run_id: String,
    /// Its entry in the index, as JSON.
    pub meta: String,
    /// Who played, as the files say.
    pub model: String,
    /// The task.
    pub task: String,
    /// The seed.
    pub seed: u64,
    /// The settings, as far as they are known.
    pub settings: ImportConfig,
    /// The last score.
    pub score: f64,
    /// How many rounds were resolved.
    pub rounds: u32,
    /// How many acts it has.
    pub acts: u64,
    /// When it was imported.
    pub imported_at: Timestamp,
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
            imported_at: stored.imported_at,
        }
    }
}
