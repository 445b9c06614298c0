//! `POST /api/v1/competitions/{id}/attempts/{run}/void`.

use serde_json::json;

use super::super::checks::checked_reason;
use super::super::prelude::*;
use crate::competitions;
use crate::competitions::field::Field;
use crate::run::RunStatus;
use crate::store::entries::Entry;
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::export::VOID;
use swarmbench_protocol::competition::{SeenSeeds, VoidedAttempt};
use swarmbench_protocol::episode::VoidRequest;

/// Void an attempt after a fault of the server: it ends, does not count, and may be started again.
///
/// The attempt is played again on spare seeds. If the competition has none, or the entrant has used all, it is played on the
/// same seeds, and `seen` tells how much of them the entrant has seen.
///
/// A repeat changes nothing, and the first reason stays.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/attempts/{run}/void",
    operation_id = "void_attempt",
    tag = "competitions",
    request_body(content = VoidRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The attempt, which no longer counts", body = VoidedAttempt),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn void_attempt(
    State(app): State<App>,
    organizer: Organizer,
    Id((id, run)): Id<(String, String)>,
    _: Params<Nothing>,
    Json(VoidRequest { reason }, _): Json<VoidRequest>,
) -> Result<axum::Json<VoidedAttempt>, ApiError> {
    let reason = checked_reason(&app, reason)?;
    detached(async move {
        let competition = app.stored_competition(&id).await?;
        let _lock = app.creations.lock(&format!("void {run}")).await;
        let attempt = app.store.find_attempt(competition.key, &run).await?;
        let attempt = attempt.ok_or_else(|| ApiError::not_found("the attempt"))?;
        let entrants =
            competitions::entrants_among(&app.store, competition.key, &[attempt.entry]).await?;
        if attempt.void_reason.is_none() {
            let number = attempt.replays.unwrap_or(attempt.number);
            let detail = json!({ "competition": id, "attempt": number, "reason": reason });
            let entrant = entrants.first().map(|entrant| &entrant.entrant.id);
            let shown = json!({ "entrant": entrant, "attempt": number, "reason": reason });
            let shown = (competition.key, shown);
            let at = app.clock.wall();
            let audit_entries = vec![
                Entry::VoidRun { run: attempt.run, reason, at },
                organizer.audit_entry_shown(&app, VOID, &run, detail, shown),
            ];
            if !app.runs.end_with(attempt.run, RunStatus::Aborted, audit_entries.clone()).await? {
                app.store.keep(audit_entries).await?;
            }
        } else if attempt.ended_at.is_none() || attempt.unfinished > 0 {
            // The server that plays the attempt did not answer the first request.
            app.runs.end(attempt.run, RunStatus::Aborted).await?;
        }
        let field = Field::of_entrants(&app.store, &competition, &entrants).await?;
        let summary = field.summaries(true)?;
        let summary = summary.into_iter().find(|summary| summary.run == run);
        let attempt = summary.ok_or_else(|| ApiError::not_found("the attempt"))?;
        let seen = seen(&competition.definition, &field, &run);
        Ok(axum::Json(VoidedAttempt { attempt, seen }))
    })
    .await
}

/// Seeds of a voided attempt as far as its entrant has seen them; `None` if it will play again on spare seeds.
fn seen(definition: &Definition, field: &Field<'_>, run: &str) -> Option<SeenSeeds> {
    let (_, games) = field.attempts.iter().find(|(attempt, _)| attempt.id == run)?;
    let used = field.attempts.iter().filter(|(attempt, _)| attempt.replays.is_some()).count();
    if used < definition.spares as usize {
        return None;
    }
    let games_opened = games.len();
    let rounds: u64 = games.iter().map(|game| u64::from(game.rounds)).sum();
    let why = if definition.spares == 0 {
        "the competition has no spare seeds"
    } else {
        "the entrant has used all spare seeds"
    };
    let all = definition.games();
    let warning = format!(
        "{why}: if it plays the attempt again, it does so on the same seeds, and it has seen {games_opened} of {all} games, \
         {rounds} rounds in all"
    );
    Some(SeenSeeds { games_opened, rounds, warning })
}
