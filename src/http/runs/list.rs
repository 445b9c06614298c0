//! `GET /api/v1/runs`.

use super::super::extract::one_of;
use super::super::page::{LARGE_ROWS_MAX, list_params};
use super::super::prelude::*;
use super::Known;
use crate::ids::RunKey;
use crate::run::RunStatus;
use crate::store::runs::{RunFilter, StoredRun};
use swarmbench_protocol::run::RunList;

list_params! {
    ListParams {
        /// Status: `running`, `finished`, `aborted`, `abandoned` or `closed`.
        status,
        /// Name of a model.
        model,
        /// Name of a suite.
        suite,
    }
}

/// List runs, newest first.
///
/// Runs that the caller may not see before their end are listed after it.
#[utoipa::path(
    get,
    path = "/api/v1/runs",
    operation_id = "list_runs",
    tag = "runs",
    params(ListParams),
    responses((status = 200, description = "A page of runs", body = RunList))
)]
pub(in super::super) async fn list_runs(
    State(app): State<App>,
    caller: Caller,
    Params(params): Params<ListParams>,
) -> Result<Response, ApiError> {
    one_of("status", params.status.as_deref(), &RunStatus::ALL.map(RunStatus::name))?;
    let page = params.page(&app)?;
    let filter = RunFilter {
        status: params.status,
        model: params.model,
        suite: params.suite,
        readable: caller.readable(&app),
    };
    let (store, filter) = (&app.store, &filter);
    let read = |before: Option<i64>, rows| async move {
        let stored = store.list_runs(filter, before.map(RunKey), rows).await?;
        let keys: Vec<RunKey> = stored.iter().map(|run| run.run).collect();
        let mut games = store.games_of_all(&keys).await?;
        let games_of = |run: StoredRun| {
            let games = games.remove(&run.run).unwrap_or_default();
            (run, games)
        };
        Ok(stored.into_iter().map(games_of).collect::<Vec<_>>())
    };
    // A run may have a thousand games.
    page.fill(LARGE_ROWS_MAX, read, |(stored, games)| {
        let known = Known::of(&app, stored)?;
        let seeds = known.open_seeds(&app, &caller);
        Ok((known.stored.run.0, known.summary(&app, &caller, seeds, &games)))
    })
    .await
}
