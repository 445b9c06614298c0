//! The registry of a server's episodes: creates them, finds them, recovers them from the journal on first use, and evicts idle
//! ones.

mod creation;

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use futures::{StreamExt, stream};
use jiff::Timestamp;
use tokio::sync::{OnceCell, mpsc};

use super::actor::{Handle, Host, Spawn, Times, spawn};
use super::heavy::step_micros;
use super::memory;
use super::quota::{Full, Purpose, Quotas};
use super::recovery::{RecoveryError, described, recover, recovered_for};
use super::slot::Slot;
use super::slots::Slots;
use super::spec::Spec;
use crate::budget::{Budget, Exhausted, Reservation, SMALL_BYTES};
use crate::fair::{FairLimit, Group, Party, REPLAYS_MAX, Rank};
use crate::ids::{EpisodeId, EpisodeKey, Numbers, Place, RunKey};
use crate::store::port::{EpisodeStore, StoredEpisode, Unfinished};
use crate::store::{Stopped, StoreError};
use crate::telemetry::detached_by;
use crate::work::Workers;
pub use creation::{CreateError, Creation, FORK_PIECE_ROWS_MAX};
use swarmbench_clock::{Clock, after};

/// Longest light recovery, in microseconds of replay. Episodes that take longer are recovered after all others, and the server is
/// ready without them.
const LIGHT_RECOVERY_MICROS: u64 = 250_000;

/// Light episodes that are recovered concurrently after a start.
const RECOVERED_AT_ONCE: usize = 8;

/// Due episodes outside memory that a sweep recovers concurrently: an episode that takes long, or whose journal is broken, delays
/// no other episode's end.
const SWEPT_AT_ONCE: usize = 8;

/// Time for which an unused episode stays in memory.
const UNUSED_STAYS: Duration = Duration::from_mins(5);

/// Time for which an unused episode stays in memory when memory is low.
const IDLE_STAYS: Duration = Duration::from_secs(10);

/// Pause of the search for idle episodes after it found too few.
const LOOKS_FOR_IDLE_AFTER: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Location {
    Memory,
    /// The episode is in the journal and has not ended: its recovery continues although the caller is gone.
    Unfinished,
    /// The episode is in the journal, if anywhere: its recovery is cancelled when no caller waits for it.
    Journal,
}

