//! `GET /api/v1/exports/competitions/{id}`: the file by which a competition is verified.

use std::collections::{HashMap, HashSet, VecDeque};

use axum::http::{HeaderMap, header};
use axum::response::IntoResponse;
use serde::Deserialize;
use serde_json::json;
use serde_json::value::to_raw_value;
use utoipa::IntoParams;

use super::super::accept::{self, Binary};
use super::super::episodes::journal::JournalReader;
use super::super::page::ROWS_MAX;
use super::super::prelude::*;
use super::super::stream::Parts;
use crate::budget::Reservation;
use crate::competitions::field::Field;
use crate::competitions::{self, StoredCompetition, StoredEntrant};
use crate::ids::{EpisodeId, RunKey};
use crate::store::StoreError;
use crate::store::audit::ShownAction;
use crate::store::competitions::{Declared, StoredAttempt};
use crate::store::journals::{GAMES_AT_ONCE, StoredJournal};
use crate::store::port::StoredEpisode;
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::entrant::Entrant;
use swarmbench_boards::competition::export::{
    AFTER_END, Action, Attempt, Board, CANCEL, CHANGE, Competition, End, Episode, ExportedGame,
    FIRST_FORMAT, FORMAT, Line, Writer, format_of,
};
use swarmbench_boards::competition::standings::{Part, Played, standings_of};

/// Export a competition (JSON Lines): its seeds and salt, its entrants, every attempt with the complete journals of its games,
/// and the board.
///
/// Anybody may read it once the competition is closed; before that, organizers and judges. `swarmbench verify --competition FILE`
/// checks all of it.
#[utoipa::path(
    get,
    path = "/api/v1/exports/competitions/{id}",
    operation_id = "export_competition",
    tag = "competitions",
    params(ExportParams),
    responses(
        (status = 200, description = "One record per line", content((String = "application/x-ndjson"), (Binary = "application/octet-stream"))),
        (status = 403, description = "`forbidden`: until the competition is closed only organizers and judges may read the export, as it holds the seeds"),
        (status = 422, description = "`invalid`: a format that cannot represent this competition"),
    )
)]
pub(in super::super) async fn export_competition(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    headers: HeaderMap,
    Params(params): Params<ExportParams>,
) -> Result<Response, ApiError> {
    if let Some(format) = params.format
        && !(FIRST_FORMAT..=FORMAT).contains(&format)
    {
        let problem = format!("must be from {FIRST_FORMAT} to {FORMAT}, is {format}");
        return Err(ApiError::field("format", problem));
    }
    let competition = app.competition(&caller, &id).await?;
    if competition.revealed_at.is_none() {
        let Some(audit_entry) = caller.audit_entry(
            &app,
            "competition.export",
            &id,
            json!({}),
            Some((competition.key, json!({}))),
        ) else {
            let detail = "an export contains the seeds: until the competition is closed only organizers and judges may read it";
            return Err(ApiError::new(Code::Forbidden, detail));
        };
        app.store.keep(vec![audit_entry]).await?;
    }
    let mut known = Known::read(&app, &competition).await?;
    let is_after = |action: &Action| competition.revealed_at.is_some_and(|at| at <= action.at);
    let is_change = |action: &Action| [CHANGE, CANCEL].contains(&action.action.as_str());
    // Hiding a competition after its end must not change the format of the file, whose head was published.
    let has_changes = known.actions.iter().any(|action| is_change(action) && !is_after(action));
    let usual = format_of(&competition.definition, has_changes);
    if usual == FORMAT {
        for action in known.actions.iter().rev().filter(|action| is_after(action)) {
            // The oldest action after the end is visited last, so its value remains.
            let was = Told::of(action).was_vouched.map(|was| (action.subject.clone(), was));
            known.vouched.extend(was);
        }
        known.actions.retain(|action| !is_after(action) || Told::decides(action));
    } else {
        // After the end nothing but `hidden` changes.
        known.actions.retain(|action| !is_after(action) || action.action != CHANGE);
    }
    let format = params.format.unwrap_or(usual);
    if usual == FORMAT && format < FORMAT {
        let problem = format!(
            "must be {FORMAT}: each task of this competition has seeds of its own, which older formats cannot tell"
        );
        return Err(ApiError::field("format", problem));
    }
    let lines = Reader::new(app.clone(), competition, known, format).await?;
    let lines = app.streams.in_parts(lines).await?;
    let name = format!("attachment; filename=\"{id}.jsonl\"");
    let kind = [
        (header::CONTENT_TYPE, accept::file_type(&headers, "application/x-ndjson").to_owned()),
        (header::CONTENT_DISPOSITION, name),
    ];
    Ok(accept::by_accept((kind, lines).into_response()))
}

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ExportParams {
    /// Version of the format: 3 has seeds of each task; 2 has organizers' actions, spare attempts, terms, categories,
    /// tie-breaks and public seeds. By default the oldest version that can represent the competition.
    #[param(minimum = 1, maximum = 3)]
    format: Option<u32>,
}

