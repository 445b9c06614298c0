//! `GET /api/v1/episodes`.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use swarmbench_engine::TaskName;
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Caller;
use super::super::error::{ApiError, Code};
use super::super::extract::Params;
use super::super::openapi::{QueryRefusals, TokenRefusals};
use crate::episode::Status;
use crate::journal::EpisodeKey;
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
) -> Result<Json<EpisodeList>, ApiError> {
    let malformed = |detail: String| ApiError::new(Code::Malformed, detail);
    let most = app.limits.page_items_max;
    let limit = params.limit.unwrap_or(app.limits.page_items_default);
    if !(1..=most).contains(&limit) {
        let detail = format!("limit must be from 1 to {most}, is {limit}");
        return Err(ApiError::limit(Code::Malformed, "page_items_max", most as usize, detail));
    }
    if let Some(status) = &params.status
        && Status::parse(status).is_none()
    {
        let names: Vec<_> = Status::ALL.iter().map(|status| status.name()).collect();
        return Err(malformed(format!("status must be one of {}", names.join(", "))));
    }
    if let Some(task) = &params.task
        && TaskName::parse(task).is_none()
    {
        let names: Vec<_> = TaskName::ALL.iter().map(|task| task.name()).collect();
        return Err(malformed(format!("task must be one of {}", names.join(", "))));
    }
    let before = match &params.cursor {
        None => None,
        Some(cursor) => Some(read_cursor(cursor).ok_or_else(|| {
            malformed("cursor must be the next_cursor of an earlier page".to_owned())
        })?),
    };
    if params.run.is_some() {
        // No episode belongs to a run yet.
        return Ok(Json(EpisodeList { items: Vec::new(), next_cursor: None }));
    }
    let filter = Filter {
        status: params.status,
        task: params.task,
        model: params.model,
        run: None,
        readable: caller.readable(&app.access),
    };
    let mut stored = app.store.list_episodes(&filter, before, limit + 1).await?;
    let has_more = stored.len() > limit as usize;
    stored.truncate(limit as usize);
    let next_cursor = stored.last().filter(|_| has_more).map(|last| write_cursor(last.episode));
    let items = stored.iter().map(|stored| app.summary_of(&caller, stored));
    Ok(Json(EpisodeList { items: items.collect::<Result<_, _>>()?, next_cursor }))
}

fn write_cursor(key: EpisodeKey) -> String {
    format!("c{:x}", key.0)
}

fn read_cursor(text: &str) -> Option<EpisodeKey> {
    i64::from_str_radix(text.strip_prefix('c')?, 16).ok().filter(|key| *key >= 0).map(EpisodeKey)
}
