//! `GET /api/v1/episodes/{id}/journal`: JSON Lines, enough to play the episode again.

use std::collections::VecDeque;

use axum::http::{HeaderMap, header};
use axum::response::IntoResponse;

use super::super::accept::{self, Binary};
use super::super::prelude::*;
use super::super::stream::Parts;
use crate::store::journals::StoredJournal;
use crate::store::port::{StoredEpisode, StoredRound};
use crate::store::records::ActReader;
use crate::store::{Store, StoreError};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{End, Frame, RawRecord, next_line};

/// Rounds that are read at once, without their acts.
const ROUNDS: u32 = 256;

/// Read an episode's journal (JSON Lines).
///
/// The journal has the opening (configuration, rules revision, prompt template), then every resolved round with its acts and
/// the digest of the state after it, and finally the end. Each line has the head of the hash chain after it.
/// `swarmbench verify FILE` replays and checks the journal.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/journal",
    operation_id = "read_journal",
    tag = "episodes",
    responses(
        (status = 200, description = "One record per line", content((String = "application/x-ndjson"), (Binary = "application/octet-stream"))),
        (status = 403, description = "`forbidden`: only the creator may read it before the end, as it holds the seed"),
    )
)]
pub(in super::super) async fn read_journal(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    headers: HeaderMap,
    _: Params<Nothing>,
) -> Result<Response, ApiError> {
    let stored = app.journaled_episode(&caller, id).await?;
    // The current state.
    let stored = app.store.find_summary(&stored.id).await?;
    let stored = stored.ok_or_else(|| ApiError::not_found("the episode"))?;
    let lines = app.streams.in_parts(JournalReader::new(app.store.clone(), stored)).await?;
    let kind = accept::file_type(&headers, "application/x-ndjson");
    Ok(accept::by_accept(([(header::CONTENT_TYPE, kind)], lines).into_response()))
}

/// Reads a journal from the store part by part: it keeps one part of its acts, however large rounds are.
pub(in super::super) struct JournalReader {
    store: Store,
    stored: StoredEpisode,
    at: Position,
    /// Head of the chain after the last line.
    head: Head,
    acts: ActReader,
    /// Rounds that were read and not written yet.
    rounds: VecDeque<StoredRound>,
    /// The end record, where it was read with the rest.
    end: Option<RawRecord>,
}

enum Position {
    Opening,
    Before(u32),
    /// Reading the list of acts of a line.
    In(OpenLine),
    End,
    Done,
}

/// A line of which the beginning is written.
struct OpenLine {
    round: u32,
    after: String,
    has_acts: bool,
    /// Bytes of the end record that are to come; none for a round.
    left: Option<usize>,
}

impl JournalReader {
    /// Reads the journal of an episode as far as `stored` tells of it.
    pub(in super::super) fn new(store: Store, stored: StoredEpisode) -> Self {
        // Acts of the open round belong to the end.
        let end = stored.rounds.saturating_add(u32::from(stored.ended_at.is_some()));
        let acts = ActReader::joined(store.clone(), stored.episode, end, stored.act_bytes);
        let rounds = Vec::new();
        Self::of(store, StoredJournal { stored, rounds, acts, end: None })
    }

    /// Reads the rest of a journal of which some, or all, was read.
    pub(in super::super) fn of(store: Store, journal: StoredJournal) -> Self {
        let StoredJournal { stored, rounds, acts, end } = journal;
        let (at, head) = (Position::Opening, Head::START);
        Self { store, stored, at, head, acts, rounds: rounds.into(), end }
    }

    /// Writes one more piece: a beginning of a line, an act, or an end of a line. False where nothing is left.
    async fn write(&mut self, out: &mut String, bytes_max: usize) -> Result<bool, StoreError> {
        self.at = match std::mem::replace(&mut self.at, Position::Done) {
            Position::Opening => {
                self.add(out, &self.stored.opening.clone());
                Position::Before(0)
            }
            Position::Before(round) => self.before(round, out).await?,
            Position::In(line) => self.resume_line(line, out, bytes_max).await?,
            Position::End => self.end(out, bytes_max).await?,
            Position::Done => return Ok(false),
        };
        Ok(true)
    }

