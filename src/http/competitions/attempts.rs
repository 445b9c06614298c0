//! `GET /api/v1/competitions/{id}/attempts`.

use super::super::page::{PageParams, ROWS_MAX};
use super::super::prelude::*;
use crate::competitions::{self};
use crate::store::competitions::Declared;
use swarmbench_protocol::competition::{AttemptList, AttemptSummary};

/// List the attempts of the caller's entrants; organizers and judges see all.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/attempts",
    operation_id = "list_attempts",
    tag = "competitions",
    params(("id" = String, Path, description = "The competition's id"), PageParams),
    security(("key" = [])),
    responses(
        (status = 200, description = "The attempts", body = AttemptList),
        (status = 403, description = "`forbidden`: a token of an episode"),
    )
)]
pub(in super::super) async fn list_attempts(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<PageParams>,
) -> Result<Response, ApiError> {
    let number = caller.needs_key()?.number;
    let competition = app.competition(&caller, &id).await?;
    if caller.reads_all() {
        let question = format!("attempts of {id} {params:?}");
        let make = async {
            let field = app.field(competition, Declared::Short).await?;
            page(&app, &params, app.heavy.render(move || field.summaries(true)).await??).await
        };
        return app.answers.answer(question, Box::pin(make)).await;
    }
    let own = match number {
        Some(_) => {
            competitions::entrants(&app.store, competition.key, number, Declared::Short).await?
        }
        None => Vec::new(),
    };
    page(&app, &params, app.part_of_field(competition, own).await?.summaries(false)?).await
}

/// A page of attempts. They stay in the order in which they were started, so a place in the list is a cursor.
async fn page(
    app: &App,
    params: &PageParams,
    attempts: Vec<AttemptSummary>,
) -> Result<Response, ApiError> {
    let mut page = params.page(app)?;
    let items = (1..).zip(attempts).skip_while(|(place, _)| Some(*place) <= page.place());
    let items: Vec<_> = items.collect();
    if items.len() > ROWS_MAX as usize {
        page.needs_permit().await?;
    }
    page.add(u32::MAX, items, Ok)?;
    Ok(page.answer())
}
