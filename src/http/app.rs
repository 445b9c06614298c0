//! State that all handlers share.

use std::ops::Deref;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ipnet::IpNet;
use jiff::Timestamp;
use swarmbench_engine::World;
use tokio_util::sync::CancellationToken;

use super::body::Bodies;
use super::cache::{CachedResponse, SharedCache};
use super::episodes::verification::{VERIFICATIONS_MAX, Verifications};
use super::error::{ApiError, Code};
use super::forward::Forwarder;
use super::heavy::Heavy;
use super::idempotency::Creations;
use super::in_flight::InFlight;
use super::limits::Limits;
use super::observation_cache::ObservationCache;
use super::pages::Source;
use super::ranking::Ranking;
use super::rates::Rates;
use super::replay_pages::ReplayPages;
use super::stream::{Answers, Streams};
use super::tokens::Tokens;
use super::waiting::Waits;
use crate::competitions;
use crate::competitions::standings::CompetitionStandings;
use crate::episode::actor::Handle;
use crate::episode::registry::{Location, Registry};
use crate::episode::replay::state_at;
use crate::host::Disk;
use crate::ids::{EpisodeId, Token, TokenKind};
use crate::run::manager::Runs;
use crate::standings::Standings;
use crate::store::tokens::Grant;
use crate::store::{Store, StoreError};
use crate::work::Workers;
use swarmbench_clock::{Clock, Entropy};

/// Maximum time that the answer to a revocation waits until all servers of a cluster act by it: longer than the lease of a dead
/// server.
const REVOCATION_PATIENCE: Duration = Duration::from_secs(15);

/// Pause between two looks at the servers meanwhile.
const REVOCATION_PAUSE: Duration = Duration::from_millis(50);

/// Bytes of boards, lists, pages of replays and observations that are cached; an eighth of `memory_bytes_max` where that is less.
const CACHES_BYTES_MAX: usize = 256 * 1024 * 1024;

/// Maximum time that a request waits for the recovery of an episode.
const RECOVERY_TIMEOUT: Duration = Duration::from_secs(20);

/// State that all handlers share. Clones are the same state.
#[derive(Clone)]
pub struct App(Arc<Shared>);

/// Access to a server.
#[derive(Clone, Debug, Default)]
pub struct Access {
    /// While there are no keys, every client may create episodes, not only programs on this machine.
    pub open: bool,
    /// Reading needs a key, or a token of the episode.
    pub private: bool,
    /// The proxies whose `X-Forwarded-For` is believed.
    pub trusted_proxies: Vec<IpNet>,
    /// The names by which clients reach `/mcp`, beside addresses and localhost; in lower case.
    pub hosts: Vec<String>,
}

/// The newest competitions whose boards are read at the start, where they are open.
const COMPETITIONS_READ_MAX: u32 = 100;

/// Parts of a server.
pub struct Foundation {
    pub store: Store,
    pub registry: Registry,
    pub runs: Runs,
    pub clock: Arc<dyn Clock>,
    pub entropy: Arc<dyn Entropy>,
    pub disk: Arc<dyn Disk>,
    pub workers: Workers,
    pub limits: Limits,
    pub access: Access,
    /// Source of the files of pages.
    pub pages: Source,
    /// A key was made at some time. From then on creating needs one, even if all keys are revoked.
    pub has_keys: bool,
    /// Ends all waits when the server stops.
    pub stop: CancellationToken,
    /// The other servers of the database, where there may be some.
    pub forwarder: Option<Arc<Forwarder>>,
}

/// See [`App`].
pub struct Shared {
    foundation: Foundation,
    /// All unfinished episodes with clocks are recovered.
    pub(crate) ready: AtomicBool,
    pub(super) started_at: jiff::Timestamp,
    /// Random number of this run of the server.
    pub(super) boot: u64,
    pub(super) rates: Rates,
    pub(super) in_flight: Arc<InFlight>,
    pub(super) tokens: Tokens,
    pub(super) bodies: Bodies,
    pub(super) creations: Creations,
    pub(super) waits: Waits,
    /// Open rounds that were seen by a holder of several seats, counted. Each look locks it, so that rounds have the same
    /// order for all looks.
    pub(super) rounds_seen: Mutex<u64>,
    pub(super) heavy: Heavy,
    pub(super) streams: Arc<Streams>,
    /// Memory of large responses.
    pub(super) unsent: Answers,
    /// Pages of replays as they were written.
    pub(super) replay_pages: ReplayPages,
    pub(super) verifications: Verifications,
    pub(super) observation_cache: ObservationCache,
    pub(super) standings: Standings,
    /// Attempts of the entrants of competitions.
    pub(super) competitions: CompetitionStandings,
    /// Boards and lists.
    pub(super) answers: SharedCache<CachedResponse>,
    /// Boards of competitions, behind their pages.
    pub(super) rankings: Arc<SharedCache<Arc<Ranking>>>,
}

impl App {
    /// The time by which windows have closed, so that sealed games are opened to their entrants; in the far past while the time of
    /// day is in doubt, as what was opened cannot be closed again.
    pub(super) fn time_to_open(&self) -> Timestamp {
        if self.clock.doubt().is_some() { Timestamp::MIN } else { self.clock.wall() }
    }

