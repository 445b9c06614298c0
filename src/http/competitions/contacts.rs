//! `GET /api/v1/competitions/{id}/contacts`.

use serde::Deserialize;
use serde_json::json;
use utoipa::IntoParams;

use super::super::boards::Format;
use super::super::page::{page_limit, read_cursor, write_cursor};
use super::super::prelude::*;
use crate::ids::EntryKey;
use crate::store::competitions::StoredContact;
use swarmbench_protocol::competition::{ContactList, EntrantContact};

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ContactParams {
    /// Format: `json` or `csv`.
    #[param(example = "csv")]
    format: Option<String>,
    /// Maximum number of entrants, up to 1,000, which is also the default.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// List the contacts of all entrants of a competition, as JSON or CSV.
///
/// The list includes entrants without a contact. The audit log records every answer. All pages except the last name the next
/// one in `next_cursor` and in the header `X-Next-Cursor`.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/contacts",
    operation_id = "list_contacts",
    tag = "competitions",
    params(ContactParams),
    responses(
        (status = 200, description = "The contacts", content(
            (ContactList = "application/json"),
            (String = "text/csv"),
        )),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn list_contacts(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    Params(params): Params<ContactParams>,
) -> Result<Response, ApiError> {
    let format = Format::named(params.format.as_deref())?.unwrap_or(Format::Json);
    let limit = page_limit(&app, params.limit, app.limits.page_items_max)?;
    let after = read_cursor(params.cursor.as_deref())?.map(EntryKey);
    let competition = app.stored_competition(&id).await?;
    let _permit = app.heavy.large_answer().await?;
    // One contact more than the page has shows whether there is a next page.
    let found = app.store.list_contacts(competition.key, after, limit + 1).await?;
    let bytes_max = app.limits.answer_bytes_max;
    let write = move || {
        let page = |limit| page(&found, limit);
        format.page(bytes_max, limit as usize, page)
    };
    let answer = app.heavy.render(write).await?;
    let audit_entry = organizer.audit_entry(&app, "entrants.contacts", &id, json!({}));
    app.store.keep(vec![audit_entry]).await?;
    Ok(answer)
}

/// Page of the first `limit` contacts.
fn page(found: &[StoredContact], limit: usize) -> ContactList {
    let shown = &found[..limit.min(found.len())];
    let last = shown.last().filter(|_| shown.len() < found.len());
    let item = |of: &StoredContact| EntrantContact {
        entrant: of.id.clone(),
        name: of.name.clone(),
        category: of.category.clone(),
        status: of.status.clone(),
        contact: of.contact.clone(),
    };
    ContactList {
        items: shown.iter().map(item).collect(),
        next_cursor: last.map(|last| write_cursor(last.key.0)),
    }
}
