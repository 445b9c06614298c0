//! Authentication and permissions.
//!
//! Permissions of a caller follow from its token or key, and are decided here only: handlers ask `Caller`.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use jiff::Timestamp;
use swarmbench_engine::AgentId;

use super::app::{Access, App};
use super::client::Client;
use super::error::{ApiError, Code};
use super::serve::token_of;
use crate::episode::actor::Handle;
use crate::episode::quota::Purpose;
use crate::episode::spec::Visibility;
use crate::fair::{Party, Rank};
use crate::ids::{CompetitionKey, EpisodeId, RunKey, TokenHash};
use crate::keys::{Key, OwnerKey, Role};
use crate::store::entries::{AuditRow, Entry};
use crate::store::episodes::Readable;
use crate::store::tokens::{Grant, Seats};

/// The sender of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Caller {
    /// No token was sent.
    Anonymous {
        /// A server without keys lets a caller on its own machine create episodes.
        may_create: bool,
    },
    Seat(EpisodeId, AgentId),
    Swarm(EpisodeId, Seats),
    /// Seats of all episodes of a run.
    Run(RunKey, Seats),
    Key(Key),
}

/// Facts of an episode or a run that decide its permissions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subject<'a> {
    /// None for a run.
    pub(super) id: Option<&'a EpisodeId>,
    pub(super) owner: Option<OwnerKey>,
    pub(super) run: Option<RunKey>,
    pub(super) visibility: Visibility,
    /// True if the seats belong to several holders.
    pub(super) is_mixed: bool,
    /// True if others may claim seats, or could before.
    pub(super) is_claimable: bool,
    pub(super) is_over: bool,
    /// Readers of a sealed episode once it has ended.
    pub(super) opened: Opened,
}

/// Readers of a sealed episode that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Opened {
    /// Overseers only.
    Nobody,
    /// Overseers and the owner.
    Owner,
    /// Everybody.
    All,
}

impl Opened {
    /// Readers at this time: everybody once it was revealed; and its owner once the window of its attempt has closed at
    /// `own_from`, and a round that others opened just before on the same seeds, of at most `round_max`, has ended.
    pub(super) fn at(
        now: Timestamp,
        is_revealed: bool,
        own_from: Option<Timestamp>,
        round_max: Duration,
    ) -> Self {
        let have_ended = |from: Timestamp| from.checked_add(round_max).is_ok_and(|at| at <= now);
        match own_from {
            _ if is_revealed => Self::All,
            Some(from) if have_ended(from) => Self::Owner,
            _ => Self::Nobody,
        }
    }
}

impl FromRequestParts<App> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        let Some(value) = parts.headers.get(header::AUTHORIZATION) else {
            let is_local = parts.extensions.get::<Client>().is_some_and(|client| client.is_local);
            let may_create = !app.has_keys && (app.access.open || is_local);
            return Ok(Self::Anonymous { may_create });
        };
        let token = bearer(value.to_str().map_err(|_| unknown_token())?)
            .map_err(|problem| ApiError::new(Code::Unauthorized, problem))?;
        let grant = app.tokens.grant(token).await?.ok_or_else(unknown_token)?;
        let party = app.tokens.party(&grant).await?;
        party.into_iter().for_each(Party::refine);
        let (owner, caller) = match grant {
            Grant::Seat { episode, owner, agent } => (owner, Self::Seat(episode, agent)),
            Grant::Swarm { episode, owner, seats } => (owner, Self::Swarm(episode, seats)),
            Grant::Run { run, seats, owner, .. } => (owner, Self::Run(run, seats)),
            Grant::Key(key) if key.is_good(app.clock.wall()) => (key.number, Self::Key(key)),
            Grant::Key(_) => return Err(unknown_token()),
        };
        check_rate(app, owner)?;
        party.into_iter().for_each(token_of);
        Ok(caller)
    }
}

