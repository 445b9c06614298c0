//! All episodes of a server: creates them, finds them, takes them up from the journal on first use,
//! and lets go of those that have ended.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::World;
use tokio::sync::OnceCell;
use tokio_util::task::TaskTracker;

use super::actor::{Fresh, Handle, Host, Keyframes, is_heavy, spawn};
use super::lockstep::{Lockstep, Standing};
use super::recovery::{RecoveryError, clocks, recover};
use super::spec::Spec;
use crate::clock::{Clock, after};
use crate::ids::EpisodeId;
use crate::journal::chain::Head;
use crate::journal::record::RawRecord;
use crate::journal::{Entry, EpisodeKey, Journal, JournalError, OpeningRow, TokenRow};

/// How long an episode that has ended stays in memory after it was last asked for.
const ENDED_STAYS: Duration = Duration::from_mins(5);

/// What belongs to a new episode beside its description.
pub struct Creation {
    /// Its public id.
    pub id: EpisodeId,
    /// What it is.
    pub spec: Spec,
    /// Its tokens.
    pub tokens: Vec<TokenRow>,
    /// The key by which a repeated creation finds it, and the hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// All episodes of a server. Cloning shares them.
#[derive(Clone)]
pub struct Registry {
    host: Host,
    slots: Arc<Mutex<HashMap<EpisodeId, Slot>>>,
    next_key: Arc<AtomicI64>,
    tracker: TaskTracker,
}

#[derive(Clone)]
struct Slot {
    handle: Arc<OnceCell<Handle>>,
    used_at: Timestamp,
}

impl Registry {
    /// The registry over a journal whose newest episode has the number `last_key`.
    #[must_use]
    pub fn new(journal: Arc<dyn Journal>, clock: Arc<dyn Clock>, last_key: i64) -> Self {
        Self {
            host: Host { journal, clock, opened: Arc::default(), live: Arc::default() },
            slots: Arc::default(),
            next_key: Arc::new(AtomicI64::new(last_key + 1)),
            tracker: TaskTracker::new(),
        }
    }

    /// The journal from which states of earlier rounds are recomputed.
    #[must_use]
    pub fn journal(&self) -> &Arc<dyn Journal> {
        &self.host.journal
    }

    /// How many episodes are in memory and have not ended.
    #[must_use]
    pub fn live(&self) -> usize {
        self.host.live.load(Ordering::Relaxed)
    }

    /// Creates an episode; it is durable when this returns.
    ///
    /// # Errors
    /// Where it could not be kept.
    pub async fn create(&self, creation: Creation) -> Result<Handle, JournalError> {
        // Whoever learns of the episode once it is durable waits here until its actor runs: an
        // episode never has two.
        let cell = self.slot(&creation.id);
        cell.get_or_try_init(|| self.open(creation)).await.cloned()
    }

    /// The place of an episode; empty as long as nobody has created it or taken it up.
    fn slot(&self, id: &EpisodeId) -> Arc<OnceCell<Handle>> {
        let now = self.host.clock.now();
        let mut slots = self.slots.lock().expect("nothing panics while it holds this");
        let slot = slots
            .entry(id.clone())
            .or_insert_with(|| Slot { handle: Arc::default(), used_at: now });
        slot.used_at = now;
        Arc::clone(&slot.handle)
    }

    /// Keeps the opening of an episode and starts its actor.
    async fn open(&self, creation: Creation) -> Result<Handle, JournalError> {
        let Creation { id, spec, tokens, idempotency } = creation;
        let now = self.host.clock.now();
        let key = EpisodeKey(self.next_key.fetch_add(1, Ordering::Relaxed));
        let config = Arc::clone(&spec.config);
        let world = if is_heavy(&config) {
            tokio::task::spawn_blocking(move || World::new(config))
                .await
                .map_err(|error| JournalError(error.to_string().into()))?
        } else {
            World::new(config)
        };
        let world = Arc::new(world);
        let record = RawRecord::write(&spec.opening(&id, now, &world));
        let head = Head::START.link(record.as_str().as_bytes());
        let row = OpeningRow {
            episode: key,
            id: id.clone(),
            record,
            head,
            task: spec.config.task().name(),
            model: spec.model.clone(),
            visibility: spec.visibility.name(),
            waiting: spec.manual_start,
            clocked: spec.round_deadline.is_some(),
            at: now,
            idempotency,
            tokens,
        };
        self.host.journal.keep(vec![Entry::Open(Box::new(row))]).await?;
        let agents = usize::from(spec.config.num_agents());
        let standing = Standing {
            waiting: spec.manual_start,
            outcome: None,
            round: 0,
            alive: vec![true; agents],
            bank_spent: vec![Duration::ZERO; agents],
            given: Vec::new(),
            last_act_at: now,
        };
        tracing::info!(episode = %id, task = spec.config.task().name(), model = %spec.model, "created");
        let spec = Arc::new(spec);
        let fresh = Fresh {
            id: id.clone(),
            key,
            created_at: now,
            keyframes: Keyframes::new(Arc::clone(&world)),
            lockstep: Lockstep::new(clocks(&spec), standing, self.host.clock.now()),
            spec,
            world,
            head,
        };
        metrics::counter!("swarmbench_episodes_created_total").increment(1);
        let handle = spawn(self.host.clone(), fresh, &self.tracker);
        if !handle.spec.manual_start && handle.snapshot().world.is_over() {
            // The layout has solved the task; whoever created the episode is to see that. Where the
            // end cannot be kept, the next request will tell.
            drop(handle.follow().wait_for(|snapshot| snapshot.status.is_over()).await);
        }
        Ok(handle)
    }

    /// Finds an episode, taking it up from the journal where it is not in memory.
    ///
    /// # Errors
    /// Where its journal cannot be read or played again.
    pub async fn find(&self, id: &EpisodeId) -> Result<Option<Handle>, RecoveryError> {
        let known = {
            let mut slots = self.slots.lock().expect("nothing panics while it holds this");
            slots.get_mut(id).and_then(|slot| {
                slot.used_at = self.host.clock.now();
                slot.handle.get().cloned()
            })
        };
        if known.is_some() {
            return Ok(known);
        }
        let Some(stored) = self.host.journal.episode(id.clone()).await? else { return Ok(None) };
        // Whoever comes first takes it up, the others wait for that.
        let cell = self.slot(id);
        let take_up = || async {
            let fresh = recover(&self.host.journal, stored, self.host.clock.now()).await?;
            Ok::<_, RecoveryError>(spawn(self.host.clone(), fresh, &self.tracker))
        };
        cell.get_or_try_init(take_up).await.cloned().map(Some)
    }

    /// Takes up all unfinished episodes, those with clocks first, so that their clocks go on.
    ///
    /// # Errors
    /// Where the list of them cannot be read; an episode that cannot be taken up is logged.
    pub async fn take_up_unfinished(&self) -> Result<usize, JournalError> {
        let ids = self.host.journal.unfinished().await?;
        for id in &ids {
            if let Err(error) = self.find(id).await {
                tracing::error!(%error, "an episode cannot be taken up");
            }
        }
        Ok(ids.len())
    }

    /// Lets go of episodes that have ended and were not asked for lately, and of places that nobody
    /// is about to fill.
    pub fn let_go(&self) {
        let now = self.host.clock.now();
        let mut slots = self.slots.lock().expect("nothing panics while it holds this");
        slots.retain(|_, slot| {
            let idle = match slot.handle.get() {
                Some(handle) => handle.snapshot().status.is_over(),
                None => Arc::strong_count(&slot.handle) == 1,
            };
            !idle || after(slot.used_at, ENDED_STAYS) > now
        });
    }
}
