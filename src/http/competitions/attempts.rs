//! `GET /api/v1/competitions/{id}/attempts`.

use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};

use super::super::App;
use super::super::auth::Caller;
use super::super::error::ApiError;
use super::super::extract::{Id, Nothing, Params};
use super::super::refusals::{IdRefusals, QueryRefusals, TokenRefusals};
use crate::store::competitions::Declared;
use crate::wire::competition::AttemptList;
use crate::wire::problem::Problem;

/// List the attempts of the caller's entrants; an organizer sees all.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/attempts",
    operation_id = "list_attempts",
    tag = "competitions",
    params(("id" = String, Path, description = "The competition's id")),
    security(("key" = [])),
    responses(
        (status = 200, description = "The attempts", body = AttemptList),
        IdRefusals,
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: a token of an episode", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn list_attempts(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Response, ApiError> {
    let number = caller.needs_key()?.number;
    let competition = app.competition(&caller, &id).await?;
    let listed = |items| Json(AttemptList { items, next_cursor: None }).into_response();
    if caller.is_organizer() {
        let make = async {
            let field = app.field(competition, Declared::Short).await?;
            Ok(listed(app.render(move || field.summaries()).await??))
        };
        return app.made_once(format!("attempts of {id}"), Box::pin(make)).await;
    }
    let own = match number {
        Some(_) => app.store.entrants(competition.key, number, Declared::Short).await?,
        None => Vec::new(),
    };
    let field = app.part_of_field(competition, own).await?;
    Ok(listed(field.summaries()?))
}
