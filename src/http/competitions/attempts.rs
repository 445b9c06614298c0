//! `GET /api/v1/competitions/{id}/attempts`.

use super::super::page::{PageParams, ROWS_MAX};
use super::super::prelude::*;
use crate::competitions::field::Field;
use crate::competitions::{self, StoredCompetition};
use crate::ids::RunKey;
use crate::keys::OwnerKey;
use swarmbench_protocol::competition::AttemptList;

/// List the attempts of the caller's entrants; organizers and judges see all.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/attempts",
    operation_id = "list_attempts",
    tag = "competitions",
    params(PageParams),
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
    let owner = caller.needs_key()?.number;
    let competition = app.competition(&caller, &id).await?;
    if caller.reads_all() {
        let question = format!("attempts of {id} {params:?}");
        let make = page(&app, &params, &competition, None);
        return app.answers.answer(question, Box::pin(make)).await;
    }
    match owner {
        Some(_) => page(&app, &params, &competition, owner).await,
        None => Ok(params.page(&app)?.answer()),
    }
}

/// Page of the attempts of a competition, or of one key, in the order of their starts.
async fn page(
    app: &App,
    params: &PageParams,
    competition: &StoredCompetition,
    owner: Option<OwnerKey>,
) -> Result<Response, ApiError> {
    let read = |after: Option<i64>, limit| async move {
        let found =
            app.store.list_attempts(competition.key, owner, after.map(RunKey), limit).await?;
        let mut entries: Vec<_> = found.iter().map(|attempt| attempt.entry).collect();
        entries.sort_unstable();
        entries.dedup();
        let entrants = competitions::entrants_among(&app.store, competition.key, &entries).await?;
        let field = Field::read(&app.store, competition, &entrants, found).await?;
        let runs = field.attempts.iter().map(|(attempt, _)| attempt.run.0);
        Ok(runs.zip(field.summaries(owner.is_none())?).collect::<Vec<_>>())
    };
    params.page(app)?.fill(ROWS_MAX, read, Ok).await
}
