//! A journal in memory. Nothing becomes durable, and no result is delivered, before the run says so: a crash
//! can come between any two of these.

use std::collections::{BTreeSet, VecDeque};
use std::sync::{Mutex, MutexGuard};

use swarmbench::episode::Status;
use swarmbench::ids::{CompetitionKey, EpisodeId, EpisodeKey, RunKey};
use swarmbench::keys::OwnerKey;
use swarmbench::store::StoreError;
use swarmbench::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, Held, OpeningRow, RoundRow, SeatingRow,
};
use swarmbench::store::port::{
    Committed, EpisodeStore, Reply, RoundActs, StoredAct, StoredEpisode, StoredRound, Unfinished,
};
use swarmbench_engine::AgentId;
use swarmbench_journal::record::{ActRecord, Source};

use crate::broken::Flaw;
use crate::dice::Dice;
use crate::executor::pause;

/// Keeps entries in the order in which they were handed over, all of a job or none. It judges nothing:
/// what should not have been handed over is for the checker to find. It refuses single jobs when the run says
/// so, and then, as the writer does, all later ones of that episode until it was recovered.
pub(crate) struct MemoryJournal {
    flaw: Option<Flaw>,
    pauses_max: usize,
    state: Mutex<State>,
}

struct State {
    /// What survives a crash.
    durable: Vec<Entry>,
    /// What a failed commit left on the disk all the same: it is found after a restart.
    limbo: Vec<Entry>,
    /// Jobs that are not durable yet.
    queue: VecDeque<Job>,
    /// Jobs that are, of which nobody was told.
    telling: VecDeque<(Job, Result<(), Lost>)>,
    /// What was handed over since somebody asked.
    handed: Vec<Vec<Entry>>,
    has_failed: bool,
    /// Episodes of which a job was refused and that were not recovered since.
    broken: BTreeSet<EpisodeKey>,
    dice: Dice,
}

struct Job {
    entries: Vec<Entry>,
    committed: Committed,
}

/// A job of which the one who handed it over was told now.
pub(crate) struct JobResult {
    pub(crate) entries: Vec<Entry>,
    pub(crate) result: Result<(), Lost>,
}

/// Why a job was not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lost {
    /// Its commit failed, or an earlier one.
    Failed,
    /// It was refused, or an earlier one of its episode.
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
    /// An empty journal; a read lets others go first up to `pauses_max` times, before and after.
    pub(crate) fn new(seed: u64, pauses_max: usize, flaw: Option<Flaw>) -> Self {
        let state = State {
            durable: Vec::new(),
            limbo: Vec::new(),
            queue: VecDeque::new(),
            telling: VecDeque::new(),
            handed: Vec::new(),
            has_failed: false,
            broken: BTreeSet::new(),
            dice: Dice(seed),
        };
        Self { flaw, pauses_max, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("one thread")
    }

    /// What was handed over since this was last asked, by job.
    pub(crate) fn take_handed(&self) -> Vec<Vec<Entry>> {
        std::mem::take(&mut self.state().handed)
    }

    /// How many jobs wait to be durable. The next group begins when all results of the one before are delivered.
    pub(crate) fn queued(&self) -> usize {
        let state = self.state();
        if state.telling.is_empty() { state.queue.len() } else { 0 }
    }

    /// How many jobs are to be told.
    pub(crate) fn untold(&self) -> usize {
        self.state().telling.len()
    }

    /// Whether a commit failed since the start.
    pub(crate) fn has_failed(&self) -> bool {
        self.state().has_failed
    }

    /// Makes the first jobs of the queue durable, all of them or none; returns what is durable now
    /// and was not before.
    pub(crate) fn commit(&self, jobs: usize) -> Vec<Entry> {
        let mut state = self.state();
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
        state.durable.extend(kept.iter().cloned());
        kept
    }

    /// Fails to commit the first jobs of the queue. What they held may be on the disk all the same,
    /// where it is found only after a restart.
    pub(crate) fn fail(&self, jobs: usize, is_on_disk: bool) {
        let mut state = self.state();
        state.has_failed = true;
        for job in state.queue.drain(..jobs).collect::<Vec<_>>() {
            if is_on_disk && !state.continues_broken(&job.entries) {
                state.limbo.extend(job.entries.iter().cloned());
            }
            state.telling.push_back((job, Err(Lost::Failed)));
        }
    }

    /// Whether the first job of the queue holds anything that could be refused.
    pub(crate) fn can_refuse(&self) -> bool {
        let state = self.state();
        state.telling.is_empty() && state.queue.front().is_some_and(|job| !job.entries.is_empty())
    }

    /// Refuses the first job of the queue, and no other.
    pub(crate) fn refuse(&self) {
        let mut state = self.state();
        let Some(job) = state.queue.pop_front() else { return };
        // Nothing comes after an opening before it was kept.
        if !job.entries.iter().any(|entry| matches!(entry, Entry::Open(_))) {
            state.broken.extend(job.entries.iter().filter_map(Entry::chain));
        }
        state.telling.push_back((job, Err(Lost::Refused)));
    }

    /// Delivers the result of the oldest job whose result is not delivered.
    pub(crate) fn next_result(&self) -> Option<JobResult> {
        let (job, result) = self.state().telling.pop_front()?;
        if self.flaw == Some(Flaw::ForgetsToTell) && self.state().dice.below(20) == 0 {
            // It will never be called, and never dropped.
            std::mem::forget(job.committed);
            return None;
        }
        (job.committed)(result.map_err(StoreError::from));
        Some(JobResult { entries: job.entries, result })
    }

    /// What is lost is lost; returns what was on the disk though nobody knew.
    pub(crate) fn crash(&self) -> Vec<Entry> {
        let mut state = self.state();
        let mut found = std::mem::take(&mut state.limbo);
        if self.flaw == Some(Flaw::TearsPieces)
            && let Some(job) = state.queue.front()
        {
            found.extend(job.entries.iter().skip(1).cloned());
        }
        state.durable.extend(found.iter().cloned());
        state.has_failed = false;
        state.broken.clear();
        let lost = (std::mem::take(&mut state.queue), std::mem::take(&mut state.telling));
        state.handed.clear();
        drop(state);
        // The remaining waiters of these notice the drop, without a lock.
        drop(lost);
        found
    }

    /// All that survives a crash, in its order.
    pub(crate) fn durable(&self) -> Vec<Entry> {
        self.state().durable.clone()
    }

    /// The number of the newest episode, 0 where there is none.
    pub(crate) fn last_key(&self) -> i64 {
        self.state().openings().map(|row| row.episode.0).max().unwrap_or(0)
    }

    /// How many bytes the acts of all episodes of each key take.
    pub(crate) fn bytes_by_owner(&self) -> Vec<(OwnerKey, u64)> {
        let state = self.state();
        let owned = state.openings().filter_map(|row| Some((row.owner?, row.episode)));
        owned
            .map(|(owner, key)| {
                let acts = state.acts(key).map(|row| row.record.as_str().len() as u64);
                (owner, acts.sum())
            })
            .collect()
    }

    /// Reads: others may go first before it, and before the caller continues.
    async fn read<T>(&self, look: impl FnOnce(&State) -> T) -> T {
        let (before, after) = {
            let dice = &mut self.state().dice;
            (dice.below(self.pauses_max + 1), dice.below(self.pauses_max + 1))
        };
        pause(before).await;
        let found = look(&self.state());
        pause(after).await;
        found
    }
}

