//! `GET /api/v1/competitions/{id}/board`.

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::{Id, Params};
use super::super::refusals::{IdRefusals, QueryRefusals, TokenRefusals};
use crate::competition::phase::{BoardView, board_view};
use crate::store::competitions::Declared;
use crate::wire::board::text as safe_cell;
use crate::wire::competition::{CompetitionBoard, CompetitionRow};

/// How the board is to be written.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct BoardParams {
    /// `json` or `csv`.
    #[param(example = "json")]
    format: Option<String>,
}

/// Show the board of a competition, as JSON or CSV.
///
/// As long as seeds are sealed it shows ranks and totals, or nothing, as the organizer decided; organizers see all of
/// it at any time. A game that was planned and not played counts as 0; one that the host broke does not count.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/board",
    operation_id = "show_board",
    tag = "competitions",
    params(("id" = String, Path, description = "The competition's id"), BoardParams),
    security((), ("key" = [])),
    responses(
        (status = 200, description = "The board", content(
            (CompetitionBoard = "application/json"),
            (String = "text/csv"),
        )),
        IdRefusals,
        QueryRefusals,
        TokenRefusals,
    )
)]
pub(in super::super) async fn show_board(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<BoardParams>,
) -> Result<Response, ApiError> {
    let is_csv = match params.format.as_deref() {
        None | Some("json") => false,
        Some("csv") => true,
        Some(_) => {
            return Err(ApiError::new(Code::Malformed, "format must be one of json, csv"));
        }
    };
    let competition = app.competition(&caller, &id).await?;
    let is_revealed = competition.revealed_at.is_some();
    let view = if caller.is_organizer() {
        BoardView::All
    } else {
        board_view(&competition.definition, is_revealed, app.clock.wall())
    };
    let (shows, before) = match view {
        BoardView::Nothing => ("nothing", None),
        BoardView::Totals => ("totals", None),
        BoardView::TotalsBefore(at) => ("totals", Some(at)),
        BoardView::All => ("all", None),
    };
    let make = async {
        let mut board = CompetitionBoard {
            shows: shows.to_owned(),
            frozen_at: before,
            items: Vec::new(),
            next_cursor: None,
        };
        if view == BoardView::Nothing {
            return written(&board, is_csv);
        }
        let field = app.field(competition, Declared::Short).await?;
        let with_tasks = view == BoardView::All;
        let make = move || {
            board.items = field.shown(before, with_tasks)?;
            written(&board, is_csv)
        };
        app.render(make).await?
    };
    app.made_once(format!("board of {id}: {view:?} {is_csv}"), Box::pin(make)).await
}

/// The board as JSON or CSV.
fn written(board: &CompetitionBoard, is_csv: bool) -> Result<Response, ApiError> {
    if is_csv {
        let kind = [(header::CONTENT_TYPE, "text/csv; charset=utf-8")];
        return Ok((kind, csv(board)?).into_response());
    }
    Ok(Json(board).into_response())
}

/// The board as CSV: a line a row, the tasks in columns of their own.
fn csv(board: &CompetitionBoard) -> Result<Vec<u8>, ApiError> {
    let failed = |error: csv::Error| ApiError::new(Code::Internal, error.to_string());
    let mut writer = csv::Writer::from_writer(Vec::new());
    let first = board.items.iter().find(|row| !row.tasks.is_empty());
    let tasks: Vec<&str> =
        first.map_or(Vec::new(), |row| row.tasks.iter().map(|task| task.task.as_str()).collect());
    let mut head: Vec<String> = [
        "rank",
        "entrant",
        "name",
        "model",
        "temperature",
        "top_p",
        "prompt_template",
        "status",
        "reason",
        "vouched",
        "decentralization",
        "attempt",
        "run",
        "run_status",
        "total",
    ]
    .map(str::to_owned)
    .to_vec();
    for task in &tasks {
        let columns = ["mean", "deviation", "games", "planned"];
        head.extend(columns.map(|column| format!("{task}_{column}")));
    }
    let last = ["invalid_share", "clock_share", "voided_games", "attempts", "voided_attempts"];
    head.extend(last.map(str::to_owned));
    writer.write_record(&head).map_err(failed)?;
    for row in &board.items {
        writer.write_record(cells(row, &tasks)).map_err(failed)?;
    }
    writer.into_inner().map_err(|error| ApiError::new(Code::Internal, error.to_string()))
}

fn cells(row: &CompetitionRow, tasks: &[&str]) -> Vec<String> {
    fn text<T: ToString>(value: Option<T>) -> String {
        value.map_or_else(String::new, |value| value.to_string())
    }
    let entrant = &row.entrant;
    let mut cells = vec![
        text(row.rank),
        entrant.id.clone(),
        safe_cell(&entrant.name),
        safe_cell(&entrant.model),
        text(entrant.temperature),
        text(entrant.top_p),
        text(entrant.prompt_template.clone()),
        entrant.status.clone(),
        safe_cell(entrant.reason.as_deref().unwrap_or_default()),
        entrant.vouched.to_string(),
        text(row.decentralization.clone()),
        text(row.attempt),
        text(row.run.clone()),
        text(row.run_status.clone()),
        text(row.total),
    ];
    for name in tasks {
        let task = row.tasks.iter().find(|task| task.task == *name);
        cells.extend([
            text(task.and_then(|task| task.mean)),
            text(task.and_then(|task| task.deviation)),
            text(task.map(|task| task.games)),
            text(task.map(|task| task.planned)),
        ]);
    }
    cells.extend([
        row.invalid_share.to_string(),
        row.clock_share.to_string(),
        row.voided_games.to_string(),
        row.attempts.to_string(),
        row.voided_attempts.to_string(),
    ]);
    cells
}
