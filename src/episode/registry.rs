//! All episodes of a server: creates them, finds them, takes them up from the journal on first use,
//! and lets go of those that nobody asks for.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use futures::future::select;
use jiff::Timestamp;
use swarmbench_engine::World;
use tokio::sync::{OnceCell, mpsc, oneshot};
use tokio_util::sync::CancellationToken;

use super::actor::{Fresh, Handle, Host, Keyframes, Spawn, seated, spawn};
use super::heavy::{is_heavy, off_thread};
use super::lockstep::{Lockstep, Standing};
use super::quota::{Full, Quotas};
use super::recovery::{RecoveryError, clocks, described, recover};
use super::seating::Seating;
use super::spec::Spec;
use crate::clock::{Clock, after};
use crate::ids::EpisodeId;
use crate::journal::chain::Head;
use crate::journal::record::RawRecord;
use crate::journal::{
    ClaimRow, Entry, EpisodeKey, Holder, Journal, JournalError, OpeningRow, RunKey, SeatingRow,
    Tally, TokenRow, Unfinished,
};
use crate::keys::OwnerKey;

/// How long an episode that nobody asks for stays in memory.
const UNUSED_STAYS: Duration = Duration::from_mins(5);

/// How long an episode whose actor has ended by a fault is left alone before it is recovered once more:
/// what has failed at once may fail at once again.
const REVIVED_AFTER: Duration = Duration::from_secs(1);

/// How long whoever takes up an episode whose time is over waits for its end.
const END_PATIENCE: Duration = Duration::from_secs(5);

/// What belongs to a new episode beside its description.
pub struct Creation {
    /// Its public id.
    pub id: EpisodeId,
    /// The key with which it is created, if any.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, and which game of the run's plan it is.
    pub run: Option<(RunKey, u32)>,
    /// What it is.
    pub spec: Spec,
    /// Its tokens.
    pub tokens: Vec<TokenRow>,
    /// The key by which a repeated creation finds it, and the hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// Why an episode was not created.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CreateError {
    /// There are as many as there may be.
    #[error(transparent)]
    Full(#[from] Full),
    /// The time in which its rounds may begin is over.
    #[error("no round begins here after {0}")]
    Closed(Timestamp),
    /// It could not be kept.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

/// All episodes of a server. Cloning shares them.
#[derive(Clone)]
pub struct Registry {
    host: Host,
    slots: Arc<Mutex<HashMap<EpisodeId, Slot>>>,
    next_key: Arc<AtomicI64>,
    ended: Arc<Mutex<Option<mpsc::UnboundedReceiver<RunKey>>>>,
    hosted: Arc<Mutex<Option<mpsc::UnboundedReceiver<Handle>>>>,
}

/// The place of an episode: of all that have not ended, and of those that somebody asked for lately.
struct Slot {
    /// Empty as long as the episode is not in memory.
    handle: Arc<OnceCell<Handle>>,
    used_at: Timestamp,
    /// When an episode that has not ended and is not in memory has to be taken up, if nobody asks
    /// for it earlier: then it is abandoned, or closed.
    ends_at: Option<Timestamp>,
    /// Whether it goes on though nobody asks: then it is taken up whenever it is not in memory.
    clocked: bool,
    /// The actor that was let go of. It may still have something to do, and an episode never has
    /// two of them.
    leaving: Option<CancellationToken>,
    /// When it was last emptied as its actor had ended by a fault.
    revived_at: Option<Timestamp>,
}

impl Slot {
    fn empty(now: Timestamp) -> Self {
        Self {
            handle: Arc::default(),
            used_at: now,
            ends_at: None,
            clocked: false,
            leaving: None,
            revived_at: None,
        }
    }

    /// Empties the place where the actor has ended though the episode has not, so that whoever comes next
    /// recovers the episode. Others may still hold the dead handle: nothing is done through it.
    fn empty_if_dead(&mut self, now: Timestamp) {
        let is_early = self.revived_at.is_some_and(|at| after(at, REVIVED_AFTER) > now);
        let Some(handle) = self.handle.get().filter(|handle| handle.is_dead() && !is_early) else {
            return;
        };
        tracing::warn!(episode = %handle.id, "its actor has ended: it is recovered from the journal");
        metrics::counter!("swarmbench_episodes_revived_total").increment(1);
        self.ends_at = Some(now);
        self.clocked = handle.spec.goes_on_alone();
        self.leaving = Some(handle.gone());
        self.revived_at = Some(now);
        self.handle = Arc::default();
    }

    /// Whether anybody holds the episode, or is about to.
    fn is_held(&self) -> bool {
        Arc::strong_count(&self.handle) > 1 || self.handle.get().is_some_and(Handle::is_shared)
    }
}

impl Registry {
    /// The registry over a journal whose newest episode has the number `last_key`.
    #[must_use]
    pub fn new(
        journal: Arc<dyn Journal>,
        clock: Arc<dyn Clock>,
        quotas: Arc<Quotas>,
        spawn: Spawn,
        last_key: i64,
    ) -> Self {
        let (tell, ended) = mpsc::unbounded_channel();
        let (host, hosted) = mpsc::unbounded_channel();
        Self {
            host: Host { journal, clock, spawn, quotas, ended: tell, hosted: host },
            slots: Arc::default(),
            next_key: Arc::new(AtomicI64::new(last_key + 1)),
            ended: Arc::new(Mutex::new(Some(ended))),
            hosted: Arc::new(Mutex::new(Some(hosted))),
        }
    }

    /// Where it is told that an episode of a run has ended, durably; whoever comes first hears it.
    #[must_use]
    pub fn take_ended(&self) -> Option<mpsc::UnboundedReceiver<RunKey>> {
        self.ended.lock().expect("nothing panics while it holds this").take()
    }

    /// Where every episode comes that is taken up and of which the server may play seats; whoever comes
    /// first plays them. Until then such episodes are held.
    #[must_use]
    pub fn take_hosted(&self) -> Option<mpsc::UnboundedReceiver<Handle>> {
        self.hosted.lock().expect("nothing panics while it holds this").take()
    }

    /// The journal from which states of earlier rounds are recomputed.
    #[must_use]
    pub fn journal(&self) -> &Arc<dyn Journal> {
        &self.host.journal
    }

    /// How many episodes have not ended.
    #[must_use]
    pub fn unfinished(&self) -> usize {
        self.host.quotas.unfinished()
    }

    /// How many episodes are in memory.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        self.slots().values().filter(|slot| slot.handle.initialized()).count()
    }

    fn slots(&self) -> MutexGuard<'_, HashMap<EpisodeId, Slot>> {
        self.slots.lock().expect("nothing panics while it holds this")
    }