/// Facts about entrants in an action.
#[derive(Default, Deserialize)]
struct Told {
    /// New status, or new reason of the status.
    status: Option<String>,
    /// State of the vouching before, if it changed.
    was_vouched: Option<bool>,
    /// Excluded entrants.
    entrants: Option<Vec<String>>,
}

impl Told {
    fn of(action: &Action) -> Self {
        serde_json::from_str(action.detail.get()).unwrap_or_default()
    }

    /// A deciding action after the end changes attempts, games or ranks.
    fn decides(action: &Action) -> bool {
        let told = Self::of(action);
        AFTER_END.contains(&action.action.as_str())
            && (action.action != "entrant.change" || told.status.is_some())
            && (action.action != "entrants.exclude"
                || told.entrants.is_some_and(|all| !all.is_empty()))
    }
}

/// State of a competition when its export begins.
struct Known {
    /// Last attempt.
    last: Option<RunKey>,
    /// Voided attempts.
    voided: HashSet<RunKey>,
    /// Actions of organizers, oldest first.
    actions: Vec<Action>,
    /// Vouching at the end, by entrants for which it changed later.
    vouched: HashMap<String, bool>,
}

impl Known {
    async fn read(app: &App, competition: &StoredCompetition) -> Result<Self, ApiError> {
        // The order matters: each voided attempt has its action, and no exported attempt replaces one that is voided later.
        let last = app.store.last_attempt(competition.key).await?;
        let voided = app.store.voided_attempts(competition.key).await?;
        let actions = actions(app, competition).await?;
        let voided = voided.into_iter().collect();
        Ok(Self { last, voided, actions, vouched: HashMap::new() })
    }
}

/// Actions of organizers in a competition, oldest first.
async fn actions(app: &App, competition: &StoredCompetition) -> Result<Vec<Action>, ApiError> {
    let mut all = Vec::new();
    let mut before = None;
    loop {
        let rows = app.store.actions_in(competition.key, None, before, ROWS_MAX).await?;
        let Some(last) = rows.last() else { break };
        before = Some(last.number);
        all.extend(rows.into_iter().map(|row| {
            let ShownAction { at, action, subject, shown, .. } = row;
            let detail = to_raw_value(&shown).expect("string keys");
            Action { at, action, subject, detail }
        }));
    }
    all.reverse();
    Ok(all)
}

/// Bytes of an entrant, an attempt or a game in memory until it is written.
const RECORD_BYTES: usize = 512;

/// Bytes of the result of a counting attempt without its games, and of one of its games.
const RESULT_BYTES: usize = 2048;
const SCORE_BYTES: usize = 16;

/// Attempts of one query.
const ATTEMPTS_AT_ONCE: u32 = 64;

/// Writer of an export, piece by piece. It keeps the counting result of each entrant, but only a few attempts and a few rounds
/// of a game.
struct Reader {
    app: App,
    writer: Writer,
    competition: StoredCompetition,
    /// Definition as the file expresses it.
    definition: Definition,
    is_first_format: bool,
    /// Attempts that were voided when the export began. Those that are voided meanwhile are exported as they were.
    voided: HashSet<RunKey>,
    /// Entrants without their long declarations.
    entrants: Vec<StoredEntrant>,
    /// Attempts of each entrant, as far as they were read.
    played: Vec<Played>,
    left: Left,
    /// Next pieces, without the journals of games.
    pieces: VecDeque<Piece>,
    /// Next games, whose journals were read in part or whole.
    begun: VecDeque<(u32, StoredJournal)>,
    journal: Option<JournalReader>,
    episodes: usize,
    /// Memory of all this.
    _room: Reservation,
}

/// Part of the attempts that is still to be read.
#[derive(Clone, Copy, Debug)]
enum Left {
    Attempts {
        after: Option<RunKey>,
        /// Last attempt when the export began. The entrants of all attempts up to it are known.
        last: RunKey,
    },
    Board,
    Nothing,
}

