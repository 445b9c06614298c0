//! `GET /api/v1/episodes`.

use swarmbench_engine::TaskName;

use super::super::extract::one_of;
use super::super::page::{ROWS_MAX, list_params};
use super::super::prelude::*;
use crate::episode::Status;
use crate::ids::EpisodeKey;
use crate::store::episodes::{Filter, Order, SortKey};
use crate::store::port::StoredEpisode;
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
        /// `true`: only episodes in which people take part and that anyone may read.
        people,
        /// Order: `newest` (by default), `oldest`, `score` (highest first), `rounds` (most first) or `seed` (lowest first); `-score`,
        /// `-rounds` and `-seed` turn these around, and list only ended episodes that anyone may read.
        sort,
        /// `true`: ended episodes have their `curve`; a sealed one once its competition is revealed.
        curves,
    }
}

/// Names of the orders, the first character of their cursors, and the orders.
const ORDERS: [(&str, char, Option<SortKey>, bool); 8] = [
    ("newest", 'c', None, false),
    ("oldest", 'o', None, true),
    ("score", 's', Some(SortKey::SCORE), false),
    ("-score", 'S', Some(SortKey::SCORE), true),
    ("rounds", 'r', Some(SortKey::ROUNDS), false),
    ("-rounds", 'R', Some(SortKey::ROUNDS), true),
    ("seed", 'd', Some(SortKey::SEED), true),
    ("-seed", 'D', Some(SortKey::SEED), false),
];

/// List episodes, newest first by default.
///
/// Episodes that the caller may not read before their end are listed after it. A page of a sorted list may be short, even empty,
/// although `next_cursor` names another one: the server looks at a limited number of episodes for each.
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
    Params(mut params): Params<ListParams>,
) -> Result<Response, ApiError> {
    one_of("status", params.status.as_deref(), &Status::ALL.map(Status::name))?;
    one_of("task", params.task.as_deref(), &TaskName::ALL.map(TaskName::name))?;
    for (name, value) in [("people", &params.people), ("curves", &params.curves)] {
        one_of(name, value.as_deref(), &["true", "false"])?;
    }
    one_of("sort", params.sort.as_deref(), &ORDERS.map(|(name, ..)| name))?;
    let sort = params.sort.as_deref();
    let known = ORDERS.iter().find(|(name, ..)| Some(*name) == sort).unwrap_or(&ORDERS[0]);
    let (_, mark, by, is_ascending) = *known;
    let cursor = params.cursor.take();
    let page = params.page(&app)?.ordered(mark, cursor.as_deref())?;
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
        people: params.people.as_deref() == Some("true"),
        readable: caller.readable(&app),
        ..Filter::default()
    };
    let order = Order { by, is_ascending };
    let has_curves = params.curves.as_deref() == Some("true");
    let read = |after: Option<i64>, rows| {
        let after = after.map(EpisodeKey);
        app.store.list_episodes_without_templates(&filter, order, has_curves, after, rows)
    };
    let show = |stored: StoredEpisode| Ok((stored.episode.0, app.listed(&caller, &stored)?));
    page.fill(ROWS_MAX, read, show).await
}
