//! A server's journal in memory. The run decides when a job becomes durable and when its result is delivered, so a
//! crash can come between any two of these steps.

use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard};

use futures::FutureExt as _;
use swarmbench::cluster::{Incarnation, Places};
use swarmbench::ids::{CompetitionKey, EpisodeId, EpisodeKey, Place, RunKey};
use swarmbench::keys::OwnerKey;
use swarmbench::store::StoreError;
use swarmbench::store::entries::{ActRow, Entry, Held, RoundRow};
use swarmbench::store::port::{
    Committed, EpisodeStore, Reply, RoundActs, StoredAct, StoredEpisode, StoredRound, Unfinished,
};
use swarmbench_engine::AgentId;
use swarmbench_testkit::worlds::Dice;

use crate::simulation::broken::Flaw;
use crate::simulation::database::{Database, Tables, record};
use crate::simulation::executor::pause;

/// A journal that stores entries in the order of submission, all entries of a job or none. It judges nothing: the
/// checker finds jobs that should not have been submitted. It refuses single jobs when the run says so, and then,
/// like the writer, all later jobs of that episode until it is recovered.
///
/// Each server of a cluster has its own journal, which stores nothing any more once that
/// server is excluded.
pub(crate) struct MemoryJournal {
    flaw: Option<Flaw>,
    pauses_max: usize,
    incarnation: Incarnation,
    database: Arc<Database>,
    /// True if other servers also use the database.
    is_shared: bool,
    /// A lock that serializes takes and releases of places, like the server's one connection for them.
    takes: tokio::sync::Mutex<()>,
    /// The places of this server, as far as it knows.
    places: Places,
    state: Mutex<State>,
}

struct State {
    /// Entries that a failed commit left on the disk all the same, which a restart finds.
    limbo: Vec<Entry>,
    /// Jobs that are not durable yet.
    queue: VecDeque<Job>,
    /// The number of queued jobs that passed the fence before they are written; only with that flaw.
    passed: usize,
    /// Processed jobs whose results are not delivered yet.
    telling: VecDeque<(Job, Result<(), Lost>)>,
    /// Entries submitted since the last `take_handed`.
    handed: Vec<Vec<Entry>>,
    has_failed: bool,
    /// Episodes with a refused job that were not recovered since.
    broken: BTreeSet<EpisodeKey>,
    dice: Dice,
}

struct Job {
    entries: Vec<Entry>,
    committed: Committed,
}

/// A job whose result was just delivered.
pub(crate) struct JobResult {
    pub(crate) entries: Vec<Entry>,
    pub(crate) result: Result<(), Lost>,
}

/// A reason why a job was not stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lost {
    /// The commit of the job, or an earlier commit, failed.
    Failed,
    /// The job, or an earlier job of its episode, was refused.
    Refused,
}

impl From<Lost> for StoreError {
    fn from(lost: Lost) -> Self {
        match lost {
            Lost::Failed => Self::Failed,
            Lost::Refused => Self::Gap,
        }
    }
}

impl MemoryJournal {
    /// Creates the journal of a server. A read yields up to `pauses_max` times, before and after.
    pub(crate) fn new(
        seed: u64,
        pauses_max: usize,
        flaw: Option<Flaw>,
        database: Arc<Database>,
        incarnation: Incarnation,
        is_shared: bool,
    ) -> Self {
        let state = State {
            limbo: Vec::new(),
            queue: VecDeque::new(),
            passed: 0,
            telling: VecDeque::new(),
            handed: Vec::new(),
            has_failed: false,
            broken: BTreeSet::new(),
            dice: Dice(seed),
        };
        Self {
            flaw,
            pauses_max,
            incarnation,
            database,
            is_shared,
            takes: tokio::sync::Mutex::default(),
            places: Places::default(),
            state: Mutex::new(state),
        }
    }

    pub(crate) const fn incarnation(&self) -> Incarnation {
        self.incarnation
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("one thread")
    }

    /// Jobs submitted since the last call.
    pub(crate) fn take_handed(&self) -> Vec<Vec<Entry>> {
        std::mem::take(&mut self.state().handed)
    }

    /// The number of jobs that wait to become durable. The next group begins after all results of the last one are
    /// delivered.
    pub(crate) fn queued(&self) -> usize {
        let state = self.state();
        if state.telling.is_empty() { state.queue.len() } else { 0 }
    }

    /// The number of jobs whose results are not delivered.
    pub(crate) fn untold(&self) -> usize {
        self.state().telling.len()
    }

    /// True if a commit has failed since the start.
    pub(crate) fn has_failed(&self) -> bool {
        self.state().has_failed
    }

