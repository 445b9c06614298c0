//! A whole competition in one file of JSON Lines: enough to check all of it without the server.
//!
//! Every line is `{"hash":"…","record":{…}}`, with a chain of hashes over the records as in a journal
//! ([`swarmbench_journal::chain`]). The record `episode` is followed by the lines of that episode's journal, which
//! have their own chain and end with the head that the record names; so every byte of the file belongs to a chain.
//!
//! The order: the competition; what organizers did in it; its entrants; each attempt, followed by its episodes; the board; the
//! end.
//!
//! A file has the oldest format that can tell the competition ([`format_of`]), so that older programs check it. The
//! [`FIRST_FORMAT`] has no [`Action`]s, and spare attempts are attempts like others in it; only [`FORMAT`] knows seeds by task.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use super::change::Changed;
use super::definition::{Definition, OwnGames, Window};
use super::entrant::Entrant;
use super::standings::Row;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{RawRecord, fields_of, kind_of};

/// The version of this format.
pub const FORMAT: u32 = 3;

/// The version without seeds of each task.
pub const SECOND_FORMAT: u32 = 2;

/// The version without what organizers did, and without spare attempts.
pub const FIRST_FORMAT: u32 = 1;

/// The action that changes a definition.
pub const CHANGE: &str = "competition.change";

/// The action that cancels a competition.
pub const CANCEL: &str = "competition.cancel";

/// The action that voids an attempt.
pub const VOID: &str = "attempt.void";

/// Actions after the end that change attempts, games or ranks: from [`FORMAT`] on a file has no others that late. They leave a
/// published file, and its head, as they are.
pub const AFTER_END: [&str; 4] = [VOID, "episode.void", "entrant.change", "entrants.exclude"];

/// Bytes of a record that is neither an attempt nor the board, at most. The largest ones that servers write are the exclusions of
/// all entrants at once, of 40 bytes for each.
pub const RECORD_BYTES_MAX: usize = 4 * 1024 * 1024;

/// The fields that only files from a later format on have: the object, the field, and that format.
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

/// A record of the file; its field `kind` says which.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Line {
    /// The first record.
    Competition(Box<Competition>),
    /// What an organizer did; not in [`FIRST_FORMAT`].
    Action(Action),
    /// Who takes part.
    Entrant(Entrant),
    /// An attempt; its games follow.
    Attempt(Attempt),
    /// A game; its journal follows.
    Episode(Episode),
    /// The board.
    Board(Board),
    /// The last record.
    End(End),
}

impl Line {
    /// Reads a record.
    ///
    /// # Errors
    /// If the text is no record, or one of more than [`RECORD_BYTES_MAX`] bytes that is not as long as what was played.
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

/// Finds a field of this record, or of its definition, that files of this format do not have.
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

/// What was played.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Competition {
    /// The version of the format.
    pub format: u32,
    /// The public id.
    pub id: String,
    /// Its definition.
    pub definition: Definition,
    /// When it was created.
    pub created_at: Timestamp,
    /// When everything was opened to all; `None` in an export before that, for organizers.
    #[serde(deserialize_with = "Option::deserialize")]
    pub revealed_at: Option<Timestamp>,
    /// The published commitment, in hexadecimal.
    pub commitment: String,
    /// The salt, in hexadecimal.
    pub salt: String,
    /// The sealed seeds, in hexadecimal, attempt by attempt.
    pub seeds: Vec<String>,
}

impl Competition {
    /// The same for programs that know [`FIRST_FORMAT`] only.
    #[must_use]
    pub fn in_first_format(mut self) -> Self {
        self.format = FIRST_FORMAT;
        self.definition = in_first_format(self.definition);
        self
    }
}

/// A definition for programs that know [`FIRST_FORMAT`] only: spare attempts are attempts like others, equal totals share a rank,
/// and all seeds make the board.
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

/// The oldest format that can tell a competition without a loss.
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

/// What an organizer did.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// When.
    pub at: Timestamp,
    /// What was done, [`CHANGE`] for instance.
    pub action: String,
    /// The id of the competition, entrant, run or game that it concerns.
    pub subject: String,
    /// Further facts: the text of an object, never a tree of values, which takes up to forty times as much memory.
    pub detail: Box<RawValue>,
}

/// What a file is checked by of the detail of [`CHANGE`] and [`VOID`].
#[derive(Debug, Default, Deserialize)]
pub struct Decided {
    /// What was changed of the definition.
    #[serde(default)]
    pub changes: Option<Vec<Changed>>,
    /// Why.
    #[serde(default)]
    pub reason: Option<String>,
}

impl Action {
    /// What it decided.
    ///
    /// # Errors
    /// If its detail is none.
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
    /// The entrant's id.
    pub entrant: String,
    /// Its number, from 1. Those after the attempts of the definition are spare ones.
    pub attempt: u32,
    /// The voided attempt that it plays again, where it is a spare one; not in [`FIRST_FORMAT`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replays: Option<u32>,
    /// The id of its run.
    pub run: String,
    /// The run's status.
    pub status: String,
    /// When it was started.
    pub created_at: Timestamp,
    /// When it ended.
    #[serde(deserialize_with = "Option::deserialize")]
    pub ended_at: Option<Timestamp>,
    /// Why it was voided, if it was. Then its games are left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voided: Option<String>,
    /// The games that have ended, in the order of the plan.
    pub games: Vec<Game>,
}

/// A game of an attempt.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Game {
    /// Its place in the plan: task by task, and for each task seed by seed; from 0.
    pub slot: u32,
    /// The id of its episode.
    pub episode: String,
    /// Why it was voided, if it was. Then its journal is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voided: Option<String>,
}

/// The header of a journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Its place in the plan.
    pub slot: u32,
    /// The id of the episode.
    pub episode: String,
    /// How many lines follow.
    pub lines: usize,
    /// The head of its journal's chain.
    pub head: String,
}

/// The board.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Its rows in order.
    pub rows: Vec<Row>,
}

/// The end of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End {
    /// How many journals the file has.
    pub episodes: usize,
}

/// Writes the lines, each with the head of the chain after it.
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
    /// The next line.
    #[must_use]
    pub fn line(&mut self, record: &Line) -> String {
        let raw = RawRecord::write(record);
        self.head = self.head.link(raw.as_str().as_bytes());
        raw.line(self.head)
    }
}
