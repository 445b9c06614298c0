//! Boards and competitions. Pure: games that have ended go in, ranked rows come out.
//!
//! A crate of its own because a server shows boards, and programs without a server recompute them from a published file.
//!
//! - [`result`]: what a run is worth, task by task.
//! - [`rank`]: runs of the same player make a row; rows are put in order.
//! - [`interval`]: how sure the order of two rows is.
//! - [`collection`]: all boards of a database.
//! - [`mod@reference`]: the numbers of the paper. [`cross_play`]: who did how well together.
//! - [`page`]: pages of boards, in the shapes of the wire.
//! - [`run`]: what a run is. [`competition`]: runs on seeds that are secret until the end.
//!
//! The same games give the same rows to the last bit, in whatever order they come. Every convention is described in
//! `docs/evaluate/boards.md`.

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
use swarmbench_prompt::Identity;
use swarmbench_protocol::failure::Failures;
use swarmbench_protocol::suite::{Game as Planned, Suite};

/// Who answers for a run: the holder of a key, or an entrant of a competition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owner {
    /// Its id; names are not unique.
    pub id: String,
    /// The name that is shown.
    pub name: String,
}

/// What plays, as its owner declares it. Runs that declare the same make one row of a board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Player {
    /// `None` if no key was required.
    pub owner: Option<Owner>,
    /// The model's name.
    pub model: String,
    /// Its temperature, if declared.
    pub temperature: Option<f64>,
    /// Its `top_p`, if declared.
    pub top_p: Option<f64>,
    /// Which prompt it has.
    pub prompt: Identity,
}

/// The id of a row. A player has the same id on every board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RowId(pub [u8; 16]);

impl RowId {
    /// The id of a row with these properties.
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

    /// Reads a name as it is shown.
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
    /// The row of this player.
    #[must_use]
    pub fn row(&self) -> RowId {
        // Zero has two signs, and they are the same temperature.
        let number = |number: Option<f64>| {
            number.map_or(Vec::new(), |number| (number + 0.0).to_be_bytes().to_vec())
        };
        let Identity { template, revision, system } = &self.prompt;
        let text =
            |text: &Option<String>| text.as_ref().map_or(Vec::new(), |t| t.as_bytes().to_vec());
        let mut parts = vec![
            self.owner.as_ref().map_or(Vec::new(), |owner| owner.id.as_bytes().to_vec()),
            self.model.as_bytes().to_vec(),
            number(self.temperature),
            number(self.top_p),
            text(template),
        ];
        // Rows without these keep the names that they have always had.
        if revision.is_some() || system.is_some() {
            parts.push(revision.map_or(Vec::new(), |revision| revision.to_be_bytes().to_vec()));
            parts.push(text(system));
        }
        RowId::of(&parts)
    }
}

swarmbench_engine::named! {
    /// What a board says of whether each seat decided for itself.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Decentralization {
        /// One holder has all seats and says so.
        Declared = "declared",
        /// Seats belong to different holders, or the server hosts the players.
        Enforced = "enforced",
    }
}

/// What is known of a run beside its games.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// Its id.
    pub id: String,
    /// What played.
    pub player: Player,
    /// `finished`, `aborted`, …
    pub status: String,
    /// When it was started.
    pub created_at: Timestamp,
    /// Whether somebody beside the owner vouches for the model.
    pub vouched: bool,
    /// `None` under centralized control.
    pub decentralization: Option<Decentralization>,
    /// Whether its owner declares that people played.
    pub is_human: bool,
    /// The name of the reader of its answers; `None` for games of files.
    pub answer_reader: Option<String>,
}

/// A game that a run is to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    /// The task.
    pub task: TaskName,
    /// The seed of its layout.
    pub seed: Seed,
}

impl Slot {
    /// The games of a suite in the order of its plan; `None` if it names an unknown task.
    #[must_use]
    pub fn plan(suite: &Suite) -> Option<Vec<Self>> {
        let slot =
            |game: Planned| Some(Self { task: TaskName::parse(&game.task)?, seed: game.seed });
        suite.plan().into_iter().map(slot).collect()
    }
}

/// A game that has ended, in whichever way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Game {
    /// Which of the run's games.
    pub slot: Slot,
    /// Its score.
    pub score: f64,
    /// Answers that players gave, valid or not.
    pub answers: u64,
    /// Invalid answers.
    pub invalid: u64,
    /// Why they were invalid. Games of earlier versions do not tell it.
    pub failures: Failures,
    /// Moves that timed out.
    pub timeouts: u64,
    /// Whether it was voided, so that it does not count.
    pub voided: bool,
}