    /// Makes the first jobs of the queue durable, all of them or none; returns the newly durable entries.
    pub(crate) fn commit(&self, jobs: usize) -> Vec<Entry> {
        let mut state = self.state();
        let mut tables = self.database.tables();
        let mut jobs = jobs;
        // Jobs without entries do not reach the database.
        let writes = state.queue.iter().take(jobs).any(|job| !job.entries.is_empty());
        if self.is_shared && writes {
            let is_excluded = !tables.knows(self.incarnation);
            if self.flaw == Some(Flaw::FenceWithoutLock) {
                let passed = std::mem::take(&mut state.passed);
                if passed == 0 && !is_excluded {
                    state.passed = jobs;
                    return Vec::new();
                }
                jobs = if passed == 0 { jobs } else { passed.min(state.queue.len()) };
                state.has_failed |= passed == 0;
            } else {
                state.has_failed |= is_excluded;
            }
        }
        let group: Vec<Job> = state.queue.drain(..jobs).collect();
        let mut kept = Vec::new();
        let goes_on = self.flaw == Some(Flaw::GoesOnAfterFailure);
        for job in group {
            if state.has_failed && !goes_on {
                state.telling.push_back((job, Err(Lost::Failed)));
                continue;
            }
            if state.continues_broken(&job.entries) && self.flaw != Some(Flaw::GoesOnAfterRefusal) {
                state.telling.push_back((job, Err(Lost::Refused)));
                continue;
            }
            let entries = match self.flaw {
                Some(flaw) => flaw.on_the_way_to_the_disk(job.entries.clone()),
                None => job.entries.clone(),
            };
            kept.extend(entries);
            state.telling.push_back((job, Ok(())));
        }
        self.write(&mut tables, &kept);
        kept
    }

    /// Writes entries, and takes the places that they create for this server.
    fn write(&self, tables: &mut Tables, entries: &[Entry]) {
        for place in entries.iter().filter_map(taken_by).filter(|_| self.is_shared) {
            tables.take(place, self.incarnation);
        }
        tables.durable.extend(entries.iter().cloned());
    }

    /// Fails to commit the first jobs of the queue. Their entries may be on the disk all the same: a server of its
    /// own finds them only after a restart, whereas others of several see them at once. Returns the entries that
    /// others see.
    pub(crate) fn fail(&self, jobs: usize, is_on_disk: bool) -> Vec<Entry> {
        let mut state = self.state();
        let mut tables = self.database.tables();
        state.has_failed = true;
        let mut seen = Vec::new();
        for job in state.queue.drain(..jobs).collect::<Vec<_>>() {
            if is_on_disk && !state.continues_broken(&job.entries) {
                if !self.is_shared {
                    state.limbo.extend(job.entries.iter().cloned());
                } else if tables.knows(self.incarnation) {
                    seen.extend(job.entries.iter().cloned());
                }
            }
            state.telling.push_back((job, Err(Lost::Failed)));
        }
        self.write(&mut tables, &seen);
        seen
    }

    /// Stores nothing any more, as others have taken over the work of this server.
    pub(crate) fn set_excluded(&self) {
        self.state().has_failed = true;
    }

    /// True if the first job of the queue has entries to refuse.
    pub(crate) fn can_refuse(&self) -> bool {
        let state = self.state();
        state.telling.is_empty() && state.queue.front().is_some_and(|job| !job.entries.is_empty())
    }

    /// Refuses only the first job of the queue.
    pub(crate) fn refuse(&self) {
        let mut state = self.state();
        let Some(job) = state.queue.pop_front() else { return };
        // No job of an episode comes before its opening is stored.
        if !job.entries.iter().any(|entry| matches!(entry, Entry::Open(_))) {
            state.broken.extend(job.entries.iter().filter_map(Entry::chain));
        }
        state.telling.push_back((job, Err(Lost::Refused)));
    }

    /// Delivers the oldest undelivered result.
    pub(crate) fn next_result(&self) -> Option<JobResult> {
        let (job, result) = self.state().telling.pop_front()?;
        if self.flaw == Some(Flaw::ForgetsToTell) && self.state().dice.below(20) == 0 {
            // The callback is neither called nor dropped.
            std::mem::forget(job.committed);
            return None;
        }
        if self.is_shared && result.is_ok() {
            self.places.gained(job.entries.iter().filter_map(taken_by));
        }
        (job.committed)(result.map_err(StoreError::from));
        Some(JobResult { entries: job.entries, result })
    }

