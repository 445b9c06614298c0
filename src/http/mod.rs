//! HTTP: the only place that names axum. Handlers hold no SQL and no rules of the game.

mod agent;
mod auth;
mod episodes;
pub mod error;
mod extract;
mod host;
pub mod limits;
pub mod openapi;
mod pace;
mod router;
pub mod serve;
mod swarm;
mod waiting;

use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use quick_cache::sync::Cache;
use tokio_util::sync::CancellationToken;

use crate::clock::{Clock, Entropy};
use crate::episode::actor::Handle;
use crate::episode::registry::Registry;
use crate::ids::{EpisodeId, TokenHash};
use crate::store::Store;
use crate::store::tokens::Grant;
use error::ApiError;
use limits::Limits;
pub use router::router;

/// Tokens that are remembered, so that most requests ask no database.
const TOKENS_CACHED: usize = 100_000;

/// What all handlers share. Cloning shares it.
#[derive(Clone)]
pub struct App(Arc<Shared>);

/// See [`App`].
pub struct Shared {
    /// Where things are kept.
    pub store: Store,
    /// All episodes.
    pub registry: Registry,
    /// Where the time comes from.
    pub clock: Arc<dyn Clock>,
    /// Where randomness comes from.
    pub entropy: Arc<dyn Entropy>,
    /// What is taken at most.
    pub limits: Limits,
    /// Ends all waits when the server stops.
    pub stop: CancellationToken,
    /// Whether all unfinished episodes were taken up.
    pub ready: AtomicBool,
    tokens: Cache<TokenHash, Grant>,
    /// How often tokens were revoked.
    revocations: AtomicU64,
    /// Tells this run of the server from others.
    boot: u64,
    waits: Arc<AtomicUsize>,
    /// Creations with an idempotency key go one by one.
    creating: tokio::sync::Mutex<()>,
}

impl App {
    /// What handlers share over a store.
    #[must_use]
    pub fn new(
        store: Store,
        registry: Registry,
        clock: Arc<dyn Clock>,
        entropy: Arc<dyn Entropy>,
        limits: Limits,
        stop: CancellationToken,
    ) -> Self {
        let mut boot = [0; 8];
        entropy.fill(&mut boot);
        Self(Arc::new(Shared {
            store,
            registry,
            clock,
            entropy,
            limits,
            stop,
            ready: AtomicBool::new(false),
            tokens: Cache::new(TOKENS_CACHED),
            revocations: AtomicU64::new(0),
            boot: u64::from_le_bytes(boot),
            waits: Arc::default(),
            creating: tokio::sync::Mutex::new(()),
        }))
    }

    /// What a token stands for, if it is known.
    async fn grant(&self, hash: TokenHash) -> Result<Option<Grant>, ApiError> {
        if let Some(grant) = self.tokens.get(&hash) {
            return Ok(Some(grant));
        }
        let revocations = self.revocations.load(Ordering::Acquire);
        let Some(grant) = self.store.find_token(hash).await? else { return Ok(None) };
        self.tokens.insert(hash, grant.clone());
        if self.revocations.load(Ordering::Acquire) != revocations {
            // It may have been revoked between being read and being remembered.
            self.tokens.remove(&hash);
        }
        Ok(Some(grant))
    }

    /// Forgets the tokens of an episode; the store must not know them any more.
    fn forget_tokens(&self, episode: &EpisodeId) {
        self.revocations.fetch_add(1, Ordering::AcqRel);
        self.tokens.retain(|_, grant| grant.episode != *episode);
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
