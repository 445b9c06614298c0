//! HTTP: the only place that names axum. Handlers hold no SQL and no rules of the game.

mod agent;
mod answer;
mod audit;
pub mod auth;
mod boards;
mod body;
mod cache;
mod checks;
mod claims;
mod client;
mod clock;
mod competitions;
mod docs;
mod episodes;
pub mod error;
mod exports;
mod extract;
mod host;
mod imports;
mod keys;
pub mod limits;
pub mod openapi;
mod page;
mod refusals;
mod room;
mod router;
mod runs;
pub mod serve;
mod stream;
mod swarm;
mod timers;
mod waiting;

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use quick_cache::sync::Cache;
use swarmbench_engine::World;
use tokio::sync::{Mutex, MutexGuard};
use tokio_util::sync::CancellationToken;

use crate::board::interval::Memory;
use crate::clock::{Clock, Entropy};
use crate::episode::actor::Handle;
use crate::episode::registry::{Location, Registry};
use crate::episode::replay::state_at;
use crate::fair::{FairLimit, Party, Permit, Rank, Shares};
use crate::host::Disk;
use crate::ids::{EpisodeId, Token, TokenHash, TokenKind};
use crate::journal::CompetitionKey;
use crate::keys::{OwnerKey, Role};
use crate::run::manager::Runs;
use crate::standings::Standings;
use crate::store::Store;
use crate::store::tokens::Grant;
use crate::telemetry;
use crate::work::{JOBS_WAITING_MAX, Workers};
use agent::look::Sights;
use auth::Access;
use body::Bodies;
use cache::{ANSWERS_BYTES_MAX, Answer, RANKINGS_BYTES_MAX, SharedCache};
use client::Rates;
use competitions::board::Ranking;
use error::{ApiError, Code};
use limits::Limits;
pub use router::router;
use stream::Streams;

/// Tokens that are remembered, so that most requests ask no database.
const TOKENS_CACHED: usize = 100_000;

/// Locks of creations that may be repeated: those with the same key have the same one.
const CREATION_LOCKS: usize = 64;

/// Differences between rows of boards that are remembered.
const INTERVALS_CACHED: usize = 100_000;

/// How long a request waits until a prompt or a board is made.
const RENDER_PATIENCE: Duration = Duration::from_secs(5);

/// How long a request waits for the recovery of an episode.
const RECOVERY_TIMEOUT: Duration = Duration::from_secs(20);

/// How long a request waits until a state of an earlier round can be made.
const REPLAY_PATIENCE: Duration = Duration::from_secs(10);

/// What all handlers share. Cloning shares it.
#[derive(Clone)]
pub struct App(Arc<Shared>);

/// What a server is put together from.
pub struct Foundation {
    /// The store.
    pub store: Store,
    /// All episodes.
    pub registry: Registry,
    /// All runs.
    pub runs: Runs,
    /// Where the time comes from.
    pub clock: Arc<dyn Clock>,
    /// Where randomness comes from.
    pub entropy: Arc<dyn Entropy>,
    /// Where the database lies.
    pub disk: Arc<dyn Disk>,
    /// What does heavy work.
    pub workers: Workers,
    /// What is taken at most.
    pub limits: Limits,
    /// To whom the server opens.
    pub access: Access,
    /// Whether a key was ever made. From then on nobody creates anything without one, whatever became
    /// of the key.
    pub has_keys: bool,
    /// Ends all waits when the server stops.
    pub stop: CancellationToken,
}

/// See [`App`].
pub struct Shared {
    foundation: Foundation,
    /// Whether all unfinished episodes with clocks were recovered.
    pub ready: AtomicBool,
    rates: Rates,
    tokens: Cache<TokenHash, Grant>,
    /// The competitions for which entrants' keys were made; they never change.
    entered: Cache<OwnerKey, CompetitionKey>,
    /// How often tokens were revoked.
    revocations: AtomicU64,
    /// Tells this run of the server from others.
    boot: u64,
    /// What seats see in open rounds, as it was written.
    sights: Sights,
    waits: Arc<AtomicUsize>,
    /// How many open rounds were seen by a holder of several seats. A look locks it, so that
    /// what is new to one look is new to all that come after it.
    rounds_seen: std::sync::Mutex<u64>,
    bodies: Arc<Bodies>,
    /// Permits for replays of earlier rounds; each may take as much memory as some rounds have text.
    replays: FairLimit,
    /// Permits for large answers.
    large_answers: FairLimit,
    streams: Streams,
    creating: [Mutex<()>; CREATION_LOCKS],
    /// What boards are made of.
    standings: Standings,
    intervals: Memory,
    /// Boards and lists as they were made last.
    answers: SharedCache<Answer>,
    /// Competitions as they were ranked last.
    rankings: SharedCache<Ranking>,
    /// Requests that are not answered yet.
    in_flight: Arc<client::InFlight>,
}