    /// Loses all that is not durable; returns entries that were on the disk without anybody's knowledge.
    pub(crate) fn crash(&self) -> Vec<Entry> {
        let mut state = self.state();
        let mut found = std::mem::take(&mut state.limbo);
        if self.flaw == Some(Flaw::TearsPieces)
            && let Some(job) = state.queue.front()
        {
            found.extend(job.entries.iter().skip(1).cloned());
        }
        self.database.tables().durable.extend(found.iter().cloned());
        state.has_failed = false;
        state.broken.clear();
        let lost = (std::mem::take(&mut state.queue), std::mem::take(&mut state.telling));
        state.handed.clear();
        drop(state);
        // The waiters of these jobs notice the drop, so the lock must be free.
        drop(lost);
        found
    }

    /// Accesses the database. Other tasks may run before it, and before the caller continues.
    pub(crate) async fn at_database<T>(&self, work: impl FnOnce(&mut Tables) -> T) -> T {
        let (before, after) = {
            let dice = &mut self.state().dice;
            (dice.below(self.pauses_max + 1), dice.below(self.pauses_max + 1))
        };
        pause(before).await;
        let done = work(&mut self.database.tables());
        pause(after).await;
        done
    }

    /// Reads the durable data at once.
    pub(crate) fn with_tables<T>(&self, look: impl FnOnce(&Tables) -> T) -> T {
        look(&self.database.tables())
    }

    async fn read<T>(&self, look: impl FnOnce(&Tables) -> T) -> T {
        self.at_database(|tables| look(tables)).await
    }

    // ---- places of a server of a cluster

    pub(crate) const fn places(&self) -> &Places {
        &self.places
    }

    /// Changes the places in the database, and then this server's knowledge of them. The next change waits for both.
    async fn change_places<T>(
        &self,
        change: impl FnOnce(&mut Tables) -> T,
        note: impl FnOnce(&Places, &T),
    ) -> T {
        let _taking = self.takes.lock().await;
        let done = self.at_database(change).await;
        note(&self.places, &done);
        done
    }

    /// Takes a place without an owner; returns the owner. All unfinished games there will be continued, even if the
    /// caller is gone.
    pub(crate) async fn take_place(&self, place: Place) -> Result<Incarnation, StoreError> {
        if self.flaw != Some(Flaw::ForgetsWhatItTook) {
            self.places.note_taken([place]);
        }
        self.take_noted(place).await
    }

    /// Takes a place like [`MemoryJournal::take_place`], for a caller that continues its games.
    pub(crate) async fn take_noted(&self, place: Place) -> Result<Incarnation, StoreError> {
        let me = self.incarnation;
        let is_old = self.flaw == Some(Flaw::TakesByAnOldView);
        let before = if is_old { self.read(|tables| tables.owner(place)).await } else { None };
        let take = |tables: &mut Tables| match before {
            Some(owner) => Some(owner),
            None if is_old => tables.put(place, me).then_some(me),
            None => tables.take(place, me),
        };
        let note = move |places: &Places, owner: &Option<Incarnation>| {
            if *owner == Some(me) {
                places.confirmed([place]);
            }
        };
        if self.flaw == Some(Flaw::NotesPlacesLate) {
            let owner = self.change_places(take, |_, _| ()).await;
            pause(30).await;
            note(&self.places, &owner);
            return owner.ok_or(StoreError::Failed);
        }
        self.change_places(take, note).await.ok_or(StoreError::Failed)
    }

    /// Completes a release that [`Places::leave`] has begun.
    pub(crate) async fn release(&self, place: Place) {
        let release = |tables: &mut Tables| tables.release(place, self.incarnation);
        self.change_places(release, |places, ()| places.lost([place])).await;
    }

    /// Gives back all places at which everything has ended.
    pub(crate) async fn release_ended(&self) {
        let release = |tables: &mut Tables| tables.release_ended(self.incarnation);
        let note = |places: &Places, ended: &Vec<Place>| places.lost(ended.iter().copied());
        self.change_places(release, note).await;
    }
}

/// The place that an entry takes for its writer.
fn taken_by(entry: &Entry) -> Option<Place> {
    match entry {
        Entry::Open(row) => Some(Place::Game(row.episode)),
        _ => None,
    }
}

impl State {
    /// True if a job continues an episode whose chain would have a gap.
    fn continues_broken(&self, entries: &[Entry]) -> bool {
        entries.iter().filter_map(Entry::chain).any(|episode| self.broken.contains(&episode))
    }
}

fn stored(row: &ActRow) -> StoredAct {
    let bytes = row.record.as_str().len() as u64;
    StoredAct { record: record(row), bytes, waiting_for: row.waiting_for }
}

/// The act without its texts, which is enough for a replay.
fn without_texts(row: &ActRow) -> StoredAct {
    let mut act = stored(row);
    (act.record.response, act.record.reasoning) = (None, None);
    act
}