/// Token in the headers of a request; `None` where there is none, or a header that the handler refuses.
pub(super) fn sent_token(headers: &HeaderMap) -> Option<&str> {
    let value = headers.get(header::AUTHORIZATION)?.to_str().ok()?;
    bearer(value).ok()
}

/// Hash of the token with which a request came. It had rights when the request came; the commit of what the request asks for
/// checks them again.
#[derive(Clone, Copy)]
pub(super) struct Credential(pub(super) Option<TokenHash>);

impl Credential {
    /// The first entry of a job for the request.
    pub(super) fn check(self) -> Option<Entry> {
        self.0.map(Entry::CheckToken)
    }
}

impl FromRequestParts<App> for Credential {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &App) -> Result<Self, Infallible> {
        Ok(Self(sent_token(&parts.headers).map(TokenHash::of)))
    }
}

/// Presence of a token with rights, which the handler on another server decides. A token without rights is refused.
pub(super) async fn has_token(app: &App, headers: &HeaderMap) -> Result<bool, ApiError> {
    let Some(token) = sent_token(headers) else { return Ok(false) };
    app.tokens.grant(token).await?.map(|_| true).ok_or_else(unknown_token)
}

/// The token in the value of the header `Authorization`. An error never shows a part of a token.
pub(super) fn bearer(value: &str) -> Result<&str, &'static str> {
    let value = value.trim();
    match value.split_once(' ').map(|(scheme, token)| (scheme, token.trim())) {
        Some((scheme, token)) if scheme.eq_ignore_ascii_case("bearer") => Ok(token),
        Some((scheme, _)) if scheme.eq_ignore_ascii_case("basic") => Err(
            "the header says `Basic`, a user and a password; send the token as `Authorization: Bearer TOKEN`",
        ),
        Some(_) => {
            Err("the token must follow the word Bearer; send it as `Authorization: Bearer TOKEN`")
        }
        None if value.eq_ignore_ascii_case("bearer") || value.is_empty() => {
            Err("there is no token after the word Bearer; send it as `Authorization: Bearer TOKEN`")
        }
        None => Err(
            "the word Bearer is missing before the token; send it as `Authorization: Bearer TOKEN`",
        ),
    }
}

/// The refusal of a token that opens nothing.
pub(super) fn unknown_token() -> ApiError {
    let detail = "the token is unknown, was replaced or revoked, or has expired";
    ApiError::new(Code::Unauthorized, detail)
}

fn check_rate(app: &App, owner: Option<OwnerKey>) -> Result<(), ApiError> {
    owner.map_or(Ok(()), |owner| app.rates.check_key(owner))
}

impl Caller {
    pub(super) fn is_organizer(&self) -> bool {
        matches!(self, Self::Key(key) if key.role == Role::Organizer)
    }

    /// Organizers and judges read all games.
    pub(super) fn reads_all(&self) -> bool {
        matches!(self, Self::Key(key) if matches!(key.role, Role::Organizer | Role::Judge))
    }

    /// The rank in which the caller shares streams and exports: those who oversee games have the reserve.
    pub(super) fn rank(&self) -> Rank {
        if self.reads_all() { Rank::Urgent } else { Rank::Normal }
    }

    /// Refuses judges, where others are refused for reasons of their own.
    pub(super) fn check_not_judge(&self) -> Result<(), ApiError> {
        match self {
            Self::Key(key) if key.role == Role::Judge => {
                Err(ApiError::new(Code::Forbidden, JUDGES_READ))
            }
            _ => Ok(()),
        }
    }

    /// The key of the caller; all other callers are refused.
    pub(super) fn needs_key(&self) -> Result<&Key, ApiError> {
        match self {
            Self::Key(key) => Ok(key),
            Self::Anonymous { .. } => Err(needs_token("a key")),
            Self::Seat(..) | Self::Swarm(..) | Self::Run(..) => {
                let detail = "a token of an episode is for playing; send the key";
                Err(ApiError::new(Code::Forbidden, detail))
            }
        }
    }

