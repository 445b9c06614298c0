//! `GET /api/v1/leaderboard`.

use axum::http::HeaderMap;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::page::cursor_by;
use super::super::prelude::*;
use super::{Format, by_accept};
use swarmbench_boards::collection::Question;
use swarmbench_boards::page::{self, read_cursor};
use swarmbench_protocol::board::Leaderboard;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct BoardParams {
    /// The suite's name; `name@digest` where several have that name. `standard` where it is left out.
    suite: Option<String>,
    /// `paper` (where it is left out) or `reference`.
    rules: Option<String>,
    /// The only task to show.
    task: Option<String>,
    /// By what rows are ranked: `total` (where it is left out), or the mean of this task.
    sort: Option<String>,
    /// Which run of a player makes its row: `best` (where it is left out), `last` or `mean`.
    pick: Option<String>,
    /// Whether the rows of the paper are shown; they are where it is left out.
    reference: Option<bool>,
    /// Whether games that were read from files are shown, too; they are not where it is left out.
    imported: Option<bool>,
    /// `json` or `csv`; where it is left out, the header `Accept` decides.
    format: Option<String>,
    /// How many rows at most, up to 1,000; where it is left out 50, and of CSV 1,000.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// The leaderboard of a suite.
///
/// A row for each player: owner, model, temperature, `top_p` and prompt template, as declared. Runs that are over
/// count, also those that were broken off; planned games that were not played count as 0. `docs/evaluate/boards.md` says how
/// everything is computed. A page that is not the last names the next in `next_cursor`, and in the header
/// `X-Next-Cursor`.
#[utoipa::path(
    get,
    path = "/api/v1/leaderboard",
    operation_id = "show_leaderboard",
    tag = "boards",
    params(BoardParams),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
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
    let question = Question {
        suite: params.suite,
        rules: params.rules,
        task: params.task,
        sort: params.sort,
        pick: params.pick,
        no_reference: params.reference == Some(false),
        imported: params.imported == Some(true),
    };
    let asked = format!("leaderboard {question:?} {after:?} {limit} {format:?}");
    let make = async {
        let boards = app.standings.boards().await?;
        let bytes_max = app.limits.answer_bytes_max;
        let answer = app.heavy.render(move || {
            let ranked = boards.ranked(&question)?;
            let start = ranked.after(after);
            let page = |limit| page::leaderboard(&ranked, start, limit);
            Ok(by_accept(format.page(bytes_max, limit, page)))
        });
        answer.await?
    };
    app.answers.answer(asked, Box::pin(make)).await
}
