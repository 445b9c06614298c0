//! The manager of a server's runs: creates them, advances them as their games end, and ends them.
//!
//! No progress of a run is kept in memory. [`Runs::advance`] reads the run's state from the database and takes the next step: it
//! opens the next games of the plan, or ends the run. A repeated step changes nothing, so the server calls it whenever a step may
//! have been missed: at the end of a game, after a start, and in the sweep every minute.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard};

use futures::future::{BoxFuture, join_all};
use futures::{StreamExt, TryStreamExt as _};
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::UnboundedReceiverStream;
use tokio_util::sync::CancellationToken;

use super::definition::{self, Definition};
use super::{RunError, RunStatus, new_id};
use crate::episode::quota::{Full, Purpose};
use crate::episode::registry::{self, Creation, Registry};
use crate::episode::spec::Visibility;
use crate::episode::{Ending, Status};
use crate::fair::Party;
use crate::host::Disk;
use crate::ids::{
    EntryKey, EpisodeId, EpisodeKey, Numbers, Place, RoutingName, RunKey, Token, TokenHash,
    TokenKind,
};
use crate::store::entries::{Entry, RunRow};
use crate::store::games::StoredGame;
use crate::store::port::EpisodeStore as _;
use crate::store::runs::StoredRun;
use crate::store::{Store, StoreError};
use crate::telemetry::detached;
use swarmbench_boards::competition::definition::practice_suite;
use swarmbench_clock::{Clock, Entropy};
use swarmbench_protocol::run::RunHolder;
use swarmbench_protocol::suite::PlannedGame;

/// Number of locks. Runs with the same lock are advanced one after another.
const LOCKS: usize = 256;

const ADVANCED_AT_ONCE: usize = 64;

/// Maximum times that a game of a run is played again: a run reads all of its games at each step.
pub const GAME_REPEATS_MAX: usize = 20;

/// Random bytes in the opening of a sealed episode.
const SALT_BYTES: usize = 16;

#[derive(Clone, Debug)]
pub struct NewRun {
    /// Party whose quotas the run uses, with the key of the creator, if any.
    pub party: Party,
    /// Purpose under which the first game is admitted.
    pub purpose: Purpose,
    pub definition: Definition,
    /// Entry and number (from 1) of an attempt in a competition.
    pub attempt: Option<(EntryKey, u32)>,
    /// Voided attempt that the run repeats, if it uses spare seeds.
    pub replays: Option<u32>,
    /// Idempotency key, and hash of the body. The caller guarantees that no run has this key, and that no other request creates
    /// one with it meanwhile.
    pub idempotency: Option<(String, [u8; 32])>,
    /// Hash of the token of the request, which must have rights in the commit of the run.
    pub credential: Option<TokenHash>,
}

impl NewRun {
    /// A run that is no attempt in a competition, without an idempotency key.
    pub const fn by(party: Party, purpose: Purpose, definition: Definition) -> Self {
        Self {
            party,
            purpose,
            definition,
            attempt: None,
            replays: None,
            idempotency: None,
            credential: None,
        }
    }
}

