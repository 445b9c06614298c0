//! `POST /api/v1/runs/{id}/token`.

use axum::http::StatusCode;

use super::super::answer::with_tokens;
use super::super::auth::Credential;
use super::super::prelude::*;
use crate::ids::{RunKey, Token};
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
    credential: Credential,
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
        let token = app.new_run_token(run, credential, audit_entry).await?;
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
        credential: Credential,
        audit_entry: Option<Entry>,
    ) -> Result<Token, ApiError> {
        let entries = credential.check().into_iter().chain(audit_entry).collect();
        let token = self.runs.replace_token(run, entries).await?;
        let is_old = |grant: &Grant| matches!(grant, Grant::Run { run: of, .. } if *of == run);
        self.revoked(is_old).await?;
        Ok(token)
    }
}