impl App {
    /// What handlers share.
    #[must_use]
    pub fn new(foundation: Foundation) -> Self {
        let mut boot = [0; 8];
        foundation.entropy.fill(&mut boot);
        Self(Arc::new(Shared {
            rates: Rates::new(&foundation.limits, Arc::clone(&foundation.clock)),
            streams: Streams::new(&foundation.limits),
            bodies: Arc::new(Bodies::new(&foundation.limits)),
            standings: Standings::new(foundation.store.clone()),
            intervals: Memory::new(INTERVALS_CACHED),
            replays: replays(&foundation.limits),
            large_answers: large_answers(&foundation.limits),
            answers: SharedCache::new(ANSWERS_BYTES_MAX),
            rankings: SharedCache::new(RANKINGS_BYTES_MAX),
            in_flight: Arc::default(),
            foundation,
            ready: AtomicBool::new(false),
            tokens: Cache::new(TOKENS_CACHED),
            entered: Cache::new(TOKENS_CACHED),
            revocations: AtomicU64::new(0),
            boot: u64::from_le_bytes(boot),
            sights: Sights::new(),
            waits: Arc::default(),
            rounds_seen: std::sync::Mutex::new(0),
            creating: std::array::from_fn(|_| Mutex::new(())),
        }))
    }

    /// Reads all results, so that the first request for a board does not wait for that.
    pub async fn read_boards(&self) {
        if let Err(error) = self.standings.boards().await {
            // Requests get the same error.
            tracing::warn!(%error, "boards cannot be read");
        }
    }

    /// Evicts unused entries; to be called periodically.
    pub fn tidy(&self) {
        self.registry.evict_unused();
        self.rates.forget_idle();
    }