#[derive(Clone, Debug, thiserror::Error)]
pub enum CreateError {
    #[error(transparent)]
    Full(#[from] Full),
    /// Percentage of the disk that has to be free.
    #[error("less than {0} % of the server's disk is free")]
    DiskFull(u32),
    #[error("the run cannot be played: {0}")]
    Definition(String),
    #[error(transparent)]
    Run(#[from] RunError),
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenGames {
    /// Games that have not ended, oldest first.
    pub open: Arc<[EpisodeId]>,
    /// The run and all its games have ended.
    pub is_over: bool,
}

/// Dependencies of the manager.
pub struct Parts {
    pub store: Store,
    pub registry: Registry,
    pub clock: Arc<dyn Clock>,
    pub entropy: Arc<dyn Entropy>,
    pub disk: Arc<dyn Disk>,
    /// Percentage of the disk that must be free to open a game.
    pub disk_free_percent_min: u32,
    /// Cancelled when the server stops: no more games open.
    pub stop: CancellationToken,
    /// Source of the numbers of new runs.
    pub numbers: Numbers,
    /// The other servers of the cluster, if there is one.
    pub peers: Option<Arc<dyn Peers>>,
}

/// The other servers of a cluster, each of which owns some of the runs.
pub trait Peers: Send + Sync {
    /// Forwards [`Runs::advance`] to the server that owns the run, or takes it.
    fn advance(&self, run: RunKey) -> BoxFuture<'_, Result<(), RunError>>;

    /// Forwards [`Runs::end_with`], without audit entries, to the server that owns the run, or takes it.
    fn end(&self, run: RunKey, status: RunStatus) -> BoxFuture<'_, Result<bool, RunError>>;

    /// Name for load balancers of the server that owns the run, or will take it.
    fn routing_name(&self, run: RunKey) -> BoxFuture<'_, Option<RoutingName>>;
}

/// The runs of a server. Clones share them.
#[derive(Clone)]
pub struct Runs(Arc<Shared>);

struct Shared {
    parts: Parts,
    locks: [tokio::sync::Mutex<()>; LOCKS],
    /// Lock of entries (readers) against reveals (writer) of competitions.
    entering: tokio::sync::RwLock<()>,
    open_games: Mutex<HashMap<RunKey, watch::Sender<OpenGames>>>,
    /// Parties of unfinished runs without a key that were created since the start.
    keyless: Mutex<HashMap<RunKey, Party>>,
    /// Caps for which runs wait to open a game.
    waiting: Mutex<HashMap<RunKey, Full>>,
}

/// Lock on a run: while it lives, this server does nothing with the run.
pub struct Held<'l> {
    _lock: Arc<tokio::sync::MutexGuard<'l, ()>>,
}

/// Tokens of a run, each with the number of its holder in the run's team; `None` where one player has all seats.
pub type RunTokens = Vec<(Option<u32>, Token)>;

/// Holders of a run that get tokens: those that the server does not play.
pub fn token_holders(definition: &Definition) -> Vec<Option<u32>> {
    if !definition.is_team() {
        return definition.player.as_ref().map_or_else(|| vec![None], |_| Vec::new());
    }
    let numbered = (1..).zip(&definition.holders);
    numbered.filter(|(_, holder)| holder.player.is_none()).map(|(number, _)| Some(number)).collect()
}

fn replacements(run: RunKey, tokens: &RunTokens) -> impl Iterator<Item = Entry> {
    let hashes: Vec<_> = tokens.iter().map(|(holder, token)| (*holder, token.hash())).collect();
    hashes.into_iter().map(move |(holder, hash)| Entry::ReplaceRunToken { run, holder, hash })
}

fn lock_of(run: RunKey) -> usize {
    // Low bits of numbers from several servers are mostly alike.
    usize::try_from(run.0 ^ (run.0 >> 22)).unwrap_or(0) % LOCKS
}

impl Runs {
    pub fn new(parts: Parts) -> Self {
        Self(Arc::new(Shared {
            parts,
            locks: std::array::from_fn(|_| tokio::sync::Mutex::new(())),
            entering: tokio::sync::RwLock::default(),
            open_games: Mutex::default(),
            keyless: Mutex::default(),
            waiting: Mutex::default(),
        }))
    }

    fn keyless(&self) -> MutexGuard<'_, HashMap<RunKey, Party>> {
        self.0.keyless.lock().expect("nothing panics while it holds this")
    }

    fn waiting(&self) -> MutexGuard<'_, HashMap<RunKey, Full>> {
        self.0.waiting.lock().expect("nothing panics while it holds this")
    }

    /// Cap that keeps a run from opening as many games as it may, if any.
    pub fn waits_for(&self, run: RunKey) -> Option<Full> {
        self.waiting().get(&run).copied()
    }

    /// Party whose quota a run uses.
    async fn party(&self, stored: &StoredRun) -> Result<Party, RunError> {
        let keyless = self.keyless().get(&stored.run).copied();
        if let Some(party) = keyless {
            return Ok(party);
        }
        let entrant = self.0.parts.store.entrant(stored.run).await?;
        let party = entrant.map(|(competition, owner)| Party::entrant(competition, owner));
        Ok(party.unwrap_or_else(|| Party::of_key(stored.owner)))
    }