    /// Whether there is a place for a new episode of this key now.
    ///
    /// # Errors
    /// The cap that was reached.
    pub fn check_room(&self, owner: Option<OwnerKey>) -> Result<(), Full> {
        self.host.quotas.check(owner)
    }

    /// Creates an episode; it is durable when this returns.
    ///
    /// # Errors
    /// Where there are too many, or it could not be kept.
    pub async fn create(&self, creation: Creation) -> Result<Handle, CreateError> {
        // In a task of its own: whoever asked may go half-way, and what was begun is ended.
        let (done, created) = oneshot::channel();
        let registry = self.clone();
        (self.host.spawn)(Box::pin(async move {
            drop(done.send(registry.create_now(creation).await));
        }));
        let stopping = || Err(JournalError("the server is stopping".into()).into());
        created.await.unwrap_or_else(|_| stopping())
    }

    async fn create_now(&self, creation: Creation) -> Result<Handle, CreateError> {
        let key = EpisodeKey(self.next_key.fetch_add(1, Ordering::Relaxed));
        self.host.quotas.admit(key, creation.owner)?;
        let id = creation.id.clone();
        let now = self.host.clock.now();
        // Whoever learns of the episode once it is durable waits here until its actor runs: an
        // episode never has two.
        let cell = {
            let mut slots = self.slots();
            Arc::clone(&slots.entry(id).or_insert_with(|| Slot::empty(now)).handle)
        };
        let created = cell.get_or_try_init(|| self.open(key, creation)).await.cloned();
        if created.is_err() {
            self.host.quotas.release(key);
        }
        created
    }

