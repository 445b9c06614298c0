//! `PATCH /api/v1/competitions/{id}`.

use axum::Json as JsonBody;
use jiff::Timestamp;
use serde_json::json;

use super::super::prelude::*;
use super::{check_open, shown};
use crate::store::entries::Entry;
use swarmbench_boards::competition::change::{Change, Changed};
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::export::CHANGE;
use swarmbench_boards::competition::shown::revision;
use swarmbench_protocol::competition::{Competition, CompetitionChange};

/// Change a competition: extend it or the windows of its attempts, correct its texts, renew its terms, or hide it.
///
/// Once the competition has closed, only `hidden` can change. Windows are never shortened. Open games keep their end; games
/// that are opened afterwards have the new one, also those of running attempts. Everybody sees the changes (`GET …/actions`).
/// With `if_revision` nothing is changed if somebody else has changed the competition meanwhile.
#[utoipa::path(
    patch,
    path = "/api/v1/competitions/{id}",
    operation_id = "change_competition",
    tag = "competitions",
    request_body(content = CompetitionChange, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The competition after the change", body = Competition),
        (status = 403, description = "`forbidden`: not an organizer's key"),
        (status = 409, description = "`closed`: the competition has closed or was cancelled, and the request changes more than `hidden`; `changed`: its revision is not `if_revision`"),
    )
)]
pub(in super::super) async fn change_competition(
    State(app): State<App>,
    organizer: Organizer,
    Id(id): Id,
    _: Params<Nothing>,
    Json(request, _): Json<CompetitionChange>,
) -> Result<JsonBody<Competition>, ApiError> {
    let CompetitionChange {
        name,
        description,
        closes_at,
        attempts,
        hidden,
        terms,
        if_revision,
        reason,
    } = request;
    if let Some(reason) = &reason {
        let mut problems = Problems::default();
        problems.text("reason", reason, app.limits.reason_chars_max);
        problems.none_or(Some(()))?;
    }
    // Times are stored to the millisecond.
    let whole = |at: Timestamp| Timestamp::from_millisecond(at.as_millisecond()).unwrap_or(at);
    let windows = attempts.unwrap_or_default().into_iter();
    let change = Change {
        name,
        description,
        closes_at: closes_at.map(|at| whole(at.into())),
        windows: windows.map(|of| (of.attempt, whole(of.closes_at.into()))).collect(),
        terms,
    };
    detached(async move {
        // The lock keeps attempts from starting, and the competition from being revealed, while windows change.
        let _closed = app.runs.block_entries().await;
        let competition = app.stored_competition(&id).await?;
        let now = app.clock.wall();
        // Hiding concerns only lists, so it is allowed after the end.
        if hidden.is_none() || change != Change::default() {
            check_open(&competition, now)?;
        }
        let revision = revision(&competition.definition, competition.hidden);
        if if_revision.is_some_and(|seen| seen != revision) {
            let detail = format!(
                "the competition was changed since you looked at it (if_revision), and has revision {revision}: look at it \
                 again, and send what is still to be changed"
            );
            return Err(ApiError::new(Code::Changed, detail));
        }
        let old = &competition.definition;
        let new = changed_definition(old, &change, now)?;
        let mut changed = old.differences(&new);
        if let Some(to) = hidden.filter(|to| *to != competition.hidden) {
            let from = json!(competition.hidden);
            changed.push(Changed { field: "hidden".to_owned(), from, to: json!(to) });
        }
        if !changed.is_empty() {
            let detail = json!({ "changes": changed, "reason": reason });
            let shown = (competition.key, detail.clone());
            let mut entries = vec![
                Entry::ChangeCompetition {
                    competition: competition.key,
                    definition: serde_json::to_string(&new).expect("string keys"),
                    closes_at: new.closes_at,
                    hidden: hidden.unwrap_or(competition.hidden),
                },
                organizer.audit_entry_shown(&app, CHANGE, &id, detail, shown),
            ];
            let last = new.number_of_spare(new.spares);
            for number in 1..=last {
                let (from, to) = (old.window(number), new.window(number));
                if let Some(to) = to.filter(|to| Some(*to) != from) {
                    let closes_at = to.closes_at;
                    entries.push(Entry::ExtendAttempts {
                        competition: competition.key,
                        number,
                        closes_at,
                    });
                }
            }
            app.store.keep(entries).await?;
        }
        let competition = app.stored_competition(&id).await?;
        Ok(JsonBody(shown(&competition, app.clock.wall())))
    })
    .await
}

fn changed_definition(
    old: &Definition,
    change: &Change,
    now: Timestamp,
) -> Result<Definition, ApiError> {
    if *change == Change::default() {
        return Ok(old.clone());
    }
    old.changed(change, now).or_else(|found| {
        let mut problems = Problems::default();
        for (field, problem) in found {
            problems.refuse(&field, problem);
        }
        problems.none_or(None::<Definition>)
    })
}
