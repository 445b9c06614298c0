//! `POST /api/v1/episodes`.

use axum::Extension;
use axum::http::HeaderMap;

use super::super::client::Client;
use super::super::idempotency::{Idempotency, created_before, idempotency};
use super::super::prelude::*;
use super::super::seeds::SeedPermit;
use super::created::{Shown, Tokens, created};
use super::describe::described;
use crate::episode::quota::Purpose;
use crate::episode::registry::Creation;
use crate::episode::spec::Spec;
use crate::fair::Party;
use crate::ids::EpisodeId;
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeRequest};

/// Create an episode.
///
/// The tokens are shown only once. A repeat with the same `Idempotency-Key` and body returns the same episode with new tokens
/// and revokes the earlier ones.
#[utoipa::path(
    post,
    path = "/api/v1/episodes",
    operation_id = "create_episode",
    tag = "episodes",
    params(("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this creation")),
    request_body(content = EpisodeRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The episode, with its tokens", body = CreatedEpisode),
        (status = 403, description = "`forbidden`: the token of an episode cannot create one; a server without keys is open only to programs on its own machine; the key's share of the journal is used up"),
    )
)]
pub(in super::super) async fn create_episode(
    State(app): State<App>,
    caller: Caller,
    Extension(client): Extension<Client>,
    _: Params<Nothing>,
    headers: HeaderMap,
    request: Unread,
) -> Result<Response, ApiError> {
    let creator = caller.creator(&app, client)?;
    let (request, body) = request.read::<EpisodeRequest>(&app).await?;
    let idempotency = idempotency(&headers, creator.0.owner(), &body, &app.limits)?;
    let spec = described(request, &app)?;
    let permit = SeedPermit::of_creator(&caller, &spec);
    // A repeat must find what the first one creates, also if its client hangs up.
    detached(async move {
        let _lock = app.creations.lock_key(idempotency.as_ref()).await;
        let find = |key| app.store.created_with(key);
        match created_before(idempotency.as_ref(), find).await? {
            None => new_episode(&app, creator, spec, permit, idempotency).await,
            Some(id) => new_tokens(&app, id, permit).await,
        }
    })
    .await
}

async fn new_tokens(app: &App, id: EpisodeId, permit: SeedPermit) -> Result<Response, ApiError> {
    let shown = Shown::find(app, &id).await?;
    let tokens = Tokens::replaced(app, std::slice::from_ref(&shown)).await?;
    Ok(created(&shown, &tokens[0], permit))
}

async fn new_episode(
    app: &App,
    (party, purpose): (Party, Purpose),
    spec: Spec,
    permit: SeedPermit,
    idempotency: Option<Idempotency>,
) -> Result<Response, ApiError> {
    // A repeated creation gets that episode, also if it was created under wider limits.
    spec.config.check_new().map_err(|errors| ApiError::settings(errors, ""))?;
    app.check_disk()?;
    let id = EpisodeId::new(app.clock.wall(), &*app.entropy);
    let tokens = Tokens::new(app, &spec);
    let rows = tokens.rows();
    let creation = Creation {
        id,
        party,
        purpose,
        run: None,
        spec,
        holder_metas: Vec::new(),
        tokens: rows,
        idempotency,
    };
    // Before they can be replaced.
    let revocations = app.tokens.revocations();
    let handle = app.registry.create(creation).await?;
    tokens.cache(app, &handle, party.owner(), revocations);
    Ok(created(&Shown::of(&handle), &tokens, permit))
}