    fn open_games(&self) -> MutexGuard<'_, HashMap<RunKey, watch::Sender<OpenGames>>> {
        self.0.open_games.lock().expect("nothing panics while it holds this")
    }

    async fn lock(&self, run: RunKey) -> tokio::sync::MutexGuard<'_, ()> {
        self.0.locks[lock_of(run)].lock().await
    }

    /// Blocks reveals of competitions while the guard lives. A caller that reads the clock and then enters a competition, or
    /// starts an attempt in it, holds the guard throughout.
    pub async fn block_reveal(&self) -> tokio::sync::RwLockReadGuard<'_, ()> {
        self.0.entering.read().await
    }

    /// Blocks entries to competitions while the guard lives.
    pub(crate) async fn block_entries(&self) -> tokio::sync::RwLockWriteGuard<'_, ()> {
        self.0.entering.write().await
    }

    /// Creates a run, durably, and opens its first games. The tokens are to be shown once; a run that the server itself plays has
    /// none.
    pub async fn create(&self, new: NewRun) -> Result<(StoredRun, RunTokens), CreateError> {
        let Parts { store, registry, clock, entropy, disk, .. } = &self.0.parts;
        let NewRun { party, purpose, definition, attempt, replays, idempotency, credential } = new;
        let owner = party.owner();
        let least = self.0.parts.disk_free_percent_min;
        if disk.is_full(least) {
            return Err(CreateError::DiskFull(least));
        }
        registry.check_room(party, purpose)?;
        let now = clock.wall();
        let id = new_id(now, &**entropy);
        for game in definition.suite.plan() {
            definition::spec(&definition, &id, &game, None).map_err(CreateError::Definition)?;
        }
        let unknown = || CreateError::Definition(format!("visibility {:?}", definition.visibility));
        let visibility = Visibility::parse(&definition.visibility).ok_or_else(unknown)?;
        let run = RunKey(self.0.parts.numbers.take(1, now));
        let tokens = self.new_tokens(run, token_holders(&definition)).await;
        let text = serde_json::to_string(&definition).expect("a definition has string keys");
        let row = RunRow {
            run,
            id: id.clone(),
            owner,
            suite: definition.suite.name.clone(),
            digest: definition.suite.digest(),
            definition: text,
            model: definition.model.clone(),
            visibility: visibility.name(),
            attempt,
            replays,
            closes_at: attempt.and(definition.closes_at),
            at: now,
            idempotency,
        };
        let check = credential.map(Entry::CheckToken);
        let opened = check.into_iter().chain([Entry::OpenRun(Box::new(row))]);
        let entries = opened.chain(replacements(run, &tokens)).collect();
        store.keep(entries).await.map_err(RunError::from)?;
        if owner.is_none() {
            self.keyless().insert(run, party);
        }
        tracing::info!(run = %id, suite = &*definition.suite.name, model = &*definition.model, "created");
        metrics::counter!("swarmbench_runs_created_total").increment(1);
        // The sweep of every minute repeats a failed step.
        self.try_advance(run).await;
        Ok((self.stored(run).await?, tokens))
    }

    /// Takes the next step of a run: opens the next games of the plan, or ends the run when all have ended. May be called at any
    /// time and any number of times. Where no other game is admitted, the run waits for the next call.
    pub async fn advance(&self, run: RunKey) -> Result<(), RunError> {
        let runs = self.clone();
        detached(async move {
            match runs.elsewhere(run).await? {
                Some(peers) => peers.advance(run).await,
                None => runs.advance_now(run).await,
            }
        })
        .await
    }

    /// The other servers, if one of them owns the run, or takes a run without an owner.
    async fn elsewhere(&self, run: RunKey) -> Result<Option<&dyn Peers>, RunError> {
        let Parts { store, peers, .. } = &self.0.parts;
        let Some(peers) = peers else { return Ok(None) };
        let is_here = store.owns_or_takes(Place::Run(run)).await?;
        Ok((!is_here).then_some(&**peers))
    }

    /// Fails where another server owns the run. Takes a run without an owner.
    async fn check_here(&self, run: RunKey) -> Result<(), RunError> {
        if self.0.parts.store.take_place(Place::Run(run)).await? {
            Ok(())
        } else {
            Err(StoreError::Elsewhere.into())
        }
    }

    /// Handles [`Peers::advance`] of another server.
    pub async fn advance_here(&self, run: RunKey) -> Result<(), RunError> {
        self.check_here(run).await?;
        let runs = self.clone();
        detached(async move { runs.advance_now(run).await }).await
    }

    /// Handles [`Peers::end`] of another server.
    pub async fn end_here(&self, run: RunKey, status: RunStatus) -> Result<bool, RunError> {
        self.check_here(run).await?;
        self.end_now(run, status, Vec::new()).await
    }

    /// Locks runs, so that this server does nothing with them while the guards live. Runs with subscribers, or with a busy lock,
    /// are left out.
    pub fn hold(&self, runs: &[RunKey]) -> HashMap<RunKey, Held<'_>> {
        let mut held = HashMap::new();
        let mut locks = BTreeMap::new();
        for run in runs {
            if self.open_games().get(run).is_some_and(|games| games.receiver_count() > 0) {
                continue;
            }
            let number = lock_of(*run);
            if let std::collections::btree_map::Entry::Vacant(free) = locks.entry(number) {
                let Ok(guard) = self.0.locks[number].try_lock() else { continue };
                free.insert(Arc::new(guard));
            }
            held.insert(*run, Held { _lock: Arc::clone(&locks[&number]) });
        }
        held
    }

    /// Ends a run: `Aborted` ends its open games, too; with any other status they continue to their end. No more games open. A run
    /// that has ended stays as it is.
    pub async fn end(&self, run: RunKey, status: RunStatus) -> Result<(), RunError> {
        self.end_with(run, status, Vec::new()).await.map(|_| ())
    }

    /// Ends a run like [`Runs::end`], and stores audit entries in the same transaction. Returns false, and stores nothing, where
    /// the run had ended before. Where another server owns the run, the entries are stored first in any case, and the result is
    /// always true.
    pub async fn end_with(
        &self,
        run: RunKey,
        status: RunStatus,
        audit_entries: Vec<Entry>,
    ) -> Result<bool, RunError> {
        if let Some(peers) = self.elsewhere(run).await? {
            if !audit_entries.is_empty() {
                self.0.parts.store.keep(audit_entries).await?;
            }
            peers.end(run, status).await?;
            // The audit entries are stored.
            return Ok(true);
        }
        self.end_now(run, status, audit_entries).await
    }

    /// Ends runs. `audit_entries` are committed together with the ends of the runs that this server owns: see [`Runs::end`].
    pub async fn end_all(
        &self,
        runs: &[RunKey],
        status: RunStatus,
        mut entries: Vec<Entry>,
    ) -> Result<(), RunError> {
        let Parts { store, clock, .. } = &self.0.parts;
        let at = clock.wall();
        for run in runs {
            if self.elsewhere(*run).await?.is_none() {
                entries.push(Entry::EndRun { run: *run, status: status.name(), at });
            }
        }
        store.keep(entries).await?;
        let ended = futures::stream::iter(runs.to_vec()).map(|run| self.end(run, status));
        ended.buffer_unordered(ADVANCED_AT_ONCE).try_collect().await
    }

    async fn end_now(
        &self,
        run: RunKey,
        status: RunStatus,
        audit_entries: Vec<Entry>,
    ) -> Result<bool, RunError> {
        let runs = self.clone();
        detached(async move {
            let _guard = runs.lock(run).await;
            let stored = runs.stored(run).await?;
            let ends = stored.ended_at.is_none();
            if ends {
                runs.keep_end(&stored, status, audit_entries).await?;
            }
            runs.settle(run).await?;
            Ok(ends)
        })
        .await
    }

    /// Voids an ended game of a run, and opens the same game again. A finished run continues. A voided game stays as it is.
    pub async fn repeat(
        &self,
        run: RunKey,
        episode: EpisodeKey,
        reason: &str,
        audit: Option<Entry>,
    ) -> Result<(), RunError> {
        let Parts { store, clock, .. } = &self.0.parts;
        {
            let _guard = self.lock(run).await;
            let games = store.games_of(run).await?;
            let game = games.iter().find(|game| game.episode == episode);
            let game = game.ok_or(RunError::GameOpen)?;
            if !game.counts() {
                return Ok(());
            }
            let status = self.stored(run).await?.status;
            if ![RunStatus::Running, RunStatus::Finished].map(RunStatus::name).contains(&&*status) {
                return Err(RunError::Over(status));
            }
            if !game.is_over() {
                return Err(RunError::GameOpen);
            }
            if games.iter().filter(|other| other.slot == game.slot).count() > GAME_REPEATS_MAX {
                return Err(RunError::RepeatedOften);
            }
            let reason = format!("played again: {reason}");
            // The run continues in the commit in which the game stops to count, so that nobody finds it finished without.
            let entries = [
                Entry::VoidEpisode { episode, reason, at: clock.wall() },
                Entry::ReopenRun { run },
            ];
            store.keep(entries.into_iter().chain(audit).collect()).await?;
        }
        self.advance(run).await
    }

    async fn new_tokens(&self, run: RunKey, holders: Vec<Option<u32>>) -> RunTokens {
        let Parts { entropy, peers, .. } = &self.0.parts;
        let name = match peers {
            Some(peers) => peers.routing_name(run).await,
            None => None,
        };
        let token = || Token::named(TokenKind::Swarm, name, &**entropy);
        holders.into_iter().map(|holder| (holder, token())).collect()
    }

    /// Replaces tokens of a run, after other entries of the same transaction.
    pub async fn replace_tokens(
        &self,
        run: RunKey,
        holders: Vec<Option<u32>>,
        mut entries: Vec<Entry>,
    ) -> Result<RunTokens, RunError> {
        let tokens = self.new_tokens(run, holders).await;
        entries.extend(replacements(run, &tokens));
        self.0.parts.store.keep(entries).await?;
        Ok(tokens)
    }

    pub async fn follow(&self, run: RunKey) -> Result<watch::Receiver<OpenGames>, RunError> {
        if let Some(games) = self.open_games().get(&run) {
            return Ok(games.subscribe());
        }
        if self.stored(run).await?.ended_at.is_none() {
            self.check_here(run).await?;
        }
        // The lock keeps games from opening or ending between the read and the subscription.
        let _guard = self.lock(run).await;
        let games = self.games(run).await?;
        Ok(self.open_games().entry(run).or_insert_with(|| watch::Sender::new(games)).subscribe())
    }

    /// Advances runs whenever one of their games has ended; never returns.
    pub async fn advance_ended(&self, ended: mpsc::UnboundedReceiver<RunKey>) {
        let ended = UnboundedReceiverStream::new(ended);
        ended.for_each_concurrent(ADVANCED_AT_ONCE, |run| self.try_advance(run)).await;
    }

    /// Advances all unfinished runs of this server: after a start, and regularly, as some may wait to open a game.
    pub async fn advance_all(&self) -> Result<usize, RunError> {
        self.open_games().retain(|_, games| games.receiver_count() > 0);
        let store = &self.0.parts.store;
        let mut all = store.unfinished_runs().await?;
        if let Some(cluster) = store.cluster() {
            all.retain(|run| cluster.places().has(Place::Run(*run)));
        }
        let count = all.len();
        let all = futures::stream::iter(all);
        all.for_each_concurrent(ADVANCED_AT_ONCE, |run| self.try_advance(run)).await;
        Ok(count)
    }

    /// Advances a run. An error is logged, as the step is repeated later.
    pub async fn try_advance(&self, run: RunKey) {
        if let Err(error) = self.advance(run).await
            // The next start does what is left.
            && !self.0.parts.stop.is_cancelled()
        {
            tracing::error!(%error, run = run.0, "a run cannot be advanced");
        }
    }

    async fn advance_now(&self, run: RunKey) -> Result<(), RunError> {
        let _guard = self.lock(run).await;
        let cluster = self.0.parts.store.cluster();
        if !cluster.is_none_or(|cluster| cluster.places().has(Place::Run(run))) {
            // Another server got the run while this task waited for the lock.
            return Err(StoreError::Elsewhere.into());
        }
        let stored = self.stored(run).await?;
        let done =
            if stored.ended_at.is_none() { self.take_due_step(&stored).await } else { Ok(()) };
        self.settle(run).await.and(done)
    }

    async fn take_due_step(&self, stored: &StoredRun) -> Result<(), RunError> {
        let Parts { store, clock, .. } = &self.0.parts;
        let definition = definition::read(stored)?;
        let games = store.games_of(stored.run).await?;
        let now = clock.wall();
        if definition.closes_at.is_some_and(|at| at <= now) && clock.doubt().is_some() {
            // The window may still be open: the run waits until the time of day is certain.
            return Ok(());
        }
        let is_practice = definition.suite.name.starts_with(&practice_suite(""));
        if (stored.attempt.is_some() || is_practice) && store.is_excluded(stored.run).await? {
            return self.keep_end(stored, RunStatus::Aborted, Vec::new()).await;
        }
        match due(&definition, &games, now) {
            // A withdrawn entrant opens no games: others get its share. The run continues once the entrant is readmitted.
            Due::Open(_) if self.has_withdrawn(stored).await? => Ok(()),
            Due::Open(due) => {
                let is_playing = games.iter().any(|game| game.counts() && !game.is_over());
                let purpose = if is_playing { Purpose::Usual } else { Purpose::NextGame };
                self.open(stored, &definition, due, purpose).await
            }
            Due::Nothing => Ok(()),
            Due::End(status) => self.keep_end(stored, status, Vec::new()).await,
        }
    }

    async fn has_withdrawn(&self, stored: &StoredRun) -> Result<bool, RunError> {
        let Some((entry, _)) = stored.attempt else { return Ok(false) };
        Ok(!self.0.parts.store.is_active(entry).await?)
    }

    /// Opens games until one is not admitted. The first is opened for `purpose`.
    async fn open(
        &self,
        stored: &StoredRun,
        definition: &Definition,
        games: Vec<PlannedGame>,
        mut purpose: Purpose,
    ) -> Result<(), RunError> {
        let Parts { registry, clock, entropy, disk, .. } = &self.0.parts;
        let party = self.party(stored).await?;
        self.waiting().remove(&stored.run);
        for game in games {
            let parts = &self.0.parts;
            if disk.is_full(parts.disk_free_percent_min) || parts.stop.is_cancelled() {
                break;
            }
            let salt = (definition.visibility == Visibility::Sealed.name()).then(|| {
                let mut bytes = [0; SALT_BYTES];
                entropy.fill(&mut bytes);
                data_encoding::HEXLOWER.encode(&bytes)
            });
            let spec =
                definition::spec(definition, &stored.id, &game, salt).map_err(RunError::Game)?;
            let creation = Creation {
                id: EpisodeId::new(clock.wall(), &**entropy),
                party,
                purpose: std::mem::replace(&mut purpose, Purpose::Usual),
                run: Some((stored.run, game.slot)),
                spec,
                holder_metas: definition
                    .holders
                    .iter()
                    .map(RunHolder::agent_meta_of_seats)
                    .collect(),
                tokens: Vec::new(),
                idempotency: None,
            };
            match registry.create(creation).await {
                Ok(_) => {}
                // The next call may succeed, or end the run if its window has just closed.
                Err(registry::CreateError::Full(full)) => {
                    self.waiting().insert(stored.run, full);
                    break;
                }
                Err(
                    registry::CreateError::NoMemory(_)
                    | registry::CreateError::Closed(_)
                    | registry::CreateError::Work(_),
                ) => break,
                Err(registry::CreateError::Journal(error)) => return Err(error.into()),
            }
        }
        Ok(())
    }

    async fn keep_end(
        &self,
        stored: &StoredRun,
        status: RunStatus,
        audit_entries: Vec<Entry>,
    ) -> Result<(), RunError> {
        let Parts { store, clock, .. } = &self.0.parts;
        let status = status.name();
        let entry = Entry::EndRun { run: stored.run, status, at: clock.wall() };
        store.keep([entry].into_iter().chain(audit_entries).collect()).await?;
        self.keyless().remove(&stored.run);
        self.waiting().remove(&stored.run);
        metrics::counter!("swarmbench_runs_ended_total", "status" => status).increment(1);
        tracing::info!(run = %stored.id, status, "ended");
        Ok(())
    }

    async fn stored(&self, run: RunKey) -> Result<StoredRun, RunError> {
        self.0.parts.store.run(run).await?.ok_or(RunError::Missing(run))
    }

    /// Ends open games that must not be open: those of an aborted run, and those that no longer count. Then notifies the
    /// subscribers of the run.
    async fn settle(&self, run: RunKey) -> Result<(), RunError> {
        let Parts { store, registry, .. } = &self.0.parts;
        let is_aborted = self.stored(run).await?.status == RunStatus::Aborted.name();
        let mut games = store.games_of(run).await?;
        games.retain(|game| !game.is_over() && (is_aborted || !game.counts()));
        let ended = games.iter().map(async |game| {
            let ended = match registry.find(&game.id).await {
                Ok(Some(handle)) => handle.abort().await.map_err(|error| error.to_string()),
                Ok(None) => Ok(()),
                Err(error) => Err(error.to_string()),
            };
            if let Err(error) = ended {
                // The other games are still ended.
                tracing::error!(episode = %game.id, error, "a game cannot be ended");
            }
        });
        join_all(ended).await;
        if !self.open_games().contains_key(&run) {
            return Ok(());
        }
        let games = self.games(run).await?;
        if let Some(sender) = self.open_games().get(&run) {
            sender.send_if_modified(|now| std::mem::replace(now, games.clone()) != games);
        }
        Ok(())
    }

    async fn games(&self, run: RunKey) -> Result<OpenGames, RunError> {
        let has_ended = self.stored(run).await?.ended_at.is_some();
        let mut games = self.0.parts.store.games_of(run).await?;
        games.retain(|game| !game.is_over() && game.counts());
        games.sort_by_key(|game| game.episode);
        let is_over = has_ended && games.is_empty();
        Ok(OpenGames { open: games.into_iter().map(|game| game.id).collect(), is_over })
    }
}