/// Reason why an episode was neither found in memory nor recovered.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    #[error(transparent)]
    NoMemory(#[from] Exhausted),
    #[error(transparent)]
    Recovery(#[from] RecoveryError),
}

impl From<StoreError> for FindError {
    fn from(error: StoreError) -> Self {
        Self::Recovery(error.into())
    }
}

/// All episodes of a server. Clones share them.
#[derive(Clone)]
pub struct Registry {
    host: Arc<Host>,
    slots: Arc<Mutex<Slots>>,
    numbers: Arc<Numbers>,
    /// Times until which the search for idle episodes of a group, or of all groups, pauses, as there were too few.
    none_idle_until: Arc<Mutex<HashMap<Option<Group>, Timestamp>>>,
    recoveries: FairLimit,
    ended: Arc<Mutex<Option<mpsc::UnboundedReceiver<RunKey>>>>,
    hosted: Arc<Mutex<Option<mpsc::UnboundedReceiver<Handle>>>>,
}

impl Registry {
    /// A registry over a journal whose newest episode has the number `last_key`.
    pub fn new(
        journal: Arc<dyn EpisodeStore>,
        clock: Arc<dyn Clock>,
        quotas: Arc<Quotas>,
        workers: Workers,
        spawn: Spawn,
        last_key: i64,
    ) -> Self {
        let (notify_ended, ended) = mpsc::unbounded_channel();
        let (notify_hosted, hosted) = mpsc::unbounded_channel();
        Self {
            host: Arc::new(Host {
                journal,
                clock,
                spawn,
                quotas,
                budget: Budget::unlimited(),
                workers,
                replays: Arc::default(),
                ended: notify_ended,
                hosted: notify_hosted,
            }),
            slots: Arc::default(),
            numbers: Arc::new(Numbers::after(last_key)),
            none_idle_until: Arc::default(),
            // All callers use `acquire_always`: at most one waits for each episode.
            recoveries: FairLimit::replays(REPLAYS_MAX, Duration::MAX),
            ended: Arc::new(Mutex::new(Some(ended))),
            hosted: Arc::new(Mutex::new(Some(hosted))),
        }
    }

    /// Sets the source of numbers for new episodes; by default they follow one another.
    #[must_use]
    pub fn with_numbers(mut self, numbers: Numbers) -> Self {
        self.numbers = Arc::new(numbers);
        self
    }

    /// Sets the memory budget; by default memory is unlimited.
    #[must_use]
    pub fn with_budget(mut self, budget: Arc<Budget>) -> Self {
        Arc::make_mut(&mut self.host).budget = budget;
        self
    }

    /// Memory that worlds and answers share.
    pub fn budget(&self) -> &Arc<Budget> {
        &self.host.budget
    }

    /// Reserves memory for an answer. Where none is free, idle episodes are evicted first; a small amount may come from the
    /// reserve.
    pub fn room(&self, bytes: usize) -> Result<Reservation, Exhausted> {
        self.room_of(bytes, None, Rank::Normal)
    }

    /// Reserves memory like [`Registry::room`], within the share of a party: for its games and exports. An urgent request may use
    /// the reserve, too.
    pub fn room_of(
        &self,
        bytes: usize,
        party: Option<Party>,
        rank: Rank,
    ) -> Result<Reservation, Exhausted> {
        let budget = &self.host.budget;
        match budget.reserve(bytes, party, rank) {
            Ok(reservation) => return Ok(reservation),
            Err(Exhausted::All { .. }) => self.evict_idle(bytes, None),
            Err(Exhausted::Share { .. }) => self.evict_idle(bytes, party),
        }
        let reserved = budget.reserve(bytes, party, rank).or_else(|refused| {
            if bytes <= SMALL_BYTES { budget.squeeze(bytes, party) } else { Err(refused) }
        });
        reserved.inspect_err(|_| {
            metrics::counter!("swarmbench_memory_refusals_total").increment(1);
        })
    }

    /// Evicts idle episodes of a party's group, the party's own first, or of all groups; within these, the longest unused first.
    /// Stops once there is room for `bytes` and an eighth of the budget more, so that not every request searches.
    fn evict_idle(&self, bytes: usize, party: Option<Party>) {
        let budget = &self.host.budget;
        let wanted = bytes.saturating_add(budget.most() / 8);
        let group = party.map(|party| party.group);
        let is_enough = || budget.has(wanted, party);
        let now = self.host.clock.now();
        if self.none_idle_until().get(&group).is_some_and(|until| now < *until) {
            return;
        }
        let mut slots = self.slots();
        let is_of_group =
            |whose: Option<Party>| group.is_none() || whose.map(|of| of.group) == group;
        let idle = |(id, slot): (&EpisodeId, &Slot)| {
            let whose = slot.handle.get()?.memory_party();
            let is_idle = is_of_group(whose) && slot.is_idle(now, IDLE_STAYS);
            is_idle.then(|| (whose != party, slot.used_at, id.clone()))
        };
        let mut idle: Vec<_> = slots.awake().filter_map(idle).collect();
        idle.sort_unstable();
        let mut evicted = 0;
        for (_, _, id) in idle {
            if is_enough() {
                break;
            }
            let Some(slot) = slots.get_mut(&id) else { continue };
            let stays = slot.leave(now);
            evicted += u64::from(!slot.handle.initialized() || !stays);
            if !stays {
                slots.remove(&id);
            }
        }
        if evicted > 0 {
            metrics::counter!("swarmbench_evictions_total").increment(evicted);
            tracing::debug!(evicted, used = budget.used(), "memory is low");
        }
        if !is_enough() {
            let mut none_idle_until = self.none_idle_until();
            none_idle_until.retain(|_, until| now < *until);
            none_idle_until.insert(group, after(now, LOOKS_FOR_IDLE_AFTER));
        }
    }

    fn none_idle_until(&self) -> MutexGuard<'_, HashMap<Option<Group>, Timestamp>> {
        self.none_idle_until.lock().expect("nothing panics while it holds this")
    }

    /// Returns the receiver of the runs of episodes that have ended, durably. Only the first caller gets it.
    pub fn take_ended(&self) -> Option<mpsc::UnboundedReceiver<RunKey>> {
        self.ended.lock().expect("nothing panics while it holds this").take()
    }

    /// Returns the receiver of the episodes in which the server may play seats. Only the first caller gets it; until then the
    /// channel queues them.
    pub fn take_hosted(&self) -> Option<mpsc::UnboundedReceiver<Handle>> {
        self.hosted.lock().expect("nothing panics while it holds this").take()
    }

    pub fn journal(&self) -> &Arc<dyn EpisodeStore> {
        &self.host.journal
    }

    /// Resources that all actors share; states of earlier rounds are recomputed with them.
    pub const fn host(&self) -> &Arc<Host> {
        &self.host
    }

    pub fn unfinished(&self) -> usize {
        self.host.quotas.unfinished()
    }

    pub fn in_memory(&self) -> usize {
        self.slots().awake().filter(|(_, slot)| slot.handle.initialized()).count()
    }

    fn slots(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock().expect("nothing panics while it holds this")
    }

    pub fn check_room(&self, party: Party, purpose: Purpose) -> Result<(), Full> {
        self.host.quotas.check(party, purpose)
    }

    /// Location of an episode, which need not exist.
    pub fn location(&self, id: &EpisodeId) -> Location {
        match self.slots().get(id) {
            Some(slot) if slot.handle.initialized() => Location::Memory,
            Some(slot) if slot.ends_at.is_some() => Location::Unfinished,
            Some(_) | None => Location::Journal,
        }
    }

    /// Finds an episode in memory, unless its actor has ended by a fault.
    pub fn find_in_memory(&self, id: &EpisodeId) -> Option<Handle> {
        let now = self.host.clock.now();
        let mut slots = self.slots();
        let slot = slots.get_mut(id)?;
        let handle = slot.handle.get().filter(|handle| !handle.is_dead()).cloned()?;
        slot.used_at = now;
        Some(handle)
    }

    /// Finds an episode, and recovers it from the journal if it is not in memory.
    pub async fn find(&self, id: &EpisodeId) -> Result<Option<Handle>, FindError> {
        let now = self.host.clock.now();
        let known = self.slots().wake(id).map(|slot| {
            slot.used_at = now;
            slot.empty_if_dead(now);
            (Arc::clone(&slot.handle), slot.ends_at.is_some(), slot.starting.clone())
        });
        if let Some((_, _, Some(starting))) = &known {
            starting.cancelled().await;
        }
        let cell = match known {
            // The episode is unfinished, so its recovery continues although the caller is gone.
            Some((cell, true, _)) if !cell.initialized() => {
                return self.recover_detached(cell, id).await;
            }
            Some((cell, ..)) => cell,
            // Only existing episodes get a slot.
            None if self.host.journal.episode(id.clone()).await?.is_none() => return Ok(None),
            None => {
                let mut slots = self.slots();
                Arc::clone(&slots.wake_or_insert(id, now).handle)
            }
        };
        self.fill(&cell, id).await
    }

    async fn recover_detached(
        &self,
        cell: Arc<OnceCell<Handle>>,
        id: &EpisodeId,
    ) -> Result<Option<Handle>, FindError> {
        let (registry, id) = (self.clone(), id.clone());
        let recovering = async move { registry.fill(&cell, &id).await };
        let recovered = detached_by(&*self.host.spawn, recovering).await;
        let stopping = || Err(RecoveryError::from(StoreError::Stopped(Stopped::Server)).into());
        recovered.unwrap_or_else(|_| stopping())
    }

    /// Fills the slot of an episode: the first caller recovers the episode, the others wait for it.
    async fn fill(
        &self,
        cell: &OnceCell<Handle>,
        id: &EpisodeId,
    ) -> Result<Option<Handle>, FindError> {
        let recover_one = || async {
            let _permit = self.recoveries.acquire_always(Party::current(), Rank::current()).await;
            self.recover(id).await
        };
        match cell.get_or_try_init(recover_one).await {
            Ok(handle) => Ok(Some(handle.clone())),
            Err(None) => Ok(None),
            Err(Some(error)) => Err(error),
        }
    }

    /// Recovers an episode from the journal. The error is `None` where there is no such episode.
    async fn recover(&self, id: &EpisodeId) -> Result<Handle, Option<FindError>> {
        let leaving = self.slots().get(id).and_then(|slot| slot.leaving.clone());
        if let Some(leaving) = leaving {
            leaving.cancelled().await;
        }
        // Entries of an earlier actor may still be on their way to the disk.
        let flushed = self.host.journal.keep(Vec::new()).await;
        flushed.map_err(|error| Some(error.into()))?;
        let stored = self.host.journal.episode(id.clone()).await;
        let mut stored = stored.map_err(|error| Some(error.into()))?.ok_or(None)?;
        let place = Place::of_game(stored.episode, stored.run);
        // The place is set before it is taken, so that it counts as used, and is not released, during the recovery.
        if let Some(slot) = self.slots().get_mut(id) {
            slot.place = Some((place, stored.episode));
        }
        if stored.end.is_none() && !self.host.journal.has(place) {
            let taken = self.host.journal.take(place).await;
            if !taken.map_err(|error| Some(error.into()))? {
                return Err(Some(StoreError::Elsewhere.into()));
            }
            // The previous owner may have written since.
            let again = self.host.journal.episode(id.clone()).await;
            stored = again.map_err(|error| Some(error.into()))?.ok_or(None)?;
        }
        let spec = Arc::new(described(&stored).map_err(FindError::from)?);
        let party = self.host.party(stored.owner, stored.run).await;
        let party = party.map_err(FindError::from)?;
        let room = self.room_for(&stored, &spec, party)?;
        self.host.journal.recovered(stored.episode);
        let times = self.times(&stored);
        let init = recover(&self.host, stored, spec, party, times).await;
        let handle = spawn(Arc::clone(&self.host), init.map_err(FindError::from)?, room);
        // The caller may be dropped before the handle is found: then the sweep still has to see the actor, and its entries still
        // have to be awaited.
        if let Some(slot) = self.slots().get_mut(id) {
            slot.leaving = Some(handle.gone());
        }
        handle.settled().await;
        if let Some(slot) = self.slots().get_mut(id) {
            slot.ends_at = None;
        }
        Ok(handle)
    }

    /// Reserves memory for a stored episode. An episode that advances by itself gets memory even where none is free.
    fn room_for(
        &self,
        stored: &StoredEpisode,
        spec: &Spec,
        party: Party,
    ) -> Result<Reservation, FindError> {
        let is_over = stored.end.is_some();
        let hosted = if is_over { 0 } else { spec.hosted_max() };
        let bytes = memory::expected(spec, stored.rounds, hosted);
        let party = Some(recovered_for(stored, party));
        match self.room_of(bytes, party, Rank::Normal) {
            Err(_) if spec.advances_by_itself() && !is_over => {
                Ok(self.host.budget.take(bytes, party))
            }
            room => Ok(room?),
        }
    }

    /// Recovers the unfinished episodes that advance by themselves, after a start, and gives all others a slot. Returns the number
    /// of unfinished episodes once the light ones are recovered; heavy ones follow, the fastest first.
    pub async fn recover_unfinished(&self) -> Result<usize, StoreError> {
        Ok(self.adopt(self.host.journal.unfinished().await?).await)
    }

    /// Recovers unfinished episodes that this server plays from now on, like [`Registry::recover_unfinished`].
    pub async fn adopt(&self, all: Vec<Unfinished>) -> usize {
        let now = self.host.clock.now();
        for Unfinished { episode, id, owner, run, clocked, .. } in &all {
            // The recovery counts an episode that was requested meanwhile: it may have ended since it was listed.
            let mut slots = self.slots();
            if slots.add_unfinished(id, now, *clocked) {
                self.host.quotas.note(*episode, Party::of_key(*owner));
            }
            if let Some(slot) = slots.get_mut(id) {
                slot.place = Some((Place::of_game(*episode, *run), *episode));
            }
        }
        let count = all.len();
        let (light, heavy) = in_line(all);
        self.recover_all(light, RECOVERED_AT_ONCE).await;
        if !heavy.is_empty() {
            tracing::info!(
                count = heavy.len(),
                "episodes that take long to replay are recovered later"
            );
            let registry = self.clone();
            (self.host.spawn)(Box::pin(async move {
                registry.recover_all(heavy, registry.host.workers.threads()).await;
                tracing::info!("all episodes with clocks are recovered");
            }));
        }
        count
    }

    /// Filters places: leaves those without an episode in memory that anybody uses, or that advances by itself.
    pub fn idle_places(&self, places: HashSet<Place>) -> HashSet<Place> {
        let now = self.host.clock.now();
        let mut idle = places;
        for (_, slot) in self.slots().all() {
            if let Some((place, _)) = slot.place
                && (slot.advances() || !slot.is_idle(now, IDLE_STAYS))
            {
                idle.remove(&place);
            }
        }
        idle
    }

    /// Evicts all episodes of idle places, for another server to play them; their entries are durable afterwards. Returns the
    /// places that this server has left: other places are in use again.
    pub async fn give_up(&self, places: HashSet<Place>) -> Result<HashSet<Place>, StoreError> {
        let left = self.idle_places(places);
        let now = self.host.clock.now();
        let mut leaving = Vec::new();
        {
            let mut slots = self.slots();
            let of_places = slots.all().filter_map(|(id, slot)| {
                let (place, episode) = slot.place?;
                left.contains(&place).then(|| (id.clone(), episode))
            });
            let episodes: Vec<(EpisodeId, EpisodeKey)> = of_places.collect();
            for (id, episode) in episodes {
                if let Some(slot) = slots.get_mut(&id) {
                    slot.leave(now);
                    leaving.extend(slot.leaving.clone());
                }
                slots.remove(&id);
                self.host.quotas.release(episode);
            }
        }
        for actor in leaving {
            actor.cancelled().await;
        }
        self.host.journal.keep(Vec::new()).await?;
        Ok(left)
    }

    /// Recovers episodes in order, `at_once` of them concurrently.
    async fn recover_all(&self, ids: Vec<EpisodeId>, at_once: usize) {
        let recover_one = async |id: EpisodeId| {
            self.recover_or_log(&id).await;
            if let Some(slot) = self.slots().get_mut(&id) {
                slot.in_line = false;
            }
        };
        stream::iter(ids).map(recover_one).buffer_unordered(at_once).collect::<()>().await;
    }

    async fn recover_or_log(&self, id: &EpisodeId) {
        match self.find(id).await {
            Ok(_) => {}
            // The next sweep tries again.
            Err(FindError::NoMemory(full)) => {
                tracing::debug!(%full, "an episode was not recovered");
            }
            Err(FindError::Recovery(error)) => {
                tracing::error!(%error, "an episode cannot be recovered");
            }
        }
    }

    /// Recovers episodes outside memory that should have ended by now, or whose end is not known.
    pub async fn sweep_idle(&self) {
        let now = self.host.clock.now();
        let is_in_doubt = self.host.clock.doubt().is_some();
        let due = {
            let mut slots = self.slots();
            slots.visit_awake(|slot| {
                slot.empty_if_dead(now);
                if slot.handle.initialized() {
                    // The actor ends its episode in time.
                    slot.ends_at = None;
                }
                true
            });
            slots.due(now, |slot| !slot.in_line && (slot.clocked || !is_in_doubt))
        };
        let recover_due = async |(id, clocked): (EpisodeId, bool)| match self.ends_at(&id).await {
            Ok(Some(at)) if at > now && !clocked => {
                let mut slots = self.slots();
                if slots.get(&id).is_some_and(|slot| slot.ends_at.is_some()) {
                    slots.set_end(&id, at);
                }
            }
            _ => self.recover_or_log(&id).await,
        };
        stream::iter(due).for_each_concurrent(SWEPT_AT_ONCE, recover_due).await;
    }

    /// Time at which an episode outside memory ends without a request; `None` if it has ended.
    async fn ends_at(&self, id: &EpisodeId) -> Result<Option<Timestamp>, RecoveryError> {
        let stored = self.host.journal.episode(id.clone()).await?;
        let Some(stored) = stored.filter(|stored| stored.end.is_none()) else { return Ok(None) };
        let spec = described(&stored)?;
        let idle = after(self.times(&stored).last_act_at(), spec.idle_timeout);
        let closes_at = spec.closes_at.filter(|_| stored.status == "waiting");
        let closes_at = closes_at.map(|at| self.host.clock.running_at(at));
        Ok(Some(closes_at.map_or(idle, |at| at.min(idle))))
    }

    /// Times of a stored episode: those that it had in memory, else those by the time of day.
    fn times(&self, stored: &StoredEpisode) -> Arc<Times> {
        let known = self.slots().get(&stored.id).and_then(|slot| slot.times.clone());
        known.unwrap_or_else(|| Arc::new(Times::stored(stored, &*self.host.clock)))
    }

    /// Evicts unused episodes without handles. Unfinished episodes keep their slots, and episodes with a running clock stay.
    pub fn evict_unused(&self) {
        let now = self.host.clock.now();
        self.host.quotas.tidy(now);
        self.slots().visit_awake(|slot| !slot.is_idle(now, UNUSED_STAYS) || slot.leave(now));
    }
}

