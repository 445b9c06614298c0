//! Boards and competitions as pure functions from ended games to ranked rows.
//!
//! A crate of its own, as servers show boards and programs without a server recompute them from a published file.
//!
//! - [`result`]: results of a run by task.
//! - [`rank`]: grouping of runs into rows, and the order of rows.
//! - [`interval`]: confidence in the order of two rows.
//! - [`collection`]: all boards of a database.
//! - [`mod@reference`]: numbers of the paper. [`cross_play`]: results of pairs of models.
//! - [`page`]: pages of boards in their wire format.
//! - [`run`]: definition of a run. [`competition`]: runs on seeds that are secret until the end.
//!
//! Equal games give bit-identical rows in any order of input. All conventions are described in `docs/evaluate/boards.md`.

pub mod collection;
pub mod competition;
pub mod cross_play;
pub mod interval;
pub mod page;
pub mod rank;
pub mod reference;
pub mod result;
pub mod run;
pub mod scale;

use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench_engine::{Seed, TaskName};
use swarmbench_journal::Tally;
use swarmbench_prompt::Identity;
use swarmbench_protocol::run::RunHolder;
use swarmbench_protocol::suite::{PlannedGame, Suite};

use run::TEAM;

/// Party that answers for a run: the holder of a key, or an entrant of a competition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owner {
    /// Id of the party; names are not unique.
    pub id: String,
    /// Displayed name.
    pub name: String,
}

/// Player as declared by the owner. Runs with equal declarations form one row of a board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Player {
    /// Party that answers for the runs; `None` if no key was required.
    pub owner: Option<Owner>,
    /// Name of the model.
    pub model: String,
    /// Sampling temperature, if declared.
    pub temperature: Option<f64>,
    /// Nucleus sampling parameter, if declared.
    pub top_p: Option<f64>,
    /// Identity of the prompt.
    pub prompt: Identity,
    /// Holders of a team, without their `agent_meta`; empty if one player has all seats.
    pub holders: Vec<RunHolder>,
    /// Further sampling, if declared.
    pub sampling: Option<String>,
}

/// Id of a row. A player has the same id on every board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RowId(pub [u8; 16]);

impl RowId {
    /// Hash of the properties that identify a row.
    fn of(parts: &[impl AsRef<[u8]>]) -> Self {
        let mut hash = Sha256::new();
        for part in parts.iter().map(AsRef::as_ref) {
            hash.update((part.len() as u64).to_be_bytes());
            hash.update(part);
        }
        Self(std::array::from_fn({
            let hash = hash.finalize();
            move |place| hash[place]
        }))
    }

    /// Parses the displayed form.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let bytes = data_encoding::HEXLOWER.decode(text.as_bytes()).ok()?;
        bytes.try_into().ok().map(Self)
    }
}

impl std::fmt::Display for RowId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&data_encoding::HEXLOWER.encode(&self.0))
    }
}

impl Player {
    /// Id of this player's row.
    #[must_use]
    pub fn row(&self) -> RowId {
        // 0 and −0 are the same temperature.
        let number = |number: Option<f64>| {
            number.map_or(Vec::new(), |number| (number + 0.0).to_be_bytes().to_vec())
        };
        let Identity { template, revision, system, harness } = &self.prompt;
        let text =
            |text: &Option<String>| text.as_ref().map_or(Vec::new(), |t| t.as_bytes().to_vec());
        let mut parts = vec![
            self.owner.as_ref().map_or(Vec::new(), |owner| owner.id.as_bytes().to_vec()),
            self.model.as_bytes().to_vec(),
            number(self.temperature),
            number(self.top_p),
            text(template),
        ];
        // Rows without these properties keep the ids that they had before the properties existed.
        if revision.is_some() || system.is_some() {
            parts.push(revision.map_or(Vec::new(), |revision| revision.to_be_bytes().to_vec()));
            parts.push(text(system));
        }
        if let Some(harness) = harness {
            parts.extend([b"harness".to_vec(), harness.as_bytes().to_vec()]);
        }
        if !self.holders.is_empty() {
            let holders = serde_json::to_vec(&self.holders).expect("string keys");
            parts.extend([TEAM.as_bytes().to_vec(), holders]);
        }
        if let Some(sampling) = &self.sampling {
            parts.extend([b"sampling".to_vec(), sampling.as_bytes().to_vec()]);
        }
        RowId::of(&parts)
    }
}

swarmbench_engine::named! {
    /// Evidence that each seat decided for itself.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Decentralization {
        /// One holder has all seats and declares it.
        Declared = "declared",
        /// Seats belong to different holders, or the server hosts the players.
        Enforced = "enforced",
    }
}

/// Data of a run besides its games.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlayedRun {
    /// Id of the run.
    pub id: String,
    /// Player of all games.
    pub player: Player,
    /// Status: `finished`, `aborted`, …
    pub status: String,
    /// Start of the run.
    pub created_at: Timestamp,
    /// True if somebody besides the owner vouches for the model.
    pub vouched: bool,
    /// Evidence of decentralized control; `None` under centralized control.
    pub decentralization: Option<Decentralization>,
    /// True if the owner declares that people played, on all seats or on some.
    pub is_human: bool,
    /// Name of the prompt; `None` for players that read none, and for games of files.
    pub prompt: Option<String>,
    /// Name of the reader of answers; `None` for games of files.
    pub answer_reader: Option<String>,
}

/// A planned game.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    /// Task of the game.
    pub task: TaskName,
    /// Seed of the layout.
    pub seed: Seed,
}

impl Slot {
    /// Games of a suite in the order of its plan; `None` if the suite names an unknown task.
    #[must_use]
    pub fn plan(suite: &Suite) -> Option<Vec<Self>> {
        let slot =
            |game: PlannedGame| Some(Self { task: TaskName::parse(&game.task)?, seed: game.seed });
        suite.plan().into_iter().map(slot).collect()
    }
}

/// An ended game, whatever its outcome.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndedGame {
    /// Planned game that was played.
    pub slot: Slot,
    /// Final score.
    pub score: f64,
    /// Counts of its acts.
    pub tally: Tally,
    /// True if the game was voided and does not count.
    pub voided: bool,
}