enum Piece {
    Record(Box<Line>),
    /// Entrant whose long declarations are read when the record is written.
    Entrant(Box<Entrant>),
    Episode {
        slot: u32,
        id: EpisodeId,
    },
    End,
}

impl Reader {
    async fn new(
        app: App,
        competition: StoredCompetition,
        Known { last, voided, actions, vouched }: Known,
        format: u32,
    ) -> Result<Self, ApiError> {
        let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
        // Entrants are read after the last attempt, so that each attempt has its entrant even if others register meanwhile.
        let entrants =
            competitions::entrants(&app.store, competition.key, None, Declared::Short).await?;
        let StoredCompetition {
            id, definition, sealed, commitment, created_at, revealed_at, ..
        } = &competition;
        let seeds = sealed.seeds.iter().map(|seed| hex(seed)).collect();
        let mut pieces = VecDeque::new();
        let record = |pieces: &mut VecDeque<Piece>, line| {
            pieces.push_back(Piece::Record(Box::new(line)));
        };
        let games = definition.games();
        let head = Competition {
            format,
            id: id.clone(),
            definition: definition.clone(),
            created_at: *created_at,
            revealed_at: *revealed_at,
            commitment: hex(commitment),
            salt: hex(&sealed.salt),
            seeds,
        };
        let is_first_format = format == FIRST_FORMAT;
        let head = if is_first_format { head.in_first_format() } else { head };
        let definition = head.definition.clone();
        record(&mut pieces, Line::Competition(Box::new(head)));
        for action in actions.into_iter().filter(|_| !is_first_format) {
            record(&mut pieces, Line::Action(action));
        }
        for StoredEntrant { entrant, published, .. } in &entrants {
            let mut entrant = entrant.clone();
            entrant.name = published.clone().unwrap_or(entrant.name);
            entrant.vouched = vouched.get(&entrant.id).copied().unwrap_or(entrant.vouched);
            let entrant = if is_first_format { entrant.in_first_format() } else { entrant };
            pieces.push_back(Piece::Entrant(Box::new(entrant)));
        }
        let of_entrant = 2 * RECORD_BYTES + RESULT_BYTES + games * SCORE_BYTES;
        let of_attempts = ATTEMPTS_AT_ONCE as usize * (1 + games) * RECORD_BYTES;
        // Journals in memory take about as much as one part of the export.
        let bytes = entrants.len() * of_entrant
            + of_attempts
            + voided.len() * RECORD_BYTES
            + app.limits.stream_part_bytes_max;
        Ok(Self {
            _room: app.registry.room(bytes)?,
            app,
            writer: Writer::default(),
            competition,
            definition,
            is_first_format,
            voided,
            played: vec![Played::default(); entrants.len()],
            entrants,
            left: last.map_or(Left::Board, |last| Left::Attempts { after: None, last }),
            pieces,
            begun: VecDeque::new(),
            journal: None,
            episodes: 0,
        })
    }

    /// Reads the next attempts, or makes the board; false at the end.
    async fn read(&mut self) -> Result<bool, StoreError> {
        match self.left {
            Left::Attempts { after, last } => {
                let competition = self.competition.key;
                let store = &self.app.store;
                let mut found =
                    store.list_attempts(competition, None, after, ATTEMPTS_AT_ONCE).await?;
                found.retain(|attempt| attempt.run <= last);
                for attempt in &mut found {
                    attempt.void_reason.take_if(|_| !self.voided.contains(&attempt.run));
                }
                let newest = found.last().map(|attempt| attempt.run);
                self.add_attempts(found).await?;
                self.left = match newest {
                    Some(newest) if newest < last => Left::Attempts { after: Some(newest), last },
                    _ => Left::Board,
                };
            }
            Left::Board => {
                let entrants = self.entrants.iter().map(|stored| &stored.entrant);
                let places: Vec<_> = entrants.zip(&self.played).collect();
                let ranked = standings_of(&self.definition, &places);
                let rows = ranked.into_iter().map(|standing| standing.row).collect();
                self.pieces.push_back(Piece::Record(Box::new(Line::Board(Board { rows }))));
                self.pieces.push_back(Piece::End);
                self.left = Left::Nothing;
            }
            Left::Nothing => return Ok(false),
        }
        Ok(true)
    }