    /// Adds the line of a whole record.
    fn add(&mut self, out: &mut String, record: &RawRecord) {
        let line;
        (line, self.head) = next_line(record, self.head);
        out.push_str(&line);
    }

    /// Writes the next line, or its beginning: who holds which seat, a round, or neither.
    async fn before(&mut self, round: u32, out: &mut String) -> Result<Position, StoreError> {
        if round == self.stored.first_round
            && let Some(seating) = self.stored.seating.take()
        {
            self.add(out, &seating);
        }
        if round < self.stored.rounds { self.begin(round, out).await } else { Ok(Position::End) }
    }

    async fn begin(&mut self, round: u32, out: &mut String) -> Result<Position, StoreError> {
        if self.rounds.is_empty() {
            let to = self.stored.rounds.min(round.saturating_add(ROUNDS));
            self.rounds = self.store.resolved(self.stored.episode, round, to).await?.into();
        }
        let stored = self.rounds.pop_front().filter(|stored| stored.round == round);
        let stored = stored.ok_or_else(|| self.broken(&format!("round {round} is missing")))?;
        self.head = stored.head;
        let digest = data_encoding::HEXLOWER.encode(&stored.digest);
        let Frame { before, after } = Frame::of_round(round, &digest, stored.score, stored.head);
        out.push_str(&before);
        Ok(Position::In(OpenLine { round, after, has_acts: false, left: None }))
    }

    /// Writes the next acts of a line, or its end.
    async fn resume_line(
        &mut self,
        mut line: OpenLine,
        out: &mut String,
        bytes_max: usize,
    ) -> Result<Position, StoreError> {
        let Some(act) = self.acts.next_of(line.round, bytes_max).await? else {
            out.push_str(&line.after);
            return match line.left {
                None => Ok(Position::Before(line.round + 1)),
                Some(0) => Ok(Position::Done),
                Some(_) => Err(self.broken("its open acts differ from those in its end")),
            };
        };
        let comma = if line.has_acts { "," } else { "" };
        line.left = line.left.map(|left| left.wrapping_sub(comma.len() + act.len()));
        line.has_acts = true;
        out.push_str(comma);
        out.push_str(&act);
        Ok(Position::In(line))
    }

    /// Writes the end record: whole, or its beginning where it is large.
    async fn end(&mut self, out: &mut String, bytes_max: usize) -> Result<Position, StoreError> {
        let StoredEpisode { episode, head, rounds, score, .. } = self.stored;
        if let Some(record) = self.end.take() {
            out.push_str(&record.line(head));
            return Ok(Position::Done);
        }
        let record = match self.stored.ended_at {
            Some(_) => self.store.end_record(episode, bytes_max).await?,
            None => None,
        };
        let Some((bytes, record)) = record else { return Ok(Position::Done) };
        if let Some(record) = record {
            out.push_str(&record.line(head));
            return Ok(Position::Done);
        }
        let end = End {
            status: self.stored.status.clone(),
            reason: self.stored.reason.clone().unwrap_or_default(),
            rounds,
            score,
            open_acts: Vec::new(),
        };
        let bare = Frame::of_end(end, head);
        out.push_str(&bare.before);
        let around = bare.before.len() + bare.after.len() - LINE_BYTES;
        let left = Some(bytes.wrapping_sub(around));
        Ok(Position::In(OpenLine { round: rounds, after: bare.after, has_acts: false, left }))
    }

    fn broken(&self, problem: &str) -> StoreError {
        StoreError::broken(format!("the journal of {}: {problem}", self.stored.id))
    }
}

/// Bytes of a line beside its record: the names, the hash, and the end of the line.
const LINE_BYTES: usize = "{\"hash\":\"\",\"record\":}\n".len() + 64;

impl Parts for JournalReader {
    async fn next(&mut self, bytes_max: usize) -> Result<Option<Vec<u8>>, StoreError> {
        let mut out = String::new();
        while out.len() < bytes_max && self.write(&mut out, bytes_max).await? {}
        Ok(Some(out.into_bytes()).filter(|part| !part.is_empty()))
    }
}
