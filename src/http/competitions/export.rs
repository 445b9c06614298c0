//! `GET /api/v1/exports/competitions/{id}`: all that is needed to check a competition.

use std::collections::VecDeque;

use axum::http::{HeaderMap, header};
use axum::response::IntoResponse;
use serde::Deserialize;
use serde_json::json;
use utoipa::IntoParams;

use super::super::accept::{self, Binary};
use super::super::episodes::journal::JournalReader;
use super::super::page::ROWS_MAX;
use super::super::prelude::*;
use super::super::stream::Parts;
use super::Field;
use crate::budget::Reservation;
use crate::competitions::{self, StoredCompetition, StoredEntrant};
use crate::ids::{CompetitionKey, EpisodeId};
use crate::store::StoreError;
use crate::store::audit::ShownAction;
use crate::store::competitions::Declared;
use crate::store::journals::{GAMES_AT_ONCE, StoredJournal};
use crate::store::port::StoredEpisode;
use swarmbench_boards::competition::entrant::Entrant;
use swarmbench_boards::competition::export::{
    Action, Attempt, Board, CANCEL, CHANGE, Competition, End, Episode, FIRST_FORMAT, FORMAT, Game,
    Line, Writer, fits_first_format,
};
use swarmbench_boards::competition::standings::Part;

/// Export a competition (JSON Lines): its seeds and salt, its entrants, every attempt with the complete journals of
/// its games, and the board.
///
/// Once the competition is closed anybody may read it; before, organizers alone. `swarmbench verify --competition FILE`
/// checks all of it.
#[utoipa::path(
    get,
    path = "/api/v1/exports/competitions/{id}",
    operation_id = "export_competition",
    tag = "competitions",
    params(("id" = String, Path, description = "The competition's id"), ExportParams),
    security((), ("key" = [])),
    responses(
        (status = 200, description = "One record a line", content((String = "application/x-ndjson"), (Binary = "application/octet-stream"))),
        (status = 403, description = "`forbidden`: until the competition is closed only organizers may read it, as it holds the seeds"),
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
            let detail = "an export contains the seeds: until the competition is closed only organizers may read it";
            return Err(ApiError::new(Code::Forbidden, detail));
        };
        app.store.keep(vec![audit_entry]).await?;
    }
    let actions = actions(&app, &competition).await?;
    // A file that has nothing which only the newer format has can be checked by programs that know the first one.
    let needs_newer = !fits_first_format(&competition.definition)
        || actions.iter().any(|action| [CHANGE, CANCEL].contains(&action.action.as_str()));
    let format = params.format.unwrap_or(if needs_newer { FORMAT } else { FIRST_FORMAT });
    let field = app.field(competition, Declared::Short).await?;
    let lines = app.streams.in_parts(Reader::new(app.clone(), &field, actions, format)?).await?;
    drop(field);
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
    /// The version of the format: 2 has what organizers did, spare attempts, terms, categories, tie-breaks and public seeds; 1 is
    /// for programs that know no other. Where it is left out, 1 if the competition has none of these and was neither changed nor
    /// cancelled.
    #[param(minimum = 1, maximum = 2)]
    format: Option<u32>,
}

/// What organizers did in a competition, oldest first.
async fn actions(app: &App, competition: &StoredCompetition) -> Result<Vec<Action>, ApiError> {
    let mut all = Vec::new();
    let mut before = None;
    loop {
        let rows = app.store.actions_in(competition.key, None, before, ROWS_MAX).await?;
        let Some(last) = rows.last() else { break };
        before = Some(last.number);
        all.extend(rows.into_iter().map(|row| {
            let ShownAction { at, action, subject, shown, .. } = row;
            Action { at, action, subject, detail: shown }
        }));
    }
    all.reverse();
    Ok(all)
}

/// Bytes that an entrant, an attempt or a game takes in memory until it is written.
const RECORD_BYTES: usize = 512;

/// Writes an export piece by piece: it keeps the results of all games, but only a few rounds of one.
struct Reader {
    app: App,
    writer: Writer,
    /// What comes next, but for the journals of games.
    pieces: VecDeque<Piece>,
    /// The next games, whose journals were read or begun.
    begun: VecDeque<(u32, StoredJournal)>,
    journal: Option<JournalReader>,
    episodes: usize,
    competition: CompetitionKey,
    /// The memory of the pieces and of the journals that were begun.
    _room: Reservation,
}

enum Piece {
    Record(Box<Line>),
    /// What it declared is read when it is written.
    Entrant(Box<Entrant>),
    Episode {
        slot: u32,
        id: EpisodeId,
    },
    End,
}

