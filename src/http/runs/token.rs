//! `POST /api/v1/runs/{id}/token`.

use axum::http::StatusCode;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::answer::with_tokens;
use super::super::auth::Credential;
use super::super::prelude::*;
use crate::ids::{RunKey, Token};
use crate::run::definition::Definition;
use crate::run::manager::RunTokens;
use crate::store::entries::Entry;
use crate::store::tokens::Grant;
use swarmbench_protocol::run::{RunHolder, RunToken};

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct RunTokenParams {
    /// Name of the holder in the run's team; only for a run with `holders`.
    holder: Option<String>,
}

/// Get a new token for a run, in place of a lost one.
///
/// The earlier token is revoked; in a team, that of the holder. The games continue.
#[utoipa::path(
    post,
    path = "/api/v1/runs/{id}/token",
    operation_id = "replace_run_token",
    tag = "runs",
    params(RunTokenParams),
    responses(
        (status = 200, description = "The new token", body = RunToken),
        (status = 403, description = "`forbidden`: not the creator, or the server itself plays the run, or the seats of the holder"),
        (status = 422, description = "`invalid`: the holder is missing in a team or unknown, or there is no team"),
    )
)]
pub(in super::super) async fn replace_run_token(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Id(id): Id,
    Params(params): Params<RunTokenParams>,
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
    let holder = holder(&known.definition, params.holder.as_deref())?;
    detached(async move {
        let detail = app.detail_of_run(&known.stored).await?;
        let (at, competition) = (app.clock.wall(), known.stored.competition);
        let audit_entry = caller.audit_foreign(owner, at, "run.token", &id, detail, competition);
        let tokens = app.new_run_tokens(run, vec![holder], credential, audit_entry).await?;
        let swarm_token = only_token(tokens)?.reveal().to_owned();
        let body = RunToken { id, holder: params.holder, swarm_token };
        Ok(with_tokens(StatusCode::OK, body))
    })
    .await
}

/// Number of the holder that gets a new token; `None` for a run without a team.
fn holder(definition: &Definition, name: Option<&str>) -> Result<Option<u32>, ApiError> {
    let hosted = |what: &str| {
        let detail = format!("the server itself plays {what}; it has no token");
        Err(ApiError::new(Code::Forbidden, detail))
    };
    let holders = &definition.holders;
    let is_it = |(_, holder): &(u32, &RunHolder)| Some(holder.name.as_str()) == name;
    match (1..).zip(holders).find(is_it) {
        Some((_, holder)) if holder.player.is_some() => hosted("the seats of this holder"),
        Some((number, _)) => Ok(Some(number)),
        None if definition.is_team() => {
            let names: Vec<&str> = holders.iter().map(|holder| holder.name.as_str()).collect();
            Err(ApiError::field("holder", format!("must be one of {}", names.join(", "))))
        }
        None if name.is_some() => {
            Err(ApiError::field("holder", "goes with a team: one player has all seats of this run"))
        }
        None if definition.player.is_some() => hosted("this run"),
        None => Ok(None),
    }
}

/// The token of a run in which one player has all seats, or of one holder.
pub(in super::super) fn only_token(tokens: RunTokens) -> Result<Token, ApiError> {
    let token = tokens.into_iter().next().map(|(_, token)| token);
    token.ok_or_else(|| ApiError::new(Code::Internal, "the run has no token"))
}

impl App {
    /// Replaces tokens of a run, each for a holder; the earlier ones are revoked.
    pub(in super::super) async fn new_run_tokens(
        &self,
        run: RunKey,
        holders: Vec<Option<u32>>,
        credential: Credential,
        audit_entry: Option<Entry>,
    ) -> Result<RunTokens, ApiError> {
        let entries = credential.check().into_iter().chain(audit_entry).collect();
        let tokens = self.runs.replace_tokens(run, holders, entries).await?;
        let is_old = |grant: &Grant| matches!(grant, Grant::Run { run: of, .. } if *of == run);
        self.revoked(is_old).await?;
        Ok(tokens)
    }
}