/// Ids of the episodes that advance by themselves, in the order of recovery, fastest first: the light ones, and the heavy ones.
fn in_line(all: Vec<Unfinished>) -> (Vec<EpisodeId>, Vec<EpisodeId>) {
    let mut in_line: Vec<_> = (all.into_iter().filter(|episode| episode.clocked))
        .map(|episode| (recovery_micros(&episode), episode.episode, episode.id))
        .collect();
    in_line.sort_unstable();
    let light = in_line.partition_point(|(micros, ..)| *micros <= LIGHT_RECOVERY_MICROS);
    let heavy = in_line.split_off(light);
    let ids =
        |line: Vec<(u64, EpisodeKey, EpisodeId)>| line.into_iter().map(|(.., id)| id).collect();
    (ids(in_line), ids(heavy))
}

/// Estimates the time in which an episode is played again at worst, in microseconds: its layout and all its rounds.
fn recovery_micros(episode: &Unfinished) -> u64 {
    let Some((config, rounds)) = &episode.played else { return 0 };
    config.engine().map_or(0, |config| step_micros(&config) * (1 + u64::from(*rounds)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use swarmbench_engine::{Config, Settings, TaskName};
    use swarmbench_journal::record::RecordedConfig;

    fn unfinished(key: i64, clocked: bool, agents: u16, rounds: u32) -> Unfinished {
        let settings = Settings {
            num_agents: agents.into(),
            width: 64,
            height: 64,
            max_round: 1000,
            ..Settings::standard(TaskName::Flocking, 1)
        };
        let config = RecordedConfig::of(&Config::check(&settings).expect("good settings"));
        let id = EpisodeId::from_text(key.to_string());
        let played = Some((config, rounds));
        Unfinished { episode: EpisodeKey(key), id, owner: None, run: None, clocked, played }
    }

    #[test]
    fn the_fastest_replay_is_recovered_first_and_the_slow_ones_later() {
        let all = vec![
            unfinished(1, true, 256, 30),
            unfinished(2, true, 10, 500),
            unfinished(3, true, 200, 20),
            unfinished(4, true, 10, 3),
            unfinished(5, false, 256, 30),
            unfinished(6, true, 10, 3),
        ];
        let (light, heavy) = in_line(all);
        let names = |ids: Vec<EpisodeId>| ids.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(names(light), ["4", "6", "2"]);
        assert_eq!(names(heavy), ["3", "1"]);
    }
}