    /// Keeps the opening of an episode and starts its actor.
    async fn open(&self, key: EpisodeKey, creation: Creation) -> Result<Handle, CreateError> {
        let Creation { id, owner, run, spec, tokens, idempotency } = creation;
        let config = Arc::clone(&spec.config);
        let world = off_thread(is_heavy(&spec.config), move || World::new(config)).await?;
        let world = Arc::new(world);
        let (now, running) = (self.host.clock.wall(), self.host.clock.now());
        if let Some(closes_at) = spec.closes_at.filter(|at| *at <= now) {
            return Err(CreateError::Closed(closes_at));
        }
        let record = RawRecord::write(&spec.opening(&id, now, &world));
        let mut head = Head::START.link(record.as_str().as_bytes());
        let waiting = spec.begins_waiting();
        let (seating, entries) = self.seat(key, owner, &spec, now).await?;
        let row = OpeningRow {
            episode: key,
            id: id.clone(),
            owner,
            run,
            record,
            head,
            task: spec.config.task().name(),
            model: spec.model.clone(),
            visibility: spec.visibility.name(),
            waiting,
            clocked: spec.goes_on_alone(),
            at: now,
            idempotency,
            tokens,
        };
        let mut entries: Vec<Entry> =
            [Entry::Open(Box::new(row))].into_iter().chain(entries).collect();
        if let Some(seating) = seating.as_ref().filter(|_| !waiting) {
            let record;
            (record, head) = seated(seating, head);
            entries.push(Entry::Seat(SeatingRow { episode: key, record, head }));
        }
        self.host.journal.keep(entries).await?;
        let agents = usize::from(spec.config.num_agents());
        let standing = Standing {
            waiting,
            outcome: None,
            round: 0,
            alive: vec![true; agents],
            bank_spent: vec![Duration::ZERO; agents],
            given: Vec::new(),
            last_act_at: running,
        };
        tracing::info!(episode = %id, task = spec.config.task().name(), model = %spec.model, "created");
        let spec = Arc::new(spec);
        let fresh = Fresh {
            id,
            key,
            owner,
            run: run.map(|(run, _)| run),
            created_at: now,
            keyframes: Keyframes::new(Arc::clone(&world)),
            lockstep: Lockstep::new(clocks(&spec), standing, self.host.clock.now()),
            newest_at: now,
            spec,
            world,
            head,
            bytes: 0,
            tally: Tally::default(),
            seating,
        };
        metrics::counter!("swarmbench_episodes_created_total").increment(1);
        let handle = spawn(self.host.clone(), fresh);
        if !waiting && handle.snapshot().world.is_over() {
            // The layout has solved the task; whoever created the episode is to see that. Where the
            // end cannot be kept, the actor goes, and the next request will tell.
            drop(handle.follow().wait_for(|snapshot| snapshot.status.is_over()).await);
        }
        Ok(handle)
    }

    /// The seating of a new episode, and what is to be kept of its creator.
    async fn seat(
        &self,
        episode: EpisodeKey,
        owner: Option<OwnerKey>,
        spec: &Spec,
        now: Timestamp,
    ) -> Result<(Option<Seating>, Option<Entry>), JournalError> {
        if !spec.is_seated() {
            return Ok((None, None));
        }
        let key = match owner {
            Some(owner) => self.host.journal.key_id(owner).await?,
            None => None,
        };
        let holder = Holder {
            number: 0,
            owner,
            key,
            model: spec.model.clone(),
            agent_meta: spec.agent_meta.clone(),
            player: spec.player.clone(),
            at: now,
        };
        let own = spec.agents().filter(|agent| !spec.open_seats.contains(agent));
        let agents = if spec.is_mixed() { own.collect() } else { Vec::new() };
        let seating = Seating::new(
            spec,
            self.host.clock.running_at(now),
            vec![(holder.clone(), agents.clone())],
        );
        let tokens = Vec::new();
        let row = ClaimRow { episode, holder, agents, tokens, idempotency: None };
        Ok((seating, Some(Entry::Claim(Box::new(row)))))
    }

    /// Finds an episode, taking it up from the journal where it is not in memory.
    ///
    /// # Errors
    /// Where its journal cannot be read or played again.
    pub async fn find(&self, id: &EpisodeId) -> Result<Option<Handle>, RecoveryError> {
        let now = self.host.clock.now();
        let known = self.slots().get_mut(id).map(|slot| {
            slot.used_at = now;
            slot.empty_if_dead(now);
            Arc::clone(&slot.handle)
        });
        let cell = match known {
            Some(cell) => cell,
            // Only episodes that exist get a place.
            None if self.host.journal.episode(id.clone()).await?.is_none() => return Ok(None),
            None => {
                let mut slots = self.slots();
                Arc::clone(&slots.entry(id.clone()).or_insert_with(|| Slot::empty(now)).handle)
            }
        };
        // Whoever comes first takes it up, the others wait for that.
        match cell.get_or_try_init(|| self.take_up(id)).await {
            Ok(handle) => Ok(Some(handle.clone())),
            Err(None) => Ok(None),
            Err(Some(error)) => Err(error),
        }
    }

    /// Takes an episode up from the journal; an error without a reason says that there is none.
    async fn take_up(&self, id: &EpisodeId) -> Result<Handle, Option<RecoveryError>> {
        let leaving = self.slots().get(id).and_then(|slot| slot.leaving.clone());
        if let Some(leaving) = leaving {
            leaving.cancelled().await;
        }
        // What an earlier actor handed over may still be on its way to the disk.
        let kept = self.host.journal.keep(Vec::new()).await;
        kept.map_err(|error| Some(error.into()))?;
        let stored = self.host.journal.episode(id.clone()).await;
        let stored = stored.map_err(|error| Some(error.into()))?.ok_or(None)?;
        self.host.journal.recovered(stored.episode);
        let fresh = recover(&self.host.journal, stored, &*self.host.clock).await?;
        let handle = spawn(self.host.clone(), fresh);
        // Whoever takes it up now may go before it is found: then it is still to be looked after, and
        // what its actor handed over is still to be waited for.
        if let Some(slot) = self.slots().get_mut(id) {
            slot.leaving = Some(handle.gone());
        }
        if !handle.snapshot().status.is_over() && handle.ends_at() <= self.host.clock.now() {
            // Its time ended while it was not in memory; nobody is to find it running.
            let mut published = handle.follow();
            let over = Box::pin(published.wait_for(|snapshot| snapshot.status.is_over()));
            // Where the time of day has come in doubt this moment, it goes on.
            let up = self.host.clock.sleep_until(after(self.host.clock.now(), END_PATIENCE));
            drop(select(over, up).await);
        }
        if let Some(slot) = self.slots().get_mut(id) {
            slot.ends_at = None;
        }
        Ok(handle)
    }