    /// Runs work in a task of its own, so that it completes: a handler is dropped at an `await`
    /// when its client hangs up.
    async fn run_detached<T: Send + 'static>(
        work: impl Future<Output = Result<T, ApiError>> + Send + 'static,
    ) -> Result<T, ApiError> {
        let done = telemetry::spawn(work).await;
        done.unwrap_or_else(|error| Err(ApiError::new(Code::Internal, error.to_string())))
    }

    /// Serializes creations with the same idempotency key.
    async fn idempotency_lock(&self, key: &str) -> MutexGuard<'_, ()> {
        let lock = crc32fast::hash(key.as_bytes()) as usize % CREATION_LOCKS;
        self.creating[lock].lock().await
    }

    /// Does work that keeps a core busy for milliseconds, off the async threads, as its turn among that of
    /// all parties comes.
    async fn render<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, ApiError> {
        let work = self.workers.run("render", Party::current(), Rank::Normal, |_| work());
        let Ok(done) = tokio::time::timeout(RENDER_PATIENCE, work).await else {
            let detail =
                "too much heavy work (prompts, boards, large worlds) is queued; try again later";
            return Err(ApiError::limit(
                Code::Overloaded,
                "heavy_jobs_max",
                JOBS_WAITING_MAX,
                detail,
            )
            .retry_after(Duration::from_secs(1)));
        };
        Ok(done?)
    }

    /// The rights of a token, if it is known.
    async fn grant(&self, token: &Token) -> Result<Option<Grant>, ApiError> {
        let hash = token.hash();
        if let Some(grant) = self.tokens.get(&hash) {
            return Ok(Some(grant));
        }
        let revocations = self.revocations.load(Ordering::Acquire);
        let grant = match token.kind() {
            TokenKind::Seat | TokenKind::Swarm => self.store.find_token(hash).await?,
            TokenKind::Key => self.store.find_key(hash).await?.map(Grant::Key),
            TokenKind::Invitation => None,
        };
        let Some(grant) = grant else { return Ok(None) };
        self.tokens.insert(hash, grant.clone());
        if self.revocations.load(Ordering::Acquire) != revocations {
            // It may have been revoked between being read and being remembered.
            self.tokens.remove(&hash);
        }
        Ok(Some(grant))
    }

    /// For whom something is done with a token; none where that tells no more than the address.
    async fn party(&self, grant: &Grant) -> Result<Option<Party>, ApiError> {
        let (competition, owner) = match grant {
            Grant::Seat { owner, .. } | Grant::Swarm { owner, .. } => (None, *owner),
            Grant::Run { owner, competition, .. } => (*competition, *owner),
            Grant::Key(key) => match key.number.filter(|_| key.role == Role::Entrant) {
                Some(owner) => (self.competition_of(owner).await?, Some(owner)),
                None => (None, key.number),
            },
        };
        Ok(owner.map(|owner| Party::within(competition, Some(owner))))
    }

    /// The competition for which an entrant's key was made.
    async fn competition_of(&self, owner: OwnerKey) -> Result<Option<CompetitionKey>, ApiError> {
        if let Some(known) = self.entered.get(&owner) {
            return Ok(Some(known));
        }
        let found = self.store.competition_of(owner).await?;
        if let Some(competition) = found {
            self.entered.insert(owner, competition);
        }
        Ok(found)
    }

    /// Forgets tokens; the store must not know them any more as they were.
    fn forget_tokens(&self, is_old: impl Fn(&Grant) -> bool) {
        self.revocations.fetch_add(1, Ordering::AcqRel);
        self.tokens.retain(|_, grant| !is_old(grant));
    }

    /// The episode with this id. The request waits while an unfinished one is recovered, up to a limit.
    async fn episode(&self, id: &EpisodeId) -> Result<Handle, ApiError> {
        let find = self.registry.find(id);
        let found = match self.registry.location(id) {
            Location::Memory => find.await,
            Location::Unfinished => {
                let found = tokio::time::timeout(RECOVERY_TIMEOUT, find).await;
                found.map_err(|_| {
                    let detail = "the episode is still being recovered from its journal; its clock does not run";
                    ApiError::new(Code::Unavailable, detail).retry_after(Duration::from_secs(5))
                })?
            }
            Location::Journal => {
                let _turn = self.replay_turn().await?;
                find.await
            }
        };
        found?.ok_or_else(|| ApiError::not_found("the episode"))
    }

    /// A permit for a large answer, held until it is made. Then its parts on the async threads are
    /// few at a time.
    async fn large_answer(&self) -> Result<Permit, ApiError> {
        let turn = self.large_answers.acquire(Party::current(), Rank::Normal).await;
        let detail = "too many large answers are requested; try again later, or ask for less";
        turn.map_err(|busy| ApiError::no_permit(busy, detail))
    }

    /// A permit for a replay.
    async fn replay_turn(&self) -> Result<Permit, ApiError> {
        let turn = self.replays.acquire(Party::current(), Rank::Normal).await;
        let detail = "too many earlier rounds are being replayed; try again later";
        turn.map_err(|busy| ApiError::no_permit(busy, detail))
    }

    /// The state after `round` rounds, which must be resolved; `near` is a state on the way to it.
    async fn state_at(
        &self,
        handle: &Handle,
        round: u32,
        near: Option<&Arc<World>>,
    ) -> Result<Arc<World>, ApiError> {
        let kept = handle.keyframe(round);
        if kept.round() == round {
            return Ok(kept);
        }
        let _turn = self.replay_turn().await?;
        Ok(state_at(self.registry.host(), handle, round, near).await?)
    }
}

/// Permits for large answers. A group has no more than half of them.
fn large_answers(limits: &Limits) -> FairLimit {
    let shares = Shares::halved(limits.large_answers_max, limits.large_answers_waiting_max);
    let shares = Shares { slots_per_member: 1, ..shares };
    FairLimit::new("large_answers_max", shares, RENDER_PATIENCE)
}

/// Permits for replays. A group has no more than half of them.
fn replays(limits: &Limits) -> FairLimit {
    let waiting = limits.replays_waiting_max;
    let shares = Shares::halved(limits.replays_max, waiting);
    let shares = Shares { waiting_per_group: waiting.div_ceil(8), ..shares };
    FairLimit::new("replays_max", shares, REPLAY_PATIENCE)
}

impl Deref for App {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

impl Deref for Shared {
    type Target = Foundation;

    fn deref(&self) -> &Foundation {
        &self.foundation
    }
}