    /// Data of no episode is public, but on a private server it needs a token.
    pub(super) fn check_may_browse(&self, access: &Access) -> Result<(), ApiError> {
        match self {
            Self::Anonymous { .. } if access.private => Err(needs_token("a key")),
            _ => Ok(()),
        }
    }

    /// An owner has the rights of the creator of the episode.
    pub(super) fn owns(&self, episode: Subject<'_>) -> bool {
        if episode.visibility == Visibility::Sealed {
            return self.is_organizer();
        }
        match self {
            Self::Swarm(own, Seats::Creators) => Some(own) == episode.id,
            // A holder of a team plays for itself, and not for the creator.
            Self::Run(own, Seats::Creators) => Some(*own) == episode.run,
            Self::Key(key) => {
                self.is_organizer() || (key.number.is_some() && key.number == episode.owner)
            }
            // While there are no keys, no caller can prove to be the creator of an episode.
            Self::Anonymous { may_create } => {
                *may_create && episode.owner.is_none() && episode.visibility == Visibility::Public
            }
            Self::Seat(..) | Self::Swarm(..) | Self::Run(..) => false,
        }
    }

    /// Holders of a team that no key created, whose creator nobody can prove to be.
    pub(super) fn plays_for_nobody(&self, run: Subject<'_>) -> bool {
        run.owner.is_none() && matches!(self, Self::Run(own, _) if Some(*own) == run.run)
    }

    /// An overseer sees all of the episode before its end, with its seed. The creator is not one if there are several holders, as
    /// it may be one of the players.
    pub(super) fn oversees(&self, episode: Subject<'_>) -> bool {
        self.reads_all() || (self.owns(episode) && !episode.is_mixed)
    }

    /// A known caller has a key, or a token of the episode.
    fn is_known(&self, episode: Subject<'_>) -> bool {
        match self {
            Self::Seat(own, _) | Self::Swarm(own, _) => Some(own) == episode.id,
            Self::Run(own, _) => Some(*own) == episode.run,
            Self::Key(_) => true,
            Self::Anonymous { .. } => false,
        }
    }

    /// Readers get state, events and resolved rounds of an open episode.
    pub(super) fn may_read(&self, access: &Access, episode: Subject<'_>) -> bool {
        if self.oversees(episode) {
            return true;
        }
        let is_own = || matches!(self, Self::Key(key) if key.number.is_some() && key.number == episode.owner);
        if episode.opened == Opened::Owner && episode.is_over && is_own() {
            return true;
        }
        let anyone = match episode.visibility {
            Visibility::Public => true,
            Visibility::Owner => episode.is_over,
            Visibility::Sealed => episode.is_over && episode.opened == Opened::All,
        };
        anyone && (!access.private || self.is_known(episode))
    }

    pub(super) fn may_read_ended(&self, access: &Access) -> bool {
        !access.private || matches!(self, Self::Key(_))
    }

    /// True if the caller may know of the episode; others get `not_found`.
    pub(super) fn may_know(&self, access: &Access, episode: Subject<'_>) -> bool {
        self.may_read(access, episode)
            || self.owns(episode)
            || (episode.is_claimable && self.may_play())
            || match self {
                Self::Seat(own, _) | Self::Swarm(own, _) => Some(own) == episode.id,
                Self::Run(own, _) => Some(*own) == episode.run,
                Self::Key(key) => key.number.is_some() && key.number == episode.owner,
                Self::Anonymous { .. } => false,
            }
    }

    /// Players create episodes, and claim seats of others' episodes.
    const fn may_play(&self) -> bool {
        match self {
            Self::Key(key) => !matches!(key.role, Role::Judge),
            Self::Anonymous { may_create: true } => true,
            Self::Anonymous { may_create: false }
            | Self::Seat(..)
            | Self::Swarm(..)
            | Self::Run(..) => false,
        }
    }

