//! New episodes as their creator gets them, with tokens.

use std::collections::HashSet;

use swarmbench_engine::AgentId;

use super::super::answer;
use super::super::prelude::*;
use super::config;
use crate::episode::actor::Handle;
use crate::episode::spec::Spec;
use crate::ids::{EpisodeId, Token, TokenKind};
use crate::keys::OwnerKey;
use crate::store::entries::{Entry, TokenRow};
use crate::store::tokens::{Grant, Seats};
use swarmbench_protocol::episode::{CreatedEpisode, SeatToken};

/// The tokens of the creator's seats in clear.
pub(super) struct Tokens {
    seats: Vec<(AgentId, Token)>,
    swarm: Token,
}

impl Tokens {
    pub(super) fn new(app: &App, spec: &Spec) -> Self {
        let token = |kind| Token::new(kind, &*app.entropy);
        Self {
            seats: (spec.agents().filter(|agent| spec.is_creators(*agent)))
                .map(|agent| (agent, token(TokenKind::Seat)))
                .collect(),
            swarm: token(TokenKind::Swarm),
        }
    }

    /// New tokens of the creator in place of all that these episodes had.
    pub(super) async fn replaced(app: &App, handles: &[Handle]) -> Result<Vec<Self>, ApiError> {
        let all: Vec<Self> = handles.iter().map(|handle| Self::new(app, &handle.spec)).collect();
        let replace = |(handle, tokens): (&Handle, &Self)| Entry::ReplaceTokens {
            episode: handle.key,
            holder: None,
            tokens: tokens.rows(),
        };
        app.store.keep(handles.iter().zip(&all).map(replace).collect()).await?;
        let ids: HashSet<&EpisodeId> = handles.iter().map(|handle| &handle.id).collect();
        app.revoked(
            |grant| matches!(grant, Grant::Seat { episode, .. } | Grant::Swarm { episode, .. } if ids.contains(episode)),
        )
        .await?;
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
pub(super) fn created(handle: &Handle, tokens: &Tokens, shows_seed: bool) -> Response {
    let body = created_episode(handle, tokens, shows_seed);
    answer::created(&format!("/api/v1/episodes/{}", handle.id), body)
}

/// A new episode as it is shown to its creator.
pub(super) fn created_episode(
    handle: &Handle,
    tokens: &Tokens,
    shows_seed: bool,
) -> CreatedEpisode {
    let seat = |(agent, token): &(AgentId, Token)| SeatToken {
        agent: agent.to_string(),
        token: token.reveal().to_owned(),
    };
    CreatedEpisode {
        id: handle.id.to_string(),
        status: handle.snapshot().status,
        config: config(&handle.spec, shows_seed),
        seats: tokens.seats.iter().map(seat).collect(),
        swarm_token: tokens.swarm.reveal().to_owned(),
    }
}