    pub fn new(foundation: Foundation) -> Self {
        let Foundation { store, registry, clock, workers, limits, stop, .. } = &foundation;
        let mut boot = [0; 8];
        foundation.entropy.fill(&mut boot);
        let cache = (store.clone(), Arc::clone(clock));
        let eighth = (limits.memory_bytes_max / 8).min(CACHES_BYTES_MAX) as u64 / 8;
        Self(Arc::new(Shared {
            ready: AtomicBool::new(false),
            started_at: clock.wall(),
            boot: u64::from_le_bytes(boot),
            rates: Rates::new(limits, Arc::clone(clock)),
            in_flight: Arc::new(InFlight::new(limits.connections_per_address_max)),
            tokens: Tokens::new(store.clone()),
            bodies: Bodies::new(limits),
            creations: Creations::default(),
            waits: Waits::new(limits.waits_max, Arc::clone(clock), stop.clone()),
            rounds_seen: Mutex::new(0),
            heavy: Heavy::new(workers.clone(), limits),
            streams: Arc::new(Streams::new(registry.clone(), workers.clone(), limits)),
            unsent: Answers::new(registry.clone(), limits),
            replay_pages: ReplayPages::new(eighth),
            verifications: Verifications::new(VERIFICATIONS_MAX),
            observation_cache: ObservationCache::new(2 * eighth),
            standings: Standings::new(store.clone()),
            competitions: CompetitionStandings::new(store.clone(), 3 * eighth),
            answers: SharedCache::new(eighth, cache.clone()),
            rankings: Arc::new(SharedCache::new(eighth, cache)),
            foundation,
        }))
    }

    /// Reads all results, and what was played in competitions that are open, so that the first request for a board does not wait
    /// for that.
    pub async fn read_boards(&self) {
        let read = async {
            self.store.catch_up().await?;
            self.standings.boards().await?;
            self.read_open_competitions().await
        };
        if let Err(error) = read.await {
            // Requests get the same error.
            tracing::warn!(%error, "boards cannot be read");
        }
    }

    async fn read_open_competitions(&self) -> Result<(), StoreError> {
        let newest = competitions::list(&self.store, true, None, COMPETITIONS_READ_MAX).await?;
        for competition in newest.iter().filter(|competition| competition.revealed_at.is_none()) {
            if let Some((part, before)) = competition.part_shown_to_all(self.clock.wall()) {
                self.competitions.places(competition, part, before, None).await?;
            }
        }
        Ok(())
    }

    /// A new token of seats that this server plays.
    pub(super) fn token(&self, kind: TokenKind) -> Token {
        let name = self.forwarder.as_ref().and_then(|forwarder| forwarder.routing_name());
        Token::named(kind, name, &*self.entropy)
    }

    /// Evicts unused entries; to be called periodically.
    pub fn tidy(&self) {
        self.registry.evict_unused();
        self.rates.forget_idle();
    }

    /// Ends the rights of tokens that are revoked in the store: on all servers of the database, when this returns.
    pub(super) async fn revoked(
        &self,
        is_revoked: impl Fn(&Grant) -> bool,
    ) -> Result<(), ApiError> {
        self.tokens.forget(is_revoked);
        let Some(cluster) = self.store.cluster() else { return Ok(()) };
        let revision = cluster.announce().await?;
        let all_act_by_it = async {
            while !cluster.all_act_by(revision).await? {
                tokio::time::sleep(REVOCATION_PAUSE).await;
            }
            Ok(())
        };
        let waited = tokio::time::timeout(REVOCATION_PATIENCE, all_act_by_it).await;
        waited.unwrap_or(Err(StoreError::Away)).map_err(ApiError::from)
    }

    /// Ends the rights of a key that is revoked in the store, and of the tokens of competitions that its holder knew.
    pub(super) async fn key_revoked(&self, id: &str) -> Result<(), ApiError> {
        self.revoked(|grant| match grant {
            Grant::Key(key) => key.id == id,
            Grant::Run { .. } => true,
            Grant::Seat { .. } | Grant::Swarm { .. } => false,
        })
        .await
    }

    /// Forgets the rights of all tokens, as some were revoked on another server.
    pub(crate) fn forget_tokens(&self) {
        self.tokens.forget(|_| true);
    }

    /// Refuses what is new while the disk is nearly full.
    pub(super) fn check_disk(&self) -> Result<(), ApiError> {
        let least = self.limits.disk_free_percent_min;
        if self.disk.is_full(least) { Err(ApiError::disk_full(least)) } else { Ok(()) }
    }

    /// The episode with this id. The request waits while an unfinished one is recovered, up to a limit.
    pub(super) async fn episode(&self, id: &EpisodeId) -> Result<Handle, ApiError> {
        match self.registry.find_in_memory(id) {
            Some(handle) => Ok(handle),
            None => Box::pin(self.recovered(id)).await,
        }
    }

    async fn recovered(&self, id: &EpisodeId) -> Result<Handle, ApiError> {
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
                let _permit = self.heavy.replay().await?;
                find.await
            }
        };
        found?.ok_or_else(|| ApiError::not_found("the episode"))
    }

    /// The state after `round` rounds, which must be resolved; `near` is a state on the way to it.
    pub(super) async fn state_at(
        &self,
        handle: &Handle,
        round: u32,
        near: Option<&Arc<World>>,
    ) -> Result<Arc<World>, ApiError> {
        let keyframe = handle.keyframe(round);
        if keyframe.round() == round {
            return Ok(keyframe);
        }
        let _permit = self.heavy.replay().await?;
        Ok(state_at(self.registry.host(), handle, round, near).await?)
    }
}

impl Deref for Shared {
    type Target = Foundation;

    fn deref(&self) -> &Foundation {
        &self.foundation
    }
}

impl Deref for App {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}
