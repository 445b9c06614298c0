//! New episodes as their creator gets them, with tokens.

use std::collections::HashSet;
use std::sync::Arc;

use swarmbench_engine::AgentId;

use super::super::answer;
use super::super::prelude::*;
use super::super::seeds::SeedPermit;
use super::{broken, config, spec};
use crate::episode::actor::Handle;
use crate::episode::spec::Spec;
use crate::ids::{EpisodeId, EpisodeKey, Token, TokenKind};
use crate::keys::OwnerKey;
use crate::store::entries::TokenRow;
use crate::store::tokens::{Grant, Seats};
use swarmbench_protocol::episode::{CreatedEpisode, SeatToken};
use swarmbench_protocol::status::Status;

/// An episode of which its creator gets tokens.
pub(super) struct Shown {
    pub(super) id: EpisodeId,
    episode: EpisodeKey,
    spec: Arc<Spec>,
    status: Status,
}

impl Shown {
    pub(super) fn of(handle: &Handle) -> Self {
        Self {
            id: handle.id.clone(),
            episode: handle.key,
            spec: Arc::clone(&handle.spec),
            status: handle.snapshot().status,
        }
    }

    /// Existing episode, which is not recovered for this: another server may play it.
    pub(super) async fn find(app: &App, id: &EpisodeId) -> Result<Self, ApiError> {
        if let Some(handle) = app.registry.find_in_memory(id) {
            return Ok(Self::of(&handle));
        }
        let stored = app.store.find_summary(id).await?;
        let stored = stored.ok_or_else(|| ApiError::not_found("the episode"))?;
        let status = Status::parse(&stored.status).ok_or_else(|| broken("an unknown status"))?;
        let spec = Arc::new(spec(&stored)?);
        Ok(Self { id: stored.id, episode: stored.episode, spec, status })
    }
}

/// The tokens of the creator's seats in clear.
pub(super) struct Tokens {
    seats: Vec<(AgentId, Token)>,
    swarm: Token,
}

impl Tokens {
    pub(super) fn new(app: &App, spec: &Spec) -> Self {
        Self {
            seats: (spec.agents().filter(|agent| spec.is_creators(*agent)))
                .map(|agent| (agent, app.token(TokenKind::Seat)))
                .collect(),
            swarm: app.token(TokenKind::Swarm),
        }
    }

    /// New tokens of the creator in place of all that these episodes had.
    pub(super) async fn replaced(app: &App, episodes: &[Shown]) -> Result<Vec<Self>, ApiError> {
        let all: Vec<Self> = episodes.iter().map(|shown| Self::new(app, &shown.spec)).collect();
        let mut replaced = Ok(());
        for (shown, tokens) in episodes.iter().zip(&all) {
            if replaced.is_ok() {
                replaced = app.store.replace_tokens(shown.episode, None, tokens.rows()).await;
            }
        }
        // Some of them may be gone also where it broke off.
        let ids: HashSet<&EpisodeId> = episodes.iter().map(|shown| &shown.id).collect();
        app.revoked(
            |grant| matches!(grant, Grant::Seat { episode, .. } | Grant::Swarm { episode, .. } if ids.contains(episode)),
        )
        .await?;
        replaced?;
        Ok(all)
    }

    /// Caches their rights, so that the first requests of all seats, which come at the same time, do not read the database.
    pub(super) fn cache(
        &self,
        app: &App,
        handle: &Handle,
        owner: Option<OwnerKey>,
        revocations: u64,
    ) {
        let episode = || handle.id.clone();
        for (agent, token) in &self.seats {
            let grant = Grant::Seat { episode: episode(), owner, agent: *agent };
            app.tokens.cache(token.hash(), grant, revocations);
        }
        let grant = Grant::Swarm { episode: episode(), owner, seats: Seats::Creators };
        app.tokens.cache(self.swarm.hash(), grant, revocations);
    }

    pub(super) fn rows(&self) -> Vec<TokenRow> {
        let seats = self.seats.iter();
        seats
            .map(|(agent, token)| TokenRow {
                hash: token.hash(),
                agent: Some(*agent),
                holder: None,
            })
            .chain([TokenRow { hash: self.swarm.hash(), agent: None, holder: None }])
            .collect()
    }
}

/// The answer to the creation of an episode.
pub(super) fn created(shown: &Shown, tokens: &Tokens, permit: SeedPermit) -> Response {
    let body = created_episode(shown, tokens, permit);
    answer::created(&format!("/api/v1/episodes/{}", shown.id), body)
}

/// A new episode as it is shown to its creator.
pub(super) fn created_episode(
    shown: &Shown,
    tokens: &Tokens,
    permit: SeedPermit,
) -> CreatedEpisode {
    let seat = |(agent, token): &(AgentId, Token)| SeatToken {
        agent: agent.to_string(),
        token: token.reveal().to_owned(),
    };
    CreatedEpisode {
        id: shown.id.to_string(),
        status: shown.status,
        config: config(&shown.spec, permit),
        seats: tokens.seats.iter().map(seat).collect(),
        swarm_token: tokens.swarm.reveal().to_owned(),
    }
}
