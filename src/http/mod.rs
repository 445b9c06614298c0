//! HTTP: the only place that names axum. Handlers hold no SQL and no rules of the game.

mod agent;
mod answer;
mod audit;
pub mod auth;
mod boards;
mod checks;
mod claims;
mod client;
mod competitions;
mod episodes;
pub mod error;
mod exports;
mod extract;
mod host;
mod imports;
mod keys;
pub mod limits;
pub mod openapi;
mod pace;
mod page;
mod refusals;
mod router;
mod runs;
pub mod serve;
mod swarm;
mod waiting;

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use quick_cache::sync::Cache;
use tokio::sync::{Mutex, MutexGuard, Semaphore};
use tokio_util::sync::CancellationToken;

use crate::board::interval::Memory;
use crate::clock::{Clock, Entropy};
use crate::episode::actor::Handle;
use crate::episode::registry::Registry;
use crate::host::Disk;
use crate::ids::{EpisodeId, Token, TokenHash, TokenKind};
use crate::run::manager::Runs;
use crate::standings::Standings;
use crate::store::Store;
use crate::store::tokens::Grant;
use agent::look::Sights;
use auth::Access;
use client::Rates;
use error::{ApiError, Code};
use limits::Limits;
pub use router::router;

/// Tokens that are remembered, so that most requests ask no database.
const TOKENS_CACHED: usize = 100_000;

/// Locks of creations that may be repeated: those with the same key have the same one.
const CREATION_LOCKS: usize = 64;

/// Texts for language models, and boards, that are made at once; each keeps a core busy.
const RENDERS_MAX: usize = 8;

/// Differences between rows of boards that are remembered.
const INTERVALS_CACHED: usize = 100_000;

/// How long a request waits for its turn to have a text or a board made.
const RENDER_PATIENCE: Duration = Duration::from_secs(5);

/// What all handlers share. Cloning shares it.
#[derive(Clone)]
pub struct App(Arc<Shared>);

/// What a server is put together from.
pub struct Foundation {
    /// Where things are kept.
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
    /// Whether all unfinished episodes with clocks were taken up.
    pub ready: AtomicBool,
    rates: Rates,
    tokens: Cache<TokenHash, Grant>,
    /// How often tokens were revoked.
    revocations: AtomicU64,
    /// Tells this run of the server from others.
    boot: u64,
    /// What seats see in open rounds, as it was written.
    sights: Sights,
    waits: Arc<AtomicUsize>,
    /// How many open rounds were seen by somebody who holds several seats. Whoever looks holds it, so that
    /// what is new to one look is new to all that come after it.
    rounds_seen: std::sync::Mutex<u64>,
    /// Bytes of bodies that are not complete.
    arriving: AtomicUsize,
    renders: Semaphore,
    /// Turns to read a journal; each may take as much memory as a round has text.
    journals: Arc<Semaphore>,
    /// Turns to make an export; each keeps a thread busy.
    exports: Arc<Semaphore>,
    creating: [Mutex<()>; CREATION_LOCKS],
    /// What boards are made of.
    standings: Standings,
    intervals: Memory,
}

impl App {
    /// What handlers share.
    #[must_use]
    pub fn new(foundation: Foundation) -> Self {
        let mut boot = [0; 8];
        foundation.entropy.fill(&mut boot);
        Self(Arc::new(Shared {
            rates: Rates::new(&foundation.limits, Arc::clone(&foundation.clock)),
            journals: Arc::new(Semaphore::new(foundation.limits.journals_max)),
            standings: Standings::new(foundation.store.clone()),
            intervals: Memory::new(INTERVALS_CACHED),
            exports: Arc::new(Semaphore::new(foundation.limits.exports_max)),
            foundation,
            ready: AtomicBool::new(false),
            tokens: Cache::new(TOKENS_CACHED),
            revocations: AtomicU64::new(0),
            boot: u64::from_le_bytes(boot),
            sights: Sights::new(),
            waits: Arc::default(),
            rounds_seen: std::sync::Mutex::new(0),
            arriving: AtomicUsize::new(0),
            renders: Semaphore::new(RENDERS_MAX),
            creating: std::array::from_fn(|_| Mutex::new(())),
        }))
    }

    /// Reads all results, so that whoever asks for a board first does not wait for that.
    pub async fn read_boards(&self) {
        if let Err(error) = self.standings.boards().await {
            // Whoever asks is told the same.
            tracing::warn!(%error, "boards cannot be read");
        }
    }

    /// Forgets what is not needed any more; to be called now and then.
    pub fn tidy(&self) {
        self.registry.let_go();
        self.rates.forget_idle();
    }

    /// Does something to its end, also where whoever asked for it has gone: a handler is dropped where
    /// it waits when its client hangs up.
    async fn to_its_end<T: Send + 'static>(
        work: impl Future<Output = Result<T, ApiError>> + Send + 'static,
    ) -> Result<T, ApiError> {
        let done = tokio::spawn(work).await;
        done.unwrap_or_else(|error| Err(ApiError::new(Code::Internal, error.to_string())))
    }

    /// One creation with the same idempotency key goes on at a time.
    async fn one_by_one(&self, key: &str) -> MutexGuard<'_, ()> {
        let lock = crc32fast::hash(key.as_bytes()) as usize % CREATION_LOCKS;
        self.creating[lock].lock().await
    }

    /// Does work that keeps a core busy for milliseconds, off the async threads.
    async fn render<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, ApiError> {
        let Ok(Ok(_turn)) = tokio::time::timeout(RENDER_PATIENCE, self.renders.acquire()).await
        else {
            let detail =
                "too many prompts and boards are asked for; ask again later, or without `prompt`";
            return Err(ApiError::limit(Code::Overloaded, "renders_max", RENDERS_MAX, detail)
                .retry_after(Duration::from_secs(1)));
        };
        let done = tokio::task::spawn_blocking(work).await;
        done.map_err(|error| ApiError::new(Code::Internal, error.to_string()))
    }

    /// What a token stands for, if it is known.
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

    /// Forgets tokens; the store must not know them any more as they were.
    fn forget_tokens(&self, is_old: impl Fn(&Grant) -> bool) {
        self.revocations.fetch_add(1, Ordering::AcqRel);
        self.tokens.retain(|_, grant| !is_old(grant));
    }

    /// The episode with this id.
    async fn episode(&self, id: &EpisodeId) -> Result<Handle, ApiError> {
        let found = self.registry.find(id).await?;
        found.ok_or_else(|| ApiError::not_found("the episode"))
    }
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
