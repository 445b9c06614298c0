//! `GET /api/v1/episodes`.

use swarmbench_engine::TaskName;

use super::super::extract::one_of;
use super::super::page::{ROWS_MAX, list_params};
use super::super::prelude::*;
use crate::episode::Status;
use crate::ids::EpisodeKey;
use crate::store::episodes::Filter;
use swarmbench_protocol::any_case;
use swarmbench_protocol::episode::EpisodeList;

list_params! {
    ListParams {
        /// Status: `waiting`, `running`, `finished`, `aborted` or `abandoned`.
        status,
        /// Name of a task.
        #[serde(default, deserialize_with = "any_case::task")]
        task,
        /// Name of a model.
        model,
        /// Id of a run.
        run,
        /// Id of an episode: only its forks are listed.
        fork_of,
    }
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
    responses((status = 200, description = "A page of episodes", body = EpisodeList))
)]
pub(in super::super) async fn list_episodes(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ListParams>,
) -> Result<Response, ApiError> {
    one_of("status", params.status.as_deref(), &Status::ALL.map(Status::name))?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    let page = params.page(&app)?;
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
        fork_of: params.fork_of,
        readable: caller.readable(&app),
        ..Filter::default()
    };
    let read = |before: Option<i64>, rows| {
        app.store.list_episodes_without_templates(&filter, before.map(EpisodeKey), rows)
    };
    page.fill(ROWS_MAX, read, |stored| Ok((stored.episode.0, app.listed(&caller, &stored)?))).await
}