    async fn add_attempts(&mut self, attempts: Vec<StoredAttempt>) -> Result<(), StoreError> {
        let Self { app, competition, definition, entrants, played, pieces, .. } = self;
        let field = Field::read(&app.store, competition, entrants, attempts).await?;
        for pair in &field.attempts {
            let (stored, games) = pair;
            let place = field.place_of(stored);
            let place = place.ok_or_else(|| StoreError::broken("an attempt without an entrant"))?;
            let entrant = &entrants[place].entrant;
            let of_board = field.attempt(pair)?.part(definition, Part::Final);
            played[place].add(definition, entrant, &of_board);
            let is_broken = stored.void_reason.is_some();
            let games: Vec<_> = games.iter().filter(|game| game.is_over() && !is_broken).collect();
            let attempt = Attempt {
                entrant: entrant.id.clone(),
                attempt: stored.number,
                replays: stored.replays.filter(|_| !self.is_first_format),
                run: stored.id.clone(),
                status: stored.status.clone(),
                created_at: stored.created_at,
                ended_at: stored.ended_at,
                voided: stored.void_reason.clone(),
                games: games
                    .iter()
                    .map(|game| ExportedGame {
                        slot: game.slot,
                        episode: game.id.to_string(),
                        voided: game.void_reason.clone(),
                    })
                    .collect(),
            };
            pieces.push_back(Piece::Record(Box::new(Line::Attempt(attempt))));
            for game in games.into_iter().filter(|game| game.counts()) {
                pieces.push_back(Piece::Episode { slot: game.slot, id: game.id.clone() });
            }
        }
        Ok(())
    }

    /// Reads the journals of the next games, in about `bytes_max` bytes.
    async fn begin(&mut self, bytes_max: usize) -> Result<(), StoreError> {
        let next = self.pieces.iter().filter_map(|piece| match piece {
            Piece::Episode { slot, id } => Some((*slot, id.clone())),
            Piece::Record(_) | Piece::Entrant(_) | Piece::End => None,
        });
        let (slots, ids): (Vec<_>, Vec<_>) = next.take(GAMES_AT_ONCE).unzip();
        let journals = self.app.store.journals(&ids, bytes_max).await?;
        self.begun.extend(slots.into_iter().zip(journals));
        Ok(())
    }

    /// Line of the next piece, unless it is a game.
    async fn line(&mut self) -> Result<Option<String>, StoreError> {
        let line = match self.pieces.pop_front_if(|piece| !matches!(piece, Piece::Episode { .. })) {
            None | Some(Piece::Episode { .. }) => return Ok(None),
            Some(Piece::Record(line)) => *line,
            Some(Piece::Entrant(entrant)) => {
                let found =
                    competitions::find_entrant(&self.app.store, self.competition.key, &entrant.id)
                        .await?;
                let missing =
                    || StoreError::Missing(format!("{} is not there any more", entrant.id).into());
                let declaration = found.ok_or_else(missing)?.entrant.declaration;
                Line::Entrant(Entrant { declaration, ..*entrant })
            }
            Some(Piece::End) => Line::End(End { episodes: self.episodes }),
        };
        Ok(Some(self.writer.line(&line)))
    }
}

/// Record before a journal.
fn episode_record(slot: u32, stored: &StoredEpisode) -> Episode {
    let end = usize::from(stored.ended_at.is_some());
    Episode {
        slot,
        episode: stored.id.to_string(),
        lines: 1 + stored.rounds as usize + end,
        head: stored.head.to_string(),
    }
}

impl Parts for Reader {
    async fn next(&mut self, bytes_max: usize) -> Result<Option<Vec<u8>>, StoreError> {
        let mut out = Vec::new();
        while out.len() < bytes_max {
            if let Some(journal) = &mut self.journal {
                match journal.next(bytes_max - out.len()).await? {
                    Some(lines) => out.extend_from_slice(&lines),
                    None => self.journal = None,
                }
            } else if let Some(Piece::Episode { .. }) = self.pieces.front() {
                if self.begun.is_empty() {
                    self.begin(bytes_max).await?;
                }
                let missing = || StoreError::Missing("a game is not there any more".into());
                let (slot, journal) = self.begun.pop_front().ok_or_else(missing)?;
                self.pieces.pop_front();
                self.episodes += 1;
                let header = episode_record(slot, &journal.stored);
                out.extend_from_slice(self.writer.line(&Line::Episode(header)).as_bytes());
                self.journal = Some(JournalReader::of(self.app.store.clone(), journal));
            } else if let Some(line) = self.line().await? {
                out.extend_from_slice(line.as_bytes());
            } else if !self.read().await? {
                break;
            }
        }
        Ok(Some(out).filter(|part| !part.is_empty()))
    }
}