impl EpisodeStore for MemoryJournal {
    fn append(&self, entries: Vec<Entry>, committed: Committed) {
        let mut state = self.state();
        state.handed.push(entries.clone());
        let early = match self.flaw {
            Some(Flaw::AcknowledgesEarly) => true,
            Some(Flaw::DoesNotWait) => entries.is_empty() && !state.has_failed,
            _ => false,
        };
        if early {
            state.queue.push_back(Job { entries, committed: Box::new(drop) });
            drop(state);
            committed(Ok(()));
        } else {
            state.queue.push_back(Job { entries, committed });
        }
    }

    fn has(&self, place: Place) -> bool {
        !self.is_shared || self.places.has(place)
    }

    fn take(&self, place: Place) -> Reply<'_, bool> {
        async move {
            self.take_place(place).await?;
            Ok(self.has(place))
        }
        .boxed()
    }

    fn recovered(&self, episode: EpisodeKey) {
        self.state().broken.remove(&episode);
    }

    fn episode(&self, id: EpisodeId) -> Reply<'_, Option<StoredEpisode>> {
        let forgets = self.flaw == Some(Flaw::ForgetsTheLastAct);
        Box::pin(self.read(move |state| {
            let mut found = state.openings().find(|row| row.id == id).map(|row| state.episode(row));
            if let Some(episode) = found.as_mut().filter(|_| forgets) {
                episode.last_act_at = None;
            }
            Ok(found)
        }))
    }

    fn entrant(&self, _: RunKey) -> Reply<'_, Option<(CompetitionKey, OwnerKey)>> {
        Box::pin(std::future::ready(Ok(None)))
    }

    fn unfinished(&self) -> Reply<'_, Vec<Unfinished>> {
        let haunted = self.flaw == Some(Flaw::ListsAGhost);
        Box::pin(self.read(move |state| {
            let mut all = state.unfinished();
            if haunted {
                all.push(Unfinished {
                    episode: EpisodeKey(1_000),
                    id: EpisodeId::from_text("ep_ghost".to_owned()),
                    owner: None,
                    run: None,
                    clocked: true,
                    played: None,
                });
            }
            all.sort_by_key(|episode| (!episode.clocked, episode.episode));
            Ok(all)
        }))
    }

    fn holders(&self, episode: EpisodeKey) -> Reply<'_, Vec<Held>> {
        let forgets = self.flaw == Some(Flaw::ForgetsClaims);
        Box::pin(self.read(move |state| {
            let claims = state.claims(episode).filter(|row| !forgets || row.holder.number == 0);
            Ok(claims.map(|row| (row.holder.clone(), row.agents.clone())).collect())
        }))
    }

    fn key_id(&self, owner: OwnerKey) -> Reply<'_, Option<String>> {
        Box::pin(self.read(move |_| Ok(Some(format!("key_{}", owner.0)))))
    }

    fn acts(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<(u32, RoundActs)>> {
        Box::pin(self.read(move |state| {
            let mut rows: Vec<&ActRow> =
                state.acts(episode).filter(|row| (from..to).contains(&row.round)).collect();
            rows.sort_by_key(|row| (row.round, row.agent));
            let by_round = rows.chunk_by(|a, b| a.round == b.round);
            Ok(by_round
                .map(|rows| {
                    let acts = rows.iter().map(|row| (row.agent, without_texts(row)));
                    (rows[0].round, acts.collect())
                })
                .collect())
        }))
    }

    fn round_acts(&self, episode: EpisodeKey, round: u32) -> Reply<'_, RoundActs> {
        Box::pin(self.read(move |state| {
            let acts = state.acts(episode).filter(|row| row.round == round);
            let mut acts: RoundActs = acts.map(|row| (row.agent, stored(row))).collect();
            acts.sort_by_key(|(agent, _)| *agent);
            Ok(acts)
        }))
    }

    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> Reply<'_, Option<StoredAct>> {
        let flaw = self.flaw;
        Box::pin(self.read(move |state| {
            let found = state.acts(episode).find(|row| row.round == round && row.agent == agent);
            let mut found = found.map(stored);
            match flaw {
                Some(Flaw::ForgetsEarlierActs) => found = None,
                Some(Flaw::FindsAnotherReceipt) => {
                    found = found.map(|act| StoredAct { waiting_for: act.waiting_for + 1, ..act });
                }
                _ => {}
            }
            Ok(found)
        }))
    }

    fn rounds(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<StoredRound>> {
        Box::pin(self.read(move |state| {
            let rows = state.rounds(episode).filter(|row| (from..to).contains(&row.round));
            let round = |row: &RoundRow| StoredRound {
                round: row.round,
                digest: row.digest,
                score: row.score,
                head: row.head,
            };
            Ok(rows.map(round).collect())
        }))
    }
}
