//! `GET /api/v1/cross-play`.

use axum::http::HeaderMap;
use serde::Deserialize;
use swarmbench_engine::TaskName;
use utoipa::IntoParams;

use super::super::accept::by_accept;
use super::super::extract::one_of;
use super::super::page::cursor_by;
use super::super::prelude::*;
use super::Format;
use swarmbench_boards::cross_play::pairs;
use swarmbench_boards::page;
use swarmbench_protocol::any_case;
use swarmbench_protocol::board::CrossPlay;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct CrossPlayParams {
    /// Name of a task; all tasks by default.
    #[serde(default, deserialize_with = "any_case::task")]
    task: Option<String>,
    /// Rule set: `paper` or `reference`; both by default.
    #[serde(default, deserialize_with = "any_case::rules")]
    rules: Option<String>,
    /// Format: `json` or `csv`; the header `Accept` decides by default.
    format: Option<String>,
    /// Maximum number of pairs, up to 1,000; by default 50, and 1,000 for CSV.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// Show the scores of pairs of models that played together.
///
/// The models had seats of the same episode, as different holders. Each pair covers all its finished episodes of equal
/// settings. All pages except the last name the next one in `next_cursor` and in the header `X-Next-Cursor`.
#[utoipa::path(
    get,
    path = "/api/v1/cross-play",
    operation_id = "show_cross_play",
    tag = "boards",
    params(CrossPlayParams),
    responses(
        (status = 200, description = "The pairs, or a page of them", content(
            (CrossPlay = "application/json"),
            (String = "text/csv"),
        )),
        (status = 403, description = "`forbidden`: a token of an episode, on a private server"),
    )
)]
pub(in super::super) async fn show_cross_play(
    State(app): State<App>,
    caller: Caller,
    headers: HeaderMap,
    Params(params): Params<CrossPlayParams>,
) -> Result<Response, ApiError> {
    caller.may_read_boards(&app.access)?;
    let format = Format::wanted(params.format.as_deref(), &headers)?;
    let limit = format.page_limit(&app, params.limit)?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let task = params.task.as_deref().and_then(TaskName::parse);
    one_of("rules", params.rules.as_deref(), &["paper", "reference"])?;
    let start = cursor_by(params.cursor.as_deref(), page::read_cross_play_cursor)?.unwrap_or(0);
    let asked = format!("cross-play {task:?} {:?} {start} {limit} {format:?}", params.rules);
    let bytes_max = app.limits.answer_bytes_max;
    let make = async {
        let games = app.standings.mixed().await?;
        let answer = app.heavy.render(move || {
            let asked = games.values().filter(|game| {
                task.is_none_or(|task| game.setting.task == task)
                    && params.rules.as_ref().is_none_or(|rules| game.setting.rules == *rules)
            });
            let pairs = pairs(asked.map(|game| &**game));
            let page = |limit| page::cross_play(&pairs, start, limit);
            by_accept(format.page(bytes_max, limit, page))
        });
        answer.await
    };
    app.answers.answer(asked, Box::pin(make)).await
}
