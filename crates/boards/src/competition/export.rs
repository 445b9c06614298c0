//! Export of a competition: one file of JSON Lines with everything that is needed to verify it without the server.
//!
//! Every line is `{"hash":"…","record":{…}}`, with a chain of hashes over the records as in a journal
//! ([`swarmbench_journal::chain`]). The record `episode` is followed by the lines of that episode's journal, which
//! have their own chain and end with the head that the record names; so every byte of the file belongs to a chain.
//!
//! Order of the records: the competition; actions of organizers; entrants; each attempt, followed by its episodes; the board;
//! the end.
//!
//! A file has the oldest format that can express the competition ([`format_of`]), so that older programs can check it.
//! [`FIRST_FORMAT`] has no [`Action`]s and lists spare attempts as ordinary ones; only [`FORMAT`] has seeds by task.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use super::change::Changed;
use super::definition::{Definition, OwnGames, Window};
use super::entrant::Entrant;
use super::standings::StandingsRow;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{RawRecord, fields_of, kind_of};

/// Current version of the format.
pub const FORMAT: u32 = 3;

/// Version without seeds by task.
pub const SECOND_FORMAT: u32 = 2;

/// Version without actions of organizers, and without spare attempts.
pub const FIRST_FORMAT: u32 = 1;

/// Action: change of the definition.
pub const CHANGE: &str = "competition.change";

/// Action: cancellation of the competition.
pub const CANCEL: &str = "competition.cancel";

/// Action: voiding of an attempt.
pub const VOID: &str = "attempt.void";

/// Actions after the end that change attempts, games or ranks. From [`FORMAT`] on, files omit all other late actions, which so
/// leave a published file and its head unchanged.
pub const AFTER_END: [&str; 4] = [VOID, "episode.void", "entrant.change", "entrants.exclude"];

/// Maximum bytes of a record that is neither an attempt nor the board. The largest one that servers write is the exclusion of
/// all entrants at once, with 40 bytes for each.
pub const RECORD_BYTES_MAX: usize = 4 * 1024 * 1024;

/// Fields that files have only from a later format on: object, field, and first format with it.
pub const LATER_FIELDS: [(&str, &str, u32); 11] = [
    ("definition", "spares", SECOND_FORMAT),
    ("definition", "attempts_per_day", SECOND_FORMAT),
    ("definition", "public_seeds", SECOND_FORMAT),
    ("definition", "tie_breaks", SECOND_FORMAT),
    ("definition", "terms", SECOND_FORMAT),
    ("definition", "own_games", SECOND_FORMAT),
    ("definition", "categories", SECOND_FORMAT),
    ("definition", "seeds_by_task", FORMAT),
    ("entrant", "category", SECOND_FORMAT),
    ("entrant", "terms", SECOND_FORMAT),
    ("attempt", "replays", SECOND_FORMAT),
];

/// A record of the file; the field `kind` names its variant.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Line {
    /// First record.
    Competition(Box<Competition>),
    /// Action of an organizer; not in [`FIRST_FORMAT`].
    Action(Action),
    /// An entrant.
    Entrant(Entrant),
    /// An attempt; its games follow.
    Attempt(Attempt),
    /// A game; its journal follows.
    Episode(Episode),
    /// The board.
    Board(Board),
    /// Last record.
    End(End),
}

impl Line {
    /// Reads a record.
    ///
    /// # Errors
    /// If the text is no record, or has more than [`RECORD_BYTES_MAX`] bytes and is neither an attempt nor the board.
    pub fn parse(text: &str) -> Result<Self, serde_json::Error> {
        let kind = kind_of(text)?;
        if text.len() > RECORD_BYTES_MAX && !["attempt", "board"].contains(&&*kind) {
            let bytes = text.len();
            return Err(serde_json::Error::custom(format!(
                "a record of this kind has at most {RECORD_BYTES_MAX} bytes (RECORD_BYTES_MAX), and this one {bytes}"
            )));
        }
        match &*kind {
            "competition" => fields_of(text).map(Self::Competition),
            "action" => fields_of(text).map(Self::Action),
            "entrant" => fields_of(text).map(Self::Entrant),
            "attempt" => fields_of(text).map(Self::Attempt),
            "episode" => fields_of(text).map(Self::Episode),
            "board" => fields_of(text).map(Self::Board),
            "end" => fields_of(text).map(Self::End),
            other => Err(serde_json::Error::custom(format!("unknown kind {other:?}"))),
        }
    }
}

/// Field of this record, or of its definition, that files of this format do not have.
#[must_use]
pub fn later_field(record: &str, format: u32) -> Option<String> {
    let kind = kind_of(record).ok()?;
    let fields: BTreeMap<String, &RawValue> = serde_json::from_str(record).ok()?;
    let definition = fields.get("definition").map(|text| text.get()).unwrap_or_default();
    let defined: BTreeMap<String, &RawValue> = serde_json::from_str(definition).unwrap_or_default();
    let has = |of: &str, field: &str| match of {
        "definition" => kind == "competition" && defined.contains_key(field),
        _ => kind == of && fields.contains_key(field),
    };
    let (of, field, first) =
        LATER_FIELDS.into_iter().find(|(of, field, first)| format < *first && has(of, field))?;
    Some(format!("{of}: {field} needs format {first}, and the file says {format}"))
}

