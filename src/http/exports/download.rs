//! `GET /api/v1/exports/{file}`: the toolkit's data format and tables, sent while they are written.

use std::io::{self, Write};

use axum::body::Body;
use axum::http::{HeaderMap, header};
use axum::response::IntoResponse;
use bytes::Bytes;
use futures::StreamExt;
use serde::Deserialize;
use serde_json::json;
use swarmbench_engine::TaskName;
use tokio::runtime::Handle;
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::DropGuard;
use utoipa::IntoParams;

use super::super::accept::{self, Binary};
use super::super::episodes::spec;
use super::super::extract::{one_of, optional_flag};
use super::super::prelude::*;
use super::super::seeds::SeedPermit;
use super::super::stream::{patiently, refused};
use crate::budget::Reservation;
use crate::dataset::export::{Export, ExportError, Exported, Selection};
use crate::dataset::files::Archive;
use crate::dataset::tables::TableName;
use crate::episode::Status;
use crate::fair::{FairLimit, Origin, Party, Permit, Rank};
use crate::ids::EpisodeId;
use crate::store;
use crate::store::episodes::{Filter, Readable};
use swarmbench_protocol::any_case;

/// Bytes sent at once.
const PIECE_BYTES: usize = 64 * 1024;

/// Pieces buffered for a slow reader before the export waits for it.
const PIECES_PENDING: usize = 4;

/// Memory reserved for an export: two states and the buffered pieces.
const EXPORT_BYTES: usize = 12 * 1024 * 1024;

/// Additional bytes for a row group of Parquet.
const ROW_GROUP_BYTES: usize = 20 * 1024 * 1024;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ExportParams {
    /// Id of a run.
    run: Option<String>,
    /// Name of a task.
    #[serde(default, deserialize_with = "any_case::task")]
    task: Option<String>,
    /// Name of a model that held a seat; acts are limited to those of its seats.
    model: Option<String>,
    /// Whether the seats had several holders; both kinds by default.
    #[serde(default, deserialize_with = "optional_flag")]
    mixed: Option<bool>,
    /// Status: `waiting`, `running`, `finished`, `aborted` or `abandoned`; by default all episodes that have ended.
    status: Option<String>,
    /// Whether forks are exported, too; by default they are left out, except one that `episode` names.
    #[serde(default, deserialize_with = "optional_flag")]
    forks: Option<bool>,
    /// Id of an episode.
    episode: Option<String>,
}

/// A file that can be downloaded.
#[derive(Clone, Copy)]
enum File {
    Dataset,
    Lines(TableName),
    Parquet(TableName),
}

impl File {
    fn parse(name: &str) -> Option<Self> {
        if name == "dataset.zip" {
            return Some(Self::Dataset);
        }
        let (table, format) = name.split_once('.')?;
        let table = TableName::parse(table)?;
        match format {
            "jsonl" => Some(Self::Lines(table)),
            "parquet" => Some(Self::Parquet(table)),
            _ => None,
        }
    }

    /// Bytes of memory reserved while the file is written.
    const fn memory(self) -> usize {
        match self {
            Self::Dataset | Self::Lines(_) => EXPORT_BYTES,
            Self::Parquet(_) => EXPORT_BYTES + ROW_GROUP_BYTES,
        }
    }

    const fn content_type(self) -> &'static str {
        match self {
            Self::Dataset => "application/zip",
            Self::Lines(_) => "application/x-ndjson",
            Self::Parquet(_) => "application/vnd.apache.parquet",
        }
    }

    fn write(self, export: Export<'_>, mut out: Pieces) -> Result<Exported, ExportError> {
        let exported = match self {
            Self::Dataset => export.dataset(&mut Archive::new(&mut out))?,
            Self::Lines(table) => export.lines(table, &mut out)?,
            Self::Parquet(table) => export.parquet(table, &mut out)?,
        };
        out.flush()?;
        Ok(exported)
    }
}