impl State {
    /// Whether a job continues the chain of an episode whose chain would have a gap.
    fn continues_broken(&self, entries: &[Entry]) -> bool {
        entries.iter().filter_map(Entry::chain).any(|episode| self.broken.contains(&episode))
    }

    fn openings(&self) -> impl Iterator<Item = &OpeningRow> {
        self.durable.iter().filter_map(|entry| match entry {
            Entry::Open(row) => Some(&**row),
            _ => None,
        })
    }

    fn acts(&self, key: EpisodeKey) -> impl Iterator<Item = &ActRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Act(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    fn rounds(&self, key: EpisodeKey) -> impl Iterator<Item = &RoundRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Round(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    fn end(&self, key: EpisodeKey) -> Option<&EndRow> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::End(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    fn seating(&self, key: EpisodeKey) -> Option<&SeatingRow> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::Seat(row) if row.episode == key => Some(row),
            _ => None,
        })
    }

    fn claims(&self, key: EpisodeKey) -> impl Iterator<Item = &ClaimRow> {
        self.durable.iter().filter_map(move |entry| match entry {
            Entry::Claim(row) if row.episode == key => Some(&**row),
            _ => None,
        })
    }

    fn started_at(&self, key: EpisodeKey) -> Option<jiff::Timestamp> {
        self.durable.iter().find_map(|entry| match entry {
            Entry::Start { episode, at } if *episode == key => Some(*at),
            _ => None,
        })
    }

    fn episode(&self, row: &OpeningRow) -> StoredEpisode {
        let key = row.episode;
        let (last, end, started_at) =
            (self.rounds(key).last(), self.end(key), self.started_at(key));
        let status = match end {
            Some(end) => end.status,
            None if row.waiting && started_at.is_none() => Status::Waiting.name(),
            None => Status::Running.name(),
        };
        let by_player = |act: &&ActRow| record(act).source == Source::Player;
        StoredEpisode {
            episode: key,
            id: row.id.clone(),
            owner: row.owner,
            run: row.run.map(|(run, _)| run),
            revealed: false,
            own_games: false,
            opening: row.record.clone(),
            first_round: row.fork.map_or(0, |(_, round)| round),
            seating: self.seating(key).map(|row| row.record.clone()),
            status: status.to_owned(),
            reason: end.map(|end| end.reason.to_owned()),
            end: end.map(|end| end.record.clone()),
            head: match (end, last, self.seating(key)) {
                (Some(end), ..) => end.head,
                (None, Some(round), _) => round.head,
                (None, None, Some(seating)) => seating.head,
                (None, None, None) => row.head,
            },
            rounds: last.map_or(0, |round| round.round + 1),
            score: last.map_or(0.0, |round| round.score),
            created_at: row.at,
            newest_at: (self.rounds(key).map(|round| round.at))
                .chain(self.acts(key).map(|act| act.at))
                .chain(started_at)
                .chain(end.map(|end| end.at))
                .fold(row.at, jiff::Timestamp::max),
            last_act_at: self.acts(key).filter(by_player).map(|act| act.at).max().or(started_at),
            ended_at: end.map(|end| end.at),
            void_reason: None,
            act_bytes: None,
        }
    }
}

fn record(row: &ActRow) -> ActRecord {
    row.record.read().expect("it was written as an act")
}

fn stored(row: &ActRow) -> StoredAct {
    let bytes = row.record.as_str().len() as u64;
    StoredAct { record: record(row), bytes, waiting_for: row.waiting_for }
}

/// As a replay needs it.
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
            let unfinished = |row: &OpeningRow| Unfinished {
                run: None,
                episode: row.episode,
                id: row.id.clone(),
                owner: row.owner,
                clocked: row.clocked,
                played: None,
            };
            let running = state.openings().filter(|row| state.end(row.episode).is_none());
            let mut all: Vec<_> = running.map(unfinished).collect();
            if haunted {
                all.push(Unfinished {
                    episode: EpisodeKey(1_000),
                    id: EpisodeId::from_text("ep_ghost".to_owned()),
                    owner: None,
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