    /// Episodes that the caller finds in lists.
    pub(super) fn readable(&self, app: &App) -> Readable {
        let access = &app.access;
        match self {
            Self::Key(_) if self.reads_all() => Readable::All,
            Self::Key(key) => key.number.map_or(Readable::Public, |owner| Readable::AndOf {
                owner,
                at: app.time_to_open(),
            }),
            Self::Swarm(own, Seats::Creators) if access.private => Readable::Only(own.clone()),
            Self::Swarm(own, Seats::Creators) => Readable::And(own.clone()),
            Self::Run(own, _) if access.private => Readable::OnlyOfRun(*own),
            Self::Run(own, _) => Readable::AndOfRun(*own),
            Self::Swarm(..) | Self::Seat(..) | Self::Anonymous { .. } if access.private => {
                Readable::Nothing
            }
            Self::Swarm(..) | Self::Seat(..) | Self::Anonymous { .. } => Readable::Public,
        }
    }

    pub(super) fn created(&self, owner: Option<OwnerKey>) -> bool {
        matches!(self, Self::Key(key) if key.number.is_some() && key.number == owner)
    }

    /// The audit entry of what an organizer did to something of another owner; everybody sees it in the competition to which that
    /// belongs, if any. None if the caller is not an organizer, or is the owner.
    pub(super) fn audit_foreign(
        &self,
        owner: Option<OwnerKey>,
        at: Timestamp,
        action: &'static str,
        subject: &str,
        detail: serde_json::Value,
        competition: Option<CompetitionKey>,
    ) -> Option<Entry> {
        match self {
            Self::Key(key) if self.is_organizer() && key.number != owner => {
                let who = key.id.clone();
                let subject = subject.to_owned();
                let shown = competition.map(|competition| (competition, detail.clone()));
                Some(Entry::Audit(Box::new(AuditRow { at, who, action, subject, detail, shown })))
            }
            _ => None,
        }
    }

    /// Boards are public, but on a private server they need a key.
    pub(super) fn may_read_boards(&self, access: &Access) -> Result<(), ApiError> {
        match self {
            _ if !access.private => Ok(()),
            Self::Key(_) => Ok(()),
            Self::Anonymous { .. } => Err(needs_token("a key")),
            Self::Seat(..) | Self::Swarm(..) | Self::Run(..) => {
                let detail = "this server is private: boards need a key";
                Err(ApiError::new(Code::Forbidden, detail))
            }
        }
    }

    /// The owner and purpose of a new episode, if the caller may create one.
    pub(super) fn creator(&self, app: &App, client: Client) -> Result<(Party, Purpose), ApiError> {
        let detail = "a token of an episode cannot create another; send a key, or no token on a server without keys";
        let party = match self.player(app, detail)? {
            None if client.is_local => Party::SERVER,
            None => client.party(),
            owner => Party::of_key(owner),
        };
        let purpose = if self.is_organizer() { Purpose::Organizer } else { Purpose::Usual };
        Ok((party, purpose))
    }

    /// The key to which claimed seats belong, with its public id, where the caller may claim some.
    pub(super) fn claimant(
        &self,
        app: &App,
    ) -> Result<(Option<OwnerKey>, Option<String>), ApiError> {
        let detail = "a token of an episode cannot claim seats; send a key, or no token on a server without keys";
        let owner = self.player(app, detail)?;
        let id = match self {
            Self::Key(key) => Some(key.id.clone()),
            Self::Anonymous { .. } | Self::Seat(..) | Self::Swarm(..) | Self::Run(..) => None,
        };
        Ok((owner, id))
    }