impl Reader {
    fn new(app: App, field: &Field, actions: Vec<Action>, format: u32) -> Result<Self, ApiError> {
        let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
        let StoredCompetition {
            id, definition, sealed, commitment, created_at, revealed_at, ..
        } = &field.competition;
        let seeds = sealed.seeds.iter().map(|seed| hex(seed)).collect();
        let mut pieces = VecDeque::new();
        let record = |pieces: &mut VecDeque<Piece>, line| {
            pieces.push_back(Piece::Record(Box::new(line)));
        };
        let competition = Competition {
            format,
            id: id.clone(),
            definition: definition.clone(),
            created_at: *created_at,
            revealed_at: *revealed_at,
            commitment: hex(commitment),
            salt: hex(&sealed.salt),
            seeds,
        };
        let is_first = format == FIRST_FORMAT;
        let competition = if is_first { competition.in_first_format() } else { competition };
        let definition = competition.definition.clone();
        record(&mut pieces, Line::Competition(Box::new(competition)));
        for action in actions.into_iter().filter(|_| !is_first) {
            record(&mut pieces, Line::Action(action));
        }
        for StoredEntrant { entrant, published, .. } in &field.entrants {
            let mut entrant = entrant.clone();
            entrant.name = published.clone().unwrap_or(entrant.name);
            let entrant = if is_first { entrant.in_first_format() } else { entrant };
            pieces.push_back(Piece::Entrant(Box::new(entrant)));
        }
        for (stored, games) in &field.attempts {
            let is_broken = stored.void_reason.is_some();
            let games: Vec<_> = games.iter().filter(|game| game.is_over() && !is_broken).collect();
            let attempt = Attempt {
                entrant: field.entrant_of(stored)?.entrant.id.clone(),
                attempt: stored.number,
                replays: stored.replays.filter(|_| !is_first),
                run: stored.id.clone(),
                status: stored.status.clone(),
                created_at: stored.created_at,
                ended_at: stored.ended_at,
                voided: stored.void_reason.clone(),
                games: games
                    .iter()
                    .map(|game| Game {
                        slot: game.slot,
                        episode: game.id.to_string(),
                        voided: game.void_reason.clone(),
                    })
                    .collect(),
            };
            record(&mut pieces, Line::Attempt(attempt));
            for game in games.into_iter().filter(|game| game.counts()) {
                pieces.push_back(Piece::Episode { slot: game.slot, id: game.id.clone() });
            }
        }
        let ranked = field.standings(&definition, Part::Final, None)?;
        let rows = ranked.into_iter().map(|standing| standing.row).collect();
        record(&mut pieces, Line::Board(Board { rows }));
        pieces.push_back(Piece::End);
        let games: usize = field.attempts.iter().map(|(_, games)| games.len()).sum();
        let records = field.entrants.len() + field.attempts.len() + games;
        // Journals that were read take about as much as one part of the export.
        let bytes = records * RECORD_BYTES + app.limits.stream_part_bytes_max;
        Ok(Self {
            _room: app.registry.room(bytes)?,
            competition: field.competition.key,
            app,
            writer: Writer::default(),
            pieces,
            begun: VecDeque::new(),
            journal: None,
            episodes: 0,
        })
    }

    /// Reads the journals of the next games, about as many as `bytes_max` bytes have room for.
    async fn begin(&mut self, bytes_max: usize) -> Result<(), StoreError> {
        let next = self.pieces.iter().map_while(|piece| match piece {
            Piece::Episode { slot, id } => Some((*slot, id.clone())),
            Piece::Record(_) | Piece::Entrant(_) | Piece::End => None,
        });
        let (slots, ids): (Vec<_>, Vec<_>) = next.take(GAMES_AT_ONCE).unzip();
        let journals = self.app.store.journals(&ids, bytes_max).await?;
        self.pieces.drain(..journals.len());
        self.begun.extend(slots.into_iter().zip(journals));
        Ok(())
    }

    /// The line of the next piece, if that is no game.
    async fn line(&mut self) -> Result<Option<String>, StoreError> {
        let line = match self.pieces.pop_front_if(|piece| !matches!(piece, Piece::Episode { .. })) {
            None | Some(Piece::Episode { .. }) => return Ok(None),
            Some(Piece::Record(line)) => *line,
            Some(Piece::Entrant(entrant)) => {
                let found =
                    competitions::find_entrant(&self.app.store, self.competition, &entrant.id)
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

/// The record before a journal.
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
            } else if let Some((slot, journal)) = self.begun.pop_front() {
                self.episodes += 1;
                let header = episode_record(slot, &journal.stored);
                out.extend_from_slice(self.writer.line(&Line::Episode(header)).as_bytes());
                self.journal = Some(JournalReader::of(self.app.store.clone(), journal));
            } else if let Some(line) = self.line().await? {
                out.extend_from_slice(line.as_bytes());
            } else if self.pieces.is_empty() {
                break;
            } else {
                self.begin(bytes_max).await?;
            }
        }
        Ok(Some(out).filter(|part| !part.is_empty()))
    }
}