/// Next step of an unfinished run.
#[derive(Debug, PartialEq, Eq)]
enum Due {
    Open(Vec<PlannedGame>),
    /// Wait for the open games.
    Nothing,
    /// Nothing is left to play.
    End(RunStatus),
}

/// Next step of a run, from the games that were opened so far.
fn due(definition: &Definition, games: &[StoredGame], now: jiff::Timestamp) -> Due {
    let counted = games.iter().filter(|game| game.counts());
    let by_slot: BTreeMap<u32, &StoredGame> = counted.map(|game| (game.slot, game)).collect();
    let open = by_slot.values().filter(|game| !game.is_over()).count();
    let mut left = definition.suite.plan();
    left.retain(|game| !by_slot.contains_key(&game.slot));
    let has_game = |is: &dyn Fn(&StoredGame) -> bool| by_slot.values().any(|game| is(game));
    let is_cut = |game: &StoredGame| game.reason.as_deref() == Some(Ending::Closed.name());
    // The time of day may have been set back since a game closed: its attempt has closed, too.
    let cut = by_slot.values().filter(|game| is_cut(game)).filter_map(|game| game.ended_at);
    let now = cut.fold(now, jiff::Timestamp::max);
    let is_closed = definition.closes_at.is_some_and(|at| at <= now);
    let ending = match () {
        // A player that stopped would not play the next games either.
        () if has_game(&|game| game.status == Status::Abandoned.name()) => {
            Some(RunStatus::Abandoned)
        }
        // A game that closed before its window was extended is one that was played.
        () if is_closed && has_game(&|game| is_cut(game)) => Some(RunStatus::Closed),
        () if left.is_empty() => Some(RunStatus::Finished),
        () if is_closed => Some(RunStatus::Closed),
        () => None,
    };
    match ending {
        Some(status) if open == 0 => Due::End(status),
        Some(_) => Due::Nothing,
        None => {
            let places = (definition.parallel as usize).saturating_sub(open);
            left.truncate(places);
            if left.is_empty() { Due::Nothing } else { Due::Open(left) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::EpisodeKey;
    use swarmbench_journal::Tally;
    use swarmbench_protocol::carried::Carried;
    use swarmbench_protocol::suite::Suite;

    fn definition(parallel: u32) -> Definition {
        Definition {
            suite: Suite::built_in("quick", "paper").expect("a suite"),
            model: "a model".to_owned(),
            temperature: None,
            top_p: None,
            meta: Carried::default(),
            prompt_template: None,
            prompt_revision: swarmbench_prompt::REVISION,
            player: None,
            holders: Vec::new(),
            parallel,
            visibility: "public".to_owned(),
            idle_timeout_ms: 1000,
            closes_at: None,
            own_games: false,
        }
    }

    /// Games by slot, status, reason and whether they were voided.
    fn games(rows: &[(u32, &str, &str, bool)]) -> Vec<StoredGame> {
        let game = |(number, &(slot, status, reason, voided)): (i64, &(u32, &str, &str, bool))| {
            let ended = (status != "running").then_some(jiff::Timestamp::UNIX_EPOCH);
            StoredGame {
                episode: EpisodeKey(number),
                id: EpisodeId::from_text(format!("ep_{number}")),
                slot,
                status: status.to_owned(),
                reason: ended.map(|_| reason.to_owned()),
                score: 0.0,
                rounds: 0,
                tally: Tally::default(),
                void_reason: voided.then(|| "power cut".to_owned()),
                ended_at: ended,
            }
        };
        (0..).zip(rows).map(game).collect()
    }

    /// Next step in short: the slots to open, or the status with which the run ends.
    fn due_in_short(definition: &Definition, rows: &[(u32, &str, &str, bool)]) -> String {
        match due(definition, &games(rows), jiff::Timestamp::UNIX_EPOCH) {
            Due::Open(games) => {
                let slots: Vec<_> = games.iter().map(|game| game.slot.to_string()).collect();
                slots.join(" ")
            }
            Due::Nothing => "nothing".to_owned(),
            Due::End(status) => status.name().to_owned(),
        }
    }

    const RUNNING: (&str, &str, bool) = ("running", "", false);
    const DONE: (&str, &str, bool) = ("finished", "task_done", false);
    const ABORTED: (&str, &str, bool) = ("aborted", "aborted", false);
    const IDLE: (&str, &str, bool) = ("abandoned", "idle", false);
    const CLOSED: (&str, &str, bool) = ("aborted", "closed", false);
    const VOIDED: (&str, &str, bool) = ("aborted", "aborted", true);
    const VOIDED_IDLE: (&str, &str, bool) = ("abandoned", "idle", true);
    const VOIDED_RUNNING: (&str, &str, bool) = ("running", "", true);

    #[test]
    fn games_are_opened_in_order_up_to_the_parallel_limit() {
        let at = |slot, (status, reason, voided): (&'static str, &'static str, bool)| {
            (slot, status, reason, voided)
        };
        let two = definition(2);
        for (rows, expected) in [
            (vec![], "0 1"),
            (vec![at(0, RUNNING)], "1"),
            (vec![at(0, RUNNING), at(1, RUNNING)], "nothing"),
            (vec![at(0, DONE), at(1, RUNNING)], "2"),
            (vec![at(0, DONE), at(1, ABORTED)], "2 3"),
            // A voided game is played again, and does not count as open.
            (vec![at(0, VOIDED), at(1, RUNNING)], "0"),
            (vec![at(0, VOIDED), at(0, RUNNING), at(1, RUNNING)], "nothing"),
            (vec![at(0, VOIDED_RUNNING), at(1, DONE)], "0 2"),
            (vec![at(0, VOIDED_IDLE), at(1, DONE)], "0 2"),
            // Nobody plays any more: what is open ends first.
            (vec![at(0, IDLE), at(1, RUNNING)], "nothing"),
            (vec![at(0, IDLE), at(1, DONE)], "abandoned"),
            ((0..5).map(|slot| at(slot, IDLE)).collect(), "abandoned"),
            ((0..5).map(|slot| at(slot, DONE)).collect(), "finished"),
            ((0..5).map(|slot| at(slot, ABORTED)).collect(), "finished"),
            // The game closed before the window was extended.
            (vec![at(0, CLOSED), at(1, RUNNING)], "2"),
            (vec![at(4, RUNNING), at(3, DONE), at(0, DONE), at(1, DONE), at(2, DONE)], "nothing"),
        ] {
            assert_eq!(due_in_short(&two, &rows), expected, "{rows:?}");
        }
        let mut closed = definition(2);
        closed.closes_at = Some(jiff::Timestamp::UNIX_EPOCH);
        assert_eq!(due_in_short(&closed, &[]), "closed");
        assert_eq!(due_in_short(&closed, &[at(0, RUNNING)]), "nothing");
        assert_eq!(due_in_short(&closed, &[at(0, CLOSED), at(1, RUNNING)]), "nothing");
        assert_eq!(due_in_short(&closed, &[at(0, CLOSED), at(1, DONE)]), "closed");
        let all: Vec<_> = (0..5).map(|slot| at(slot, CLOSED)).collect();
        assert_eq!(due_in_short(&closed, &all), "closed");
        let set_back = jiff::Timestamp::UNIX_EPOCH - jiff::SignedDuration::from_secs(1);
        assert_eq!(due(&closed, &games(&all), set_back), Due::End(RunStatus::Closed));
        closed.closes_at = Some(jiff::Timestamp::UNIX_EPOCH + jiff::SignedDuration::from_secs(1));
        assert_eq!(due_in_short(&closed, &all), "finished", "the window was extended");
    }
}
