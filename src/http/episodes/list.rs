//! `GET /api/v1/episodes`.

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use swarmbench_engine::TaskName;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Params, one_of, page_limit, read_cursor};
use super::super::page::{Page, ROWS_MAX};
use super::super::refusals::{QueryRefusals, TokenRefusals};
use crate::episode::Status;
use crate::ids::EpisodeKey;
use crate::store::episodes::Filter;
use crate::wire::episode::EpisodeList;

/// Which episodes to list.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ListParams {
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    status: Option<String>,
    /// A task's name.
    task: Option<String>,
    /// A model's name.
    model: Option<String>,
    /// A run's id.
    run: Option<String>,
    /// How many at most, up to 1,000; 50 where it is left out.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List episodes, newest first.
///
/// Episodes that the caller may not read before their end are listed after it.
#[utoipa::path(
    get,
    path = "/api/v1/episodes",
    operation_id = "list_episodes",
    tag = "episodes",
    params(ListParams),
    security((), ("seat" = []), ("swarm" = []), ("key" = [])),
    responses(
        (status = 200, description = "A page of episodes", body = EpisodeList),
        QueryRefusals,
        TokenRefusals,
    )
)]
pub(in super::super) async fn list_episodes(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ListParams>,
) -> Result<Response, ApiError> {
    let limit = page_limit(&app, params.limit, app.limits.page_items_default)?;
    one_of("status", params.status.as_deref(), &Status::ALL.map(Status::name))?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let mut page = Page::new(&app, read_cursor(params.cursor.as_deref())?, limit).await?;
    let run = match params.run {
        None => None,
        Some(id) => match app.store.find_run(&id).await? {
            Some(run) => Some(run.run),
            None => return Ok(page.answer()),
        },
    };
    let filter = Filter {
        status: params.status,
        task: params.task,
        model: params.model,
        run,
        readable: caller.readable(&app.access),
    };
    while let Some(rows) = page.wants(ROWS_MAX) {
        let before = page.place().map(EpisodeKey);
        let stored = app.store.list_episodes(&filter, before, rows).await?;
        page.add(rows, stored, |stored| Ok((stored.episode.0, app.summary_of(&caller, &stored)?)))?;
    }
    Ok(page.answer())
}
