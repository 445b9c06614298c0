//! `GET /api/v1/competitions/{id}/entrants`, and one of them.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::extract::optional_flag;
use super::super::page::{PageParams, ROWS_MAX};
use super::super::prelude::*;
use crate::competitions::field::Field;
use crate::competitions::{self, StoredEntrant};
use crate::ids::EntryKey;
use swarmbench_protocol::competition::{EntrantDetail, EntrantList, EntrantSummary};

/// Maximum attempts that are shown with their entrant: less than 4 MB with the longest texts. An entrant has more only if an
/// organizer voids attempts again and again; the list of attempts has all.
const ATTEMPTS_SHOWN_MAX: usize = 1000;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct EntrantParams {
    /// Whether only the entrants of the caller's key are listed.
    #[serde(default, deserialize_with = "optional_flag")]
    own: Option<bool>,
    /// Maximum number of entrants, up to 1,000; as many as fit into one answer by default.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// List the entrants of a competition.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/entrants",
    operation_id = "list_entrants",
    tag = "competitions",
    params(EntrantParams),
    responses((status = 200, description = "The entrants", body = EntrantList))
)]
pub(in super::super) async fn list_entrants(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<EntrantParams>,
) -> Result<Response, ApiError> {
    let own = params.own.unwrap_or(false);
    let owner = if own { caller.needs_key()?.number } else { None };
    let competition = app.competition(&caller, &id).await?;
    let make = async {
        let read = |after: Option<i64>, rows| {
            let after = after.map(EntryKey);
            competitions::list_entrants(&app.store, competition.key, owner, after, rows)
        };
        let show =
            |stored: StoredEntrant| Ok((stored.key.0, EntrantSummary::from(&stored.entrant)));
        let page = PageParams { limit: params.limit, cursor: params.cursor.clone() };
        page.page(&app)?.fill(ROWS_MAX, read, show).await
    };
    if own {
        return make.await;
    }
    app.answers.answer_of_entrants(format!("entrants of {id} {params:?}"), Box::pin(make)).await
}

/// Show an entrant with its own results, to its team, organizers and judges.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/entrants/{entrant}",
    operation_id = "show_entrant",
    tag = "competitions",
    responses(
        (status = 200, description = "The entrant", body = EntrantDetail),
        (status = 403, description = "`forbidden`: not the key of this entrant, an organizer or a judge"),
    )
)]
pub(in super::super) async fn show_entrant(
    State(app): State<App>,
    caller: Caller,
    Id((id, entrant)): Id<(String, String)>,
    _: Params<Nothing>,
) -> Result<Json<EntrantDetail>, ApiError> {
    let key = caller.needs_key()?;
    let competition = app.competition(&caller, &id).await?;
    let stored = app.entrant(&competition, &entrant).await?;
    if !caller.reads_all() && key.number != Some(stored.owner) {
        let detail =
            "the results of an entrant can be read with its own key only; the board is at …/board";
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    let own = std::slice::from_ref(&stored);
    let field = Field::of_entrants(&app.store, &competition, own).await?;
    let mut attempts = field.summaries(caller.reads_all())?;
    attempts.drain(..attempts.len().saturating_sub(ATTEMPTS_SHOWN_MAX));
    let contact =
        stored.contact.filter(|_| caller.is_organizer() || key.number == Some(stored.owner));
    Ok(Json(EntrantDetail { entrant: (&stored.entrant).into(), contact, attempts }))
}