    /// After a start: takes up the unfinished episodes that go on though nobody asks, so that they do, and
    /// gives all others a place. Returns how many there are.
    ///
    /// # Errors
    /// Where the list of them cannot be read; an episode that cannot be taken up is logged.
    pub async fn take_up_unfinished(&self) -> Result<usize, JournalError> {
        let all = self.host.journal.unfinished().await?;
        let now = self.host.clock.now();
        for Unfinished { episode, id, owner, clocked } in &all {
            let mut slots = self.slots();
            // One that somebody has asked for meanwhile is counted where it is taken up, and may have
            // ended since it was listed.
            if !slots.contains_key(id) {
                self.host.quotas.note(*episode, *owner);
            }
            let slot = slots.entry(id.clone()).or_insert_with(|| Slot::empty(now));
            slot.ends_at = Some(now);
            slot.clocked = *clocked;
        }
        for Unfinished { id, .. } in all.iter().filter(|episode| episode.clocked) {
            self.look_after(id).await;
        }
        Ok(all.len())
    }

    async fn look_after(&self, id: &EpisodeId) {
        if let Err(error) = self.find(id).await {
            tracing::error!(%error, "an episode cannot be taken up");
        }
    }

    /// Takes up the episodes that are not in memory and would have ended by now, or of
    /// which that is not known.
    pub async fn look_after_idle(&self) {
        let now = self.host.clock.now();
        let is_in_doubt = self.host.clock.doubt().is_some();
        let mut due: Vec<(EpisodeId, bool)> = Vec::new();
        for (id, slot) in self.slots().iter_mut() {
            slot.empty_if_dead(now);
            if slot.handle.initialized() {
                // Its actor looks after it.
                slot.ends_at = None;
            } else if slot.ends_at.is_some_and(|at| at <= now) && (slot.clocked || !is_in_doubt) {
                due.push((id.clone(), slot.clocked));
            }
        }
        // The oldest first, and always in the same order.
        due.sort_unstable();
        for (id, clocked) in due {
            match self.ends_at(&id).await {
                Ok(Some(at)) if at > now && !clocked => {
                    if let Some(slot) = self.slots().get_mut(&id) {
                        slot.ends_at = slot.ends_at.map(|_| at);
                    }
                }
                _ => self.look_after(&id).await,
            }
        }
    }

    /// When an episode that is not in memory ends unless somebody asks for something; never, if it has ended.
    async fn ends_at(&self, id: &EpisodeId) -> Result<Option<Timestamp>, RecoveryError> {
        let stored = self.host.journal.episode(id.clone()).await?;
        let Some(stored) = stored.filter(|stored| stored.end.is_none()) else { return Ok(None) };
        let spec = described(&stored)?;
        let clock = &self.host.clock;
        let last_act_at = clock.running_at(stored.last_act_at.unwrap_or(stored.created_at));
        let idle = after(last_act_at, spec.idle_timeout);
        let closes_at = spec.closes_at.filter(|_| stored.status == "waiting");
        let closes_at = closes_at.map(|at| clock.running_at(at));
        Ok(Some(closes_at.map_or(idle, |at| at.min(idle))))
    }

    /// Lets go of episodes that nobody holds or has asked for lately. Those that have not ended keep
    /// their place, those with a running clock stay.
    pub fn let_go(&self) {
        let now = self.host.clock.now();
        self.slots().retain(|_, slot| {
            if slot.is_held() || after(slot.used_at, UNUSED_STAYS) > now {
                return true;
            }
            let Some(handle) = slot.handle.get() else { return slot.ends_at.is_some() };
            if handle.snapshot().status.is_over() {
                return false;
            }
            if handle.gone().is_cancelled() {
                // Its actor ended though the episode has not; it is taken up again.
                slot.ends_at = Some(now);
                slot.clocked = handle.spec.goes_on_alone();
                slot.handle = Arc::default();
            } else if !handle.spec.goes_on_alone() {
                slot.ends_at = Some(handle.ends_at());
                slot.leaving = Some(handle.gone());
                slot.handle = Arc::default();
            }
            true
        });
    }
}
