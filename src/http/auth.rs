//! Who asks, and what they may.

use axum::extract::FromRequestParts;
use axum::http::header;
use axum::http::request::Parts;
use swarmbench_engine::AgentId;

use super::App;
use super::error::{ApiError, Code};
use crate::episode::actor::Handle;
use crate::episode::spec::Visibility;
use crate::ids::{EpisodeId, Token};

/// Whoever sent a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Caller {
    /// Nobody known. As long as the server has no keys, anyone may create episodes.
    Anonymous,
    /// One agent of one episode.
    Seat(EpisodeId, AgentId),
    /// All seats of an episode: whoever created it.
    Swarm(EpisodeId),
}

impl FromRequestParts<App> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        let Some(value) = parts.headers.get(header::AUTHORIZATION) else {
            return Ok(Self::Anonymous);
        };
        let unknown = || {
            let detail = "the token is unknown, or was replaced by a newer one";
            ApiError::new(Code::Unauthorized, detail)
        };
        let (scheme, token) =
            value.to_str().ok().and_then(|value| value.split_once(' ')).ok_or_else(unknown)?;
        if !scheme.eq_ignore_ascii_case("bearer") {
            let detail = "send the token as `Authorization: Bearer TOKEN`";
            return Err(ApiError::new(Code::Unauthorized, detail));
        }
        let hash = Token::parse(token.trim()).ok_or_else(unknown)?.hash();
        let grant = app.grant(hash).await?.ok_or_else(unknown)?;
        Ok(match grant.agent {
            Some(agent) => Self::Seat(grant.episode, agent),
            None => Self::Swarm(grant.episode),
        })
    }
}

impl Caller {
    /// Whether the caller stands where the creator of the episode does.
    pub(super) fn owns(&self, id: &EpisodeId, visibility: Visibility) -> bool {
        match self {
            Self::Swarm(own) => own == id,
            Self::Anonymous => visibility == Visibility::Public,
            Self::Seat(..) => false,
        }
    }

    /// Whether the caller may read state, events and resolved rounds now.
    pub(super) fn may_read(&self, id: &EpisodeId, visibility: Visibility, is_over: bool) -> bool {
        is_over
            || match visibility {
                Visibility::Public => true,
                Visibility::Owner => self.owns(id, visibility),
            }
    }

    /// Whether the caller may know that the episode exists.
    pub(super) fn may_know(&self, id: &EpisodeId, visibility: Visibility, is_over: bool) -> bool {
        self.may_read(id, visibility, is_over) || matches!(self, Self::Seat(own, _) if own == id)
    }
}

/// The seat of a request that only an agent can make.
pub(super) struct Seat {
    pub(super) handle: Handle,
    pub(super) agent: AgentId,
}

impl FromRequestParts<App> for Seat {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        match Caller::from_request_parts(parts, app).await? {
            Caller::Anonymous => Err(needs_token("a seat token")),
            Caller::Swarm(_) => Err(ApiError::new(
                Code::Forbidden,
                "this is a swarm token; use /swarm/obs and /swarm/act, or a seat token here",
            )),
            Caller::Seat(episode, agent) => {
                Ok(Self { handle: app.episode(&episode).await?, agent })
            }
        }
    }
}

/// The seats of a request for several.
pub(super) struct Swarm {
    pub(super) handle: Handle,
}

impl FromRequestParts<App> for Swarm {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        match Caller::from_request_parts(parts, app).await? {
            Caller::Anonymous => Err(needs_token("a swarm token")),
            Caller::Seat(..) => Err(ApiError::new(
                Code::Forbidden,
                "this is a seat token; use /obs and /act, or a swarm token here",
            )),
            Caller::Swarm(episode) => Ok(Self { handle: app.episode(&episode).await? }),
        }
    }
}

fn needs_token(which: &str) -> ApiError {
    let detail = format!("send {which} as `Authorization: Bearer TOKEN`");
    ApiError::new(Code::Unauthorized, detail)
}
