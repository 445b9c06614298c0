//! `POST /api/v1/runs/{id}/token`.

use axum::http::StatusCode;

use super::super::answer::with_tokens;
use super::super::prelude::*;
use crate::ids::{RunKey, Token};
use crate::keys::Key;
use crate::store::entries::Entry;
use crate::store::tokens::Grant;
use swarmbench_protocol::run::RunToken;

/// Get a new token for a run, in place of a lost one.
///
/// The earlier token is revoked. The games continue.
#[utoipa::path(
    post,
    path = "/api/v1/runs/{id}/token",
    operation_id = "replace_run_token",
    tag = "runs",
    responses(
        (status = 200, description = "The new token", body = RunToken),
        (status = 403, description = "`forbidden`: not the creator, or the server itself plays the run"),
    )
)]
pub(in super::super) async fn replace_run_token(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Response, ApiError> {
    caller.check_not_judge()?;
    let known = app.known_run(&caller, &id).await?;
    let (run, owner) = (known.stored.run, known.stored.owner);
    // The player of an attempt in a competition may play it, but not read it.
    if !caller.owns(known.subject()) && !caller.created(owner) {
        let detail =
            "only the creator of a run may do this: send the key with which it was created";
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    if known.definition.player.is_some() {
        let detail = "the server itself plays this run; it has no token";
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    detached(async move {
        let detail = app.detail_of_run(&known.stored).await?;
        let (at, competition) = (app.clock.wall(), known.stored.competition);
        let audit_entry = caller.audit_foreign(owner, at, "run.token", &id, detail, competition);
        let token = app.new_run_token(run, audit_entry.into_iter().collect()).await?;
        app.check_not_revoked(&caller).await?;
        let body = RunToken { id, swarm_token: token.reveal().to_owned() };
        Ok(with_tokens(StatusCode::OK, body))
    })
    .await
}

impl App {
    /// Replaces the token of a run; the earlier one is revoked.
    pub(in super::super) async fn new_run_token(
        &self,
        run: RunKey,
        audit_entries: Vec<Entry>,
    ) -> Result<Token, ApiError> {
        let token = self.runs.replace_token(run, audit_entries).await?;
        let is_old = |grant: &Grant| matches!(grant, Grant::Run { run: of, .. } if *of == run);
        self.revoked(is_old).await?;
        Ok(token)
    }

    /// Refuses a caller whose key was revoked while a token of a run was made for it, and revokes that token.
    pub(in super::super) async fn check_not_revoked(
        &self,
        caller: &Caller,
    ) -> Result<(), ApiError> {
        let Caller::Key(Key { id, .. }) = caller else { return Ok(()) };
        let Some(at) = self.store.revoked_at(id).await? else { return Ok(()) };
        self.store.keep(vec![Entry::RevokeKey { id: id.clone(), at }]).await?;
        self.key_revoked(id).await?;
        Err(ApiError::new(Code::Unauthorized, "the key was revoked meanwhile"))
    }
}