/// Head of the file: the competition and its secret.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Competition {
    /// Version of the format.
    pub format: u32,
    /// Public id.
    pub id: String,
    /// Definition of the competition.
    pub definition: Definition,
    /// Time of the creation.
    pub created_at: Timestamp,
    /// Time at which everything became public; `None` in an organizer's export before that.
    #[serde(deserialize_with = "Option::deserialize")]
    pub revealed_at: Option<Timestamp>,
    /// Published commitment, in hexadecimal.
    pub commitment: String,
    /// Salt, in hexadecimal.
    pub salt: String,
    /// Sealed seeds, in hexadecimal, attempt by attempt.
    pub seeds: Vec<String>,
}

impl Competition {
    /// Competition as [`FIRST_FORMAT`] expresses it.
    #[must_use]
    pub fn in_first_format(mut self) -> Self {
        self.format = FIRST_FORMAT;
        self.definition = in_first_format(self.definition);
        self
    }
}

/// Definition as [`FIRST_FORMAT`] expresses it: spare attempts are ordinary attempts, equal totals share a rank, and all seeds
/// make the board.
#[must_use]
pub fn in_first_format(mut definition: Definition) -> Definition {
    let Definition { opens_at, closes_at, spares, .. } = definition;
    let spare = std::iter::repeat_n(Window { opens_at, closes_at }, spares as usize);
    definition.attempts.extend(spare);
    Definition {
        spares: 0,
        attempts_per_day: None,
        public_seeds: 0,
        terms: None,
        categories: Vec::new(),
        tie_breaks: Vec::new(),
        own_games: OwnGames::Sealed,
        ..definition
    }
}

/// Oldest format that expresses a competition without loss.
#[must_use]
pub fn format_of(definition: &Definition, has_actions: bool) -> u32 {
    if definition.seeds_by_task {
        FORMAT
    } else if has_actions || in_first_format(definition.clone()) != *definition {
        SECOND_FORMAT
    } else {
        FIRST_FORMAT
    }
}

/// Action of an organizer.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// Time of the action.
    pub at: Timestamp,
    /// Kind of the action, such as [`CHANGE`].
    pub action: String,
    /// Id of the competition, entrant, run or game.
    pub subject: String,
    /// Further facts: the text of an object. A tree of values would take up to forty times as much memory.
    pub detail: Box<RawValue>,
}

/// Verified part of the details of [`CHANGE`] and [`VOID`].
#[derive(Debug, Default, Deserialize)]
pub struct Decided {
    /// Changes of the definition.
    #[serde(default)]
    pub changes: Option<Vec<Changed>>,
    /// Reason.
    #[serde(default)]
    pub reason: Option<String>,
}

impl Action {
    /// Decision of a [`CHANGE`] or [`VOID`]; empty for other actions.
    ///
    /// # Errors
    /// If the detail is no object, or a [`CHANGE`] without changes.
    pub fn decided(&self) -> Result<Decided, String> {
        if !self.detail.get().starts_with('{') {
            return Err("its detail is no object".to_owned());
        }
        if ![CHANGE, VOID].contains(&self.action.as_str()) {
            return Ok(Decided::default());
        }
        let decided = serde_json::from_str(self.detail.get());
        let decided: Decided = decided.map_err(|error| format!("its detail: {error}"))?;
        if self.action == CHANGE && decided.changes.is_none() {
            return Err("its detail has no changes".to_owned());
        }
        Ok(decided)
    }
}

/// An attempt of an entrant.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attempt {
    /// Id of the entrant.
    pub entrant: String,
    /// Number, from 1. Numbers after the attempts of the definition are those of spare attempts.
    pub attempt: u32,
    /// Voided attempt that this spare attempt replaces; not in [`FIRST_FORMAT`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replays: Option<u32>,
    /// Id of the run.
    pub run: String,
    /// Status of the run.
    pub status: String,
    /// Start of the attempt.
    pub created_at: Timestamp,
    /// End of the attempt.
    #[serde(deserialize_with = "Option::deserialize")]
    pub ended_at: Option<Timestamp>,
    /// Reason of the voiding, if the attempt was voided. Its games are left out then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voided: Option<String>,
    /// Ended games, in the order of the plan.
    pub games: Vec<ExportedGame>,
}

/// A game of an attempt.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportedGame {
    /// Place in the plan, from 0: task by task, and seed by seed within a task.
    pub slot: u32,
    /// Id of the episode.
    pub episode: String,
    /// Reason of the voiding, if the game was voided. Its journal is left out then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voided: Option<String>,
}

/// The header of a journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Place in the plan.
    pub slot: u32,
    /// Id of the episode.
    pub episode: String,
    /// Number of lines that follow.
    pub lines: usize,
    /// Head of the journal's chain.
    pub head: String,
}

/// The board.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Rows in order.
    pub rows: Vec<StandingsRow>,
}

/// The end of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End {
    /// Number of journals in the file.
    pub episodes: usize,
}

/// Writer of lines, each with the head of the chain after it.
#[derive(Debug)]
pub struct Writer {
    head: Head,
}

impl Default for Writer {
    fn default() -> Self {
        Self { head: Head::START }
    }
}

impl Writer {
    /// Next line.
    #[must_use]
    pub fn line(&mut self, record: &Line) -> String {
        let raw = RawRecord::write(record);
        self.head = self.head.link(raw.as_str().as_bytes());
        raw.line(self.head)
    }
}