/// Export episodes that have ended.
///
/// `dataset.zip` has the files of the public toolkit: `meta_log.json`, `game_log_<run_id>.json` and `agent_log_<run_id>.json`.
/// `episodes`, `acts`, `rounds`, `heard` and `views` are tables with one row for each episode, act, state, received message or window,
/// as JSON Lines (`.jsonl`) or Parquet (`.parquet`). Episodes that the caller may not read are left out, and sealed ones that
/// neither `episode` nor `run` names. An answer that breaks off is incomplete. With
/// `Accept: application/octet-stream` any file comes as plain bytes.
#[utoipa::path(
    get,
    path = "/api/v1/exports/{file}",
    operation_id = "download_export",
    tag = "data",
    params(
        ("file" = String, Path, description = "`dataset.zip`, or `episodes`, `acts`, `rounds`, `heard` or `views` with `.jsonl` or `.parquet`", example = "acts.jsonl"),
        ExportParams,
    ),
    responses(
        (status = 200, description = "The file", content(
            (String = "application/x-ndjson"),
            (Binary = "application/zip"),
            (Binary = "application/vnd.apache.parquet"),
            (Binary = "application/octet-stream"),
        )),
    )
)]
pub(in super::super) async fn download_export(
    State(app): State<App>,
    caller: Caller,
    Id(name): Id,
    headers: HeaderMap,
    Params(params): Params<ExportParams>,
) -> Result<Response, ApiError> {
    let file = File::parse(&name).ok_or_else(|| ApiError::not_found("the file"))?;
    let (selection, named) = selection(&app, &caller, params).await?;
    let party = Party::current();
    let open = app.streams.exports.reserve(1, Some(party), caller.rank())?;
    let room = app.registry.room_of(file.memory(), Some(party), caller.rank())?;
    let permit = app.streams.parts.acquire(party, Rank::Normal).await.map_err(refused)?;
    // Organizers and judges export games that nobody else may read yet.
    let audit_entry = caller.audit_entry(
        &app,
        "export",
        &name,
        json!({ "run": selection.filter.run.is_some() }),
        None,
    );
    app.store.keep(audit_entry.into_iter().collect()).await?;
    let (pieces, body) = mpsc::channel(PIECES_PENDING);
    let (selected, is_selected) = oneshot::channel();
    // Cancelled when the client hangs up: the guard is owned first by this handler, then by the body.
    let stop = app.stop.child_token();
    let reader = stop.clone().drop_guard();
    let export = move || {
        let may = |stored: &_| {
            let permit = |spec| named.or(app.open_permit_of_game(&caller, stored, &spec));
            spec(stored).is_ok_and(|spec| permit(spec).is_granted())
        };
        let select = Export::select(&app.store, &selection, may, |_, _| (), stop);
        let export = match select {
            Ok(export) => export,
            Err(error) => return drop(selected.send(Err(error))),
        };
        if selected.send(Ok(())).is_err() {
            return;
        }
        let working = Working { limit: app.streams.parts.clone(), party, permit: Some(permit) };
        let (gathered, to) = (Vec::new(), pieces.clone());
        let out = Pieces { gathered, to, working, _held: [open, room] };
        let written = store::patiently_blocking(|| file.write(export, out));
        if let Err(error) = written {
            // The reader must notice that the file is incomplete.
            tracing::info!(%error, "an export broke off");
            drop(pieces.blocking_send(Err(io::Error::other(error))));
        }
    };
    let origin = Origin::of(party, Rank::Normal);
    crate::telemetry::spawn_blocking(move || origin.enter(export));
    let stopped = |_| ApiError::new(Code::Internal, "the export ended before it began");
    is_selected.await.map_err(stopped)?.map_err(|error| match error {
        ExportError::Journal(error) => error.into(),
        ExportError::Unknown(_) => ApiError::not_found("the episode"),
        error @ (ExportError::Io(_) | ExportError::Table(_) | ExportError::Stopped) => {
            ApiError::new(Code::Internal, error.to_string())
        }
    })?;
    let kind = [
        (header::CONTENT_TYPE, accept::file_type(&headers, file.content_type()).to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ];
    Ok(accept::by_accept((kind, read_by(reader, body)).into_response()))
}

/// A body that owns a guard, and drops it when it is dropped.
fn read_by(reader: DropGuard, pieces: mpsc::Receiver<io::Result<Bytes>>) -> Body {
    Body::from_stream(ReceiverStream::new(pieces).inspect(move |_| _ = &reader))
}

/// Validates the query. The permit is the one for sealed games that an organizer or a judge names by their own id or by that of
/// their run: the audit log has the look. Of all other games each has a permit of its own.
async fn selection(
    app: &App,
    caller: &Caller,
    params: ExportParams,
) -> Result<(Selection, SeedPermit), ApiError> {
    one_of("status", params.status.as_deref(), &Status::ALL.map(Status::name))?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let mut readable = caller.readable(app);
    let mut run = None;
    let mut named = SeedPermit::default();
    if let Some(id) = &params.episode {
        let (stored, spec) = app.known_episode(caller, id.clone()).await?;
        named = app.permit_of_game(caller, &stored, &spec).await?;
    }
    if let Some(id) = params.run {
        match app.store.find_run(&id).await? {
            Some(found) => {
                run = Some(found.run);
                if params.episode.is_none() && caller.reads_all() {
                    named = app.permit_of_run(caller, found).await?;
                }
            }
            None => readable = Readable::Nothing,
        }
    }
    let filter = Filter {
        status: params.status,
        task: params.task,
        played_by: params.model,
        mixed: params.mixed,
        forks: Filter::of_forks(params.forks.unwrap_or(false), params.episode.is_some()),
        run,
        readable,
        ..Filter::default()
    };
    Ok((Selection { filter, episode: params.episode.map(EpisodeId::from_text) }, named))
}

/// Sending side of a body, for an export that runs on another thread and waits for its reader.
struct Pieces {
    gathered: Vec<u8>,
    to: mpsc::Sender<io::Result<Bytes>>,
    working: Working,
    /// Reservations of an open export and of its memory.
    _held: [Reservation; 2],
}

/// The permit to make pieces, returned while the export waits for its reader.
struct Working {
    limit: FairLimit,
    party: Party,
    permit: Option<Permit>,
}

impl Pieces {
    fn send(&mut self) -> io::Result<()> {
        let piece = Bytes::from(std::mem::take(&mut self.gathered));
        let gone = || io::Error::from(io::ErrorKind::BrokenPipe);
        if piece.is_empty() {
            return Ok(());
        }
        match self.to.try_send(Ok(piece)) {
            Ok(()) => Ok(()),
            Err(TrySendError::Closed(_)) => Err(gone()),
            Err(TrySendError::Full(piece)) => {
                self.working.permit = None;
                self.to.blocking_send(piece).map_err(|_| gone())?;
                let permit = patiently(&self.working.limit, self.working.party);
                self.working.permit = Some(Handle::current().block_on(permit));
                Ok(())
            }
        }
    }
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.gathered.extend_from_slice(bytes);
        if self.gathered.len() >= PIECE_BYTES {
            self.send()?;
        }
        Ok(bytes.len())
    }

    /// Sends the gathered bytes, however few they are.
    fn flush(&mut self) -> io::Result<()> {
        self.send()
    }
}

#[cfg(test)]
mod tests {
    use tokio_util::sync::CancellationToken;

    use super::*;

    #[tokio::test]
    async fn an_export_stops_when_its_body_is_dropped() {
        let stop = CancellationToken::new();
        let (pieces, receiver) = mpsc::channel(1);
        let mut body = read_by(stop.clone().drop_guard(), receiver).into_data_stream();
        pieces.send(Ok(Bytes::from_static(b"piece"))).await.expect("a reader");
        assert_eq!(body.next().await.expect("a piece").expect("bytes"), "piece");
        assert!(!stop.is_cancelled());
        drop(body);
        assert!(stop.is_cancelled());
    }
}
