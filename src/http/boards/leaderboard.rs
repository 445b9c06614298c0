//! `GET /api/v1/leaderboard`.

use axum::http::HeaderMap;
use serde::Deserialize;
use swarmbench_analysis::Definition;
use utoipa::IntoParams;

use super::super::accept::by_accept;
use super::super::extract::optional_flag;
use super::super::page::cursor_by;
use super::super::prelude::*;
use super::Format;
use super::metrics::{Means, of_tasks, wanted_metrics};
use crate::measure::method;
use crate::store::metrics::BoardMetric;
use swarmbench_boards::collection::Question;
use swarmbench_boards::page::{self, read_cursor};
use swarmbench_protocol::any_case;
use swarmbench_protocol::board::Leaderboard;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct BoardParams {
    /// Name of the suite; `name@digest` if several suites have that name. `standard` by default.
    suite: Option<String>,
    /// Rule set: `paper` (the default) or `reference`.
    #[serde(default, deserialize_with = "any_case::rules")]
    rules: Option<String>,
    /// Only task to show.
    #[serde(default, deserialize_with = "any_case::task")]
    task: Option<String>,
    /// Value by which rows are ranked: `total` (the default), or the name of a task for the mean of this task.
    sort: Option<String>,
    /// Run of a player that makes its row: `best` (the default), `last` or `mean`.
    pick: Option<String>,
    /// Whether the rows of the paper are shown; true by default.
    #[serde(default, deserialize_with = "optional_flag")]
    reference: Option<bool>,
    /// Whether the rows of people are shown; true by default.
    #[serde(default, deserialize_with = "optional_flag")]
    people: Option<bool>,
    /// Whether games that were read from files are shown, too; false by default.
    #[serde(default, deserialize_with = "optional_flag")]
    imported: Option<bool>,
    /// Metrics that are shown for each task: names separated by commas, 16 at most.
    metrics: Option<String>,
    /// Format: `json` or `csv`; the header `Accept` decides by default.
    format: Option<String>,
    /// Maximum number of rows, up to 1,000; by default 50, and 1,000 for CSV.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// Show the leaderboard of a suite.
///
/// The board has a row for each player: owner, model, temperature, `top_p` and prompt template, as declared. Runs that are over
/// count, also those that ended early; planned games that were not played count as 0. `docs/evaluate/boards.md` defines all
/// values. All pages except the last name the next one in `next_cursor` and in the header `X-Next-Cursor`.
#[utoipa::path(
    get,
    path = "/api/v1/leaderboard",
    operation_id = "show_leaderboard",
    tag = "boards",
    params(BoardParams),
    responses(
        (status = 200, description = "The board, or a page of it", content(
            (Leaderboard = "application/json"),
            (String = "text/csv"),
        )),
        (status = 403, description = "`forbidden`: a token of an episode, on a private server"),
    )
)]
pub(in super::super) async fn show_leaderboard(
    State(app): State<App>,
    caller: Caller,
    headers: HeaderMap,
    Params(params): Params<BoardParams>,
) -> Result<Response, ApiError> {
    caller.may_read_boards(&app.access)?;
    let format = Format::wanted(params.format.as_deref(), &headers)?;
    let limit = format.page_limit(&app, params.limit)?;
    let after = cursor_by(params.cursor.as_deref(), read_cursor)?;
    let metrics = params.metrics.as_deref().map_or(Ok(Vec::new()), wanted_metrics)?;
    let question = Question {
        suite: params.suite,
        rules: params.rules,
        task: params.task,
        sort: params.sort,
        pick: params.pick,
        no_reference: params.reference == Some(false),
        no_people: params.people == Some(false),
        imported: params.imported == Some(true),
    };
    // Metrics are measured after results are stored, so they have a revision of their own.
    let measured = (!metrics.is_empty()).then(|| app.store.writer().changes().measured());
    let asked =
        format!("leaderboard {question:?} {metrics:?} {measured:?} {after:?} {limit} {format:?}");
    let make = async {
        let boards = app.standings.boards().await?;
        let shows_metrics = !metrics.is_empty();
        let ranked = app.heavy.render(move || {
            let ranked = boards.ranked(&question)?;
            let start = ranked.after(after);
            let rows = if shows_metrics {
                page::leaderboard(&ranked, start, limit).items
            } else {
                Vec::new()
            };
            let runs: Vec<String> = rows.into_iter().filter_map(|row| row.run).collect();
            Ok::<_, ApiError>((ranked, start, runs))
        });
        let (ranked, start, runs) = ranked.await??;
        let means = if shows_metrics {
            app.store.mean_metrics(&runs, &metrics).await?
        } else {
            Means::new()
        };
        let bytes_max = app.limits.answer_bytes_max;
        let answer = app.heavy.render(move || {
            let page =
                |limit| with_metrics(page::leaderboard(&ranked, start, limit), &metrics, &means);
            by_accept(format.page(bytes_max, limit, page))
        });
        answer.await
    };
    app.answers.answer(asked, Box::pin(make)).await
}

/// Adds metrics to rows that belong to a run.
fn with_metrics(mut board: Leaderboard, metrics: &[BoardMetric], means: &Means) -> Leaderboard {
    if metrics.is_empty() {
        return board;
    }
    board.metrics = metrics.iter().map(|metric| metric.name().to_owned()).collect();
    board.metrics_method = Some(method(Definition::Paper));
    for row in &mut board.items {
        let Some(run) = &row.run else { continue };
        row.metrics = of_tasks(run, &board.tasks, metrics, means);
    }
    board
}
