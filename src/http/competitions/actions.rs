//! `GET /api/v1/competitions/{id}/actions`: actions of organizers.

use super::super::page::{NewestParams, ROWS_MAX};
use super::super::prelude::*;
use crate::store::audit::ShownAction;
use swarmbench_protocol::competition::{OrganizerAction, OrganizerActions};

/// List the actions of organizers in a competition, newest first, as everybody may see them.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/actions",
    operation_id = "list_actions",
    tag = "competitions",
    params(NewestParams),
    responses((status = 200, description = "A page of actions", body = OrganizerActions))
)]
pub(in super::super) async fn list_actions(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<NewestParams>,
) -> Result<Response, ApiError> {
    let competition = app.competition(&caller, &id).await?;
    let page = params.page(&app)?;
    page.fill(
        ROWS_MAX,
        |before, rows| app.store.actions_in(competition.key, None, before, rows),
        |row| {
            let ShownAction { number, at, action, subject, shown } = row;
            Ok((number, OrganizerAction { at: at.into(), action, subject, detail: shown }))
        },
    )
    .await
}