    /// The key of a caller who may take part; `detail` is the error for tokens, which may not.
    fn player(&self, app: &App, detail: &str) -> Result<Option<OwnerKey>, ApiError> {
        self.check_not_judge()?;
        match self {
            Self::Key(key) if key.role == Role::Entrant => Err(ApiError::new(
                Code::Forbidden,
                "this key is for attempts in competitions; ask the organizer for a member's key",
            )),
            Self::Key(key) => Ok(key.number),
            Self::Anonymous { may_create: true } => Ok(None),
            Self::Anonymous { may_create: false } if app.has_keys => Err(needs_token("a key")),
            Self::Anonymous { may_create: false } => Err(ApiError::new(
                Code::Forbidden,
                "this server has no keys and is open to programs on its own machine only, that ask for localhost themselves; \
                 its operator can make a key with `swarmbench key create`",
            )),
            Self::Seat(..) | Self::Swarm(..) | Self::Run(..) => {
                Err(ApiError::new(Code::Forbidden, detail))
            }
        }
    }
}

/// The seat of a request that only an agent can make.
pub(super) struct TokenSeat {
    pub(super) handle: Handle,
    pub(super) agent: AgentId,
}

impl FromRequestParts<App> for TokenSeat {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        Self::of(Caller::from_request_parts(parts, app).await?, app).await
    }
}

impl TokenSeat {
    pub(super) async fn of(caller: Caller, app: &App) -> Result<Self, ApiError> {
        let detail = match caller {
            Caller::Seat(episode, agent) => {
                return Ok(Self { handle: app.episode(&episode).await?, agent });
            }
            Caller::Anonymous { .. } => return Err(needs_token("a seat token")),
            Caller::Swarm(..) | Caller::Run(..) => {
                "this is a swarm token; use /swarm/obs and /swarm/act, or a seat token here"
            }
            Caller::Key(_) => "a key holds no seat; send the seat token that came with the episode",
        };
        Err(ApiError::new(Code::Forbidden, detail))
    }
}

pub(super) enum Swarm {
    Episode(EpisodeId, Seats),
    /// Seats of all episodes of a run.
    Run(RunKey, Seats),
}

impl FromRequestParts<App> for Swarm {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        let detail = match Caller::from_request_parts(parts, app).await? {
            Caller::Swarm(episode, seats) => return Ok(Self::Episode(episode, seats)),
            Caller::Run(run, seats) => return Ok(Self::Run(run, seats)),
            Caller::Anonymous { .. } => return Err(needs_token("a swarm token")),
            Caller::Seat(..) => "this is a seat token; use /obs and /act, or a swarm token here",
            Caller::Key(_) => {
                "a key holds no seats; send the swarm token that came with the episode or the run"
            }
        };
        Err(ApiError::new(Code::Forbidden, detail))
    }
}

/// Extracts an organizer; all other callers are refused.
pub(super) struct Organizer {
    pub(super) key: Key,
}

impl FromRequestParts<App> for Organizer {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        let caller = Caller::from_request_parts(parts, app).await?;
        caller.check_not_judge()?;
        match caller {
            Caller::Anonymous { .. } => Err(needs_token("an organizer's key")),
            Caller::Key(key) if key.role == Role::Organizer => Ok(Self { key }),
            _ => Err(ApiError::new(Code::Forbidden, "this needs an organizer's key")),
        }
    }
}

/// The error for a judge who wants to do something.
const JUDGES_READ: &str = "this is a judge's key: judges read, and neither play nor change anything; an organizer's key may";

/// The key of an organizer or of a judge.
pub(super) struct Overseer;

impl FromRequestParts<App> for Overseer {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ApiError> {
        match Caller::from_request_parts(parts, app).await? {
            Caller::Anonymous { .. } => Err(needs_token("an organizer's or a judge's key")),
            caller if caller.reads_all() => Ok(Self),
            _ => Err(ApiError::new(Code::Forbidden, "this needs an organizer's or a judge's key")),
        }
    }
}

pub(super) fn needs_token(which: &str) -> ApiError {
    let detail = format!("send {which} as `Authorization: Bearer TOKEN`");
    ApiError::new(Code::Unauthorized, detail)
}
