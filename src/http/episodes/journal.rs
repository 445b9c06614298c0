//! `GET /api/v1/episodes/{id}/journal`: JSON Lines, enough to play the episode again.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures::stream;
use tokio::sync::OwnedSemaphorePermit;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::{Id, Nothing, Params};
use super::super::refusals::{IdRefusals, QueryRefusals, TokenRefusals};
use crate::journal::record::{RawRecord, first_lines, round_record};
use crate::journal::{Journal, JournalError, StoredEpisode};
use crate::wire::problem::Problem;

/// Rounds that are read at once.
const CHUNK: u32 = 8;

/// Read an episode's journal (JSON Lines).
///
/// First the opening (configuration, rules revision, prompt template), then every resolved round
/// with its acts and the digest of the state after it, at last the end. Each line holds the head of
/// the chain of hashes after it. `swarmbench verify FILE` plays it again.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/journal",
    operation_id = "read_journal",
    tag = "episodes",
    params(("id" = String, Path, description = "The episode's id")),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
    responses(
        (status = 200, description = "One record a line", body = String, content_type = "application/x-ndjson"),
        IdRefusals,
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: only the creator may read it before the end, as it holds the seed", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn read_journal(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Response, ApiError> {
    let (stored, spec) = app.known(&caller, id).await?;
    if !app.may_read_journal(&caller, &stored) {
        let detail = if spec.is_mixed() {
            "a journal holds the seed and what all holders of seats answer: it is shown after the end"
        } else {
            "a journal holds the seed: until the end only the creator may read it"
        };
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    let turn = app.journal_turn()?;
    app.note_look(&caller, &stored, spec.visibility).await?;
    // Its last record, too, and all as it stands now.
    let stored = app.store.find_episode(&stored.id).await?;
    let stored = stored.ok_or_else(|| ApiError::not_found("the episode"))?;
    let reader = JournalReader::new(Arc::clone(app.registry.journal()), stored);
    let lines = stream::try_unfold((reader, turn), |(mut reader, turn)| async move {
        let lines = reader.next().await?;
        Ok::<_, JournalError>(lines.map(|lines| (lines, (reader, turn))))
    });
    let kind = [(header::CONTENT_TYPE, "application/x-ndjson")];
    Ok((kind, Body::from_stream(lines)).into_response())
}

impl App {
    /// A turn to read a journal: it is to be held until the journal was sent, or its reader is gone.
    pub(in super::super) fn journal_turn(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let most = self.limits.journals_max;
        Arc::clone(&self.journals).try_acquire_owned().map_err(|_| {
            let detail = format!("{most} journals are being read already; come again later");
            ApiError::limit(Code::Overloaded, "journals_max", most, detail)
                .retry_after(Duration::from_secs(1))
        })
    }
}

/// Reads a journal from the store piece by piece, in constant memory.
pub(in super::super) struct JournalReader {
    journal: Arc<dyn Journal>,
    stored: StoredEpisode,
    at: Place,
}

enum Place {
    Opening,
    Round(u32),
    End,
    Done,
}

impl JournalReader {
    /// Reads the journal of an episode that was read with its last record.
    pub(in super::super) fn new(journal: Arc<dyn Journal>, stored: StoredEpisode) -> Self {
        Self { journal, stored, at: Place::Opening }
    }

    /// The next lines; none at the end.
    pub(in super::super) async fn next(&mut self) -> Result<Option<Bytes>, JournalError> {
        loop {
            match self.at {
                Place::Opening => {
                    self.at = Place::Round(0);
                    let StoredEpisode { opening, seating, .. } = &self.stored;
                    return Ok(Some(first_lines(opening, seating.as_ref()).into()));
                }
                Place::Round(round) if round < self.stored.rounds => {
                    let to = self.stored.rounds.min(round + CHUNK);
                    self.at = Place::Round(to);
                    return self.rounds(round, to).await.map(Some);
                }
                Place::Round(_) => self.at = Place::End,
                Place::End => {
                    self.at = Place::Done;
                    if let Some(end) = &self.stored.end {
                        return Ok(Some(end.line(self.stored.head).into()));
                    }
                }
                Place::Done => return Ok(None),
            }
        }
    }

    async fn rounds(&self, from: u32, to: u32) -> Result<Bytes, JournalError> {
        let acts = self.journal.acts(self.stored.episode, from, to).await?;
        let rounds = self.journal.rounds(self.stored.episode, from, to).await?;
        let mut lines = String::new();
        for round in rounds {
            let given = acts.iter().find(|(number, _)| *number == round.round);
            let records = given.iter().flat_map(|(_, acts)| acts).map(|(_, act)| &act.raw);
            let digest = data_encoding::HEXLOWER.encode(&round.digest);
            let record: RawRecord = round_record(round.round, records, &digest, round.score);
            lines.push_str(&record.line(round.head));
        }
        Ok(lines.into())
    }
}
