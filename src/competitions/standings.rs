//! Standings of all competitions, read once and updated with what is committed. The end of a game costs one entrant's attempts,
//! however many other entrants there are.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use jiff::Timestamp;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use tokio::sync::Mutex;

use super::field::Field;
use super::{StoredCompetition, StoredEntrant, entrants_among, list_entrants};
use crate::ids::{CompetitionKey, EntryKey, RunKey};
use crate::store::results::{Change, LogPosition};
use crate::store::{Store, StoreError};
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::entrant::Entrant;
use swarmbench_boards::competition::standings::{Attempt, Part, Played};

/// Expected boards: one per competition, or a few if a part of it is hidden.
const BOARDS: usize = 100;

/// Rows of one query: attempts, entrants or changes.
const CHUNK: u32 = 256;

/// Entrant with its attempts.
pub type EntrantAttempts = (Arc<Entrant>, Arc<Played>);

#[derive(Debug)]
pub struct CompetitionStandings {
    store: Store,
    boards: Cache<Key, Cached, ByBytes>,
    /// Number of versions of all boards so far.
    versions: AtomicU64,
}

/// Version of a board: equal versions have equal content.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Version(u64);

/// Identity of a board: the part of the seeds, and the time before which attempts must have ended.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Key {
    competition: CompetitionKey,
    part: Part,
    before: Option<Timestamp>,
}

/// Board, with its bytes at the time when it entered the cache.
#[derive(Clone, Debug)]
struct Cached {
    board: Arc<Mutex<Content>>,
    bytes: u64,
}

#[derive(Debug)]
struct Content {
    version: Version,
    /// Position in the log of changes up to which changes are included.
    position: LogPosition,
    first_read: FirstRead,
    places: BTreeMap<EntryKey, EntrantAttempts>,
}

/// Progress of the first read. It survives a dropped request, so that the next one continues.
#[derive(Clone, Copy, Debug)]
enum FirstRead {
    /// Attempts up to this one were read.
    UpTo(Option<RunKey>),
    Complete,
}

#[derive(Clone, Debug)]
struct ByBytes;

impl Weighter<Key, Cached> for ByBytes {
    fn weight(&self, _: &Key, cached: &Cached) -> u64 {
        cached.bytes
    }
}

impl CompetitionStandings {
    pub fn new(store: Store, bytes_max: u64) -> Self {
        let boards = Cache::with_weighter(BOARDS, bytes_max, ByBytes);
        Self { store, boards, versions: AtomicU64::default() }
    }

    fn new_version(&self) -> Version {
        Version(self.versions.fetch_add(1, Ordering::Relaxed) + 1)
    }

    /// Entrants with their attempts on a part of the seeds, as far as they ended before a time or at all, including everything
    /// that is durable now. `None` if the content still has the known version.
    pub async fn places(
        &self,
        competition: &StoredCompetition,
        part: Part,
        before: Option<Timestamp>,
        known: Option<Version>,
    ) -> Result<Option<(Version, Vec<EntrantAttempts>)>, StoreError> {
        let key = Key { competition: competition.key, part, before };
        let new = || {
            let position = self.store.writer().changes().position();
            let content = Content::new(position, self.new_version());
            let bytes = content.bytes();
            Ok::<_, StoreError>(Cached { board: Arc::new(Mutex::new(content)), bytes })
        };
        let cached = self.boards.get_or_insert_with(&key, new)?;
        let mut content = cached.board.lock().await;
        self.catch_up(competition, &key, &mut content).await?;
        let version = content.version;
        if known == Some(version) {
            return Ok(None);
        }
        let places = content.places.values().cloned().collect();
        let bytes = content.bytes();
        drop(content);
        if bytes != cached.bytes {
            // Updates the weight. A board that is too large for the cache is read again by each request.
            self.boards.insert(key, Cached { board: cached.board, bytes });
        }
        Ok(Some((version, places)))
    }

    /// Reads the changes since the last call. The caller may be dropped at any moment; the next one continues.
    async fn catch_up(
        &self,
        competition: &StoredCompetition,
        key: &Key,
        content: &mut Content,
    ) -> Result<(), StoreError> {
        let log = self.store.writer().changes();
        let (end, missed) = log.since(content.position);
        // Changes of a definition by an organizer do not concern scores.
        if missed.is_none() {
            *content = Content::new(end, self.new_version());
        }
        while let FirstRead::UpTo(after) = content.first_read {
            self.add_entrants(competition, content).await?;
            let found = self.store.list_attempts(competition.key, None, after, CHUNK).await?;
            let last = found.last().map(|attempt| attempt.run);
            let entries: BTreeSet<_> = found.iter().map(|attempt| attempt.entry).collect();
            let entries: Vec<_> = entries.into_iter().collect();
            let entrants = entrants_among(&self.store, competition.key, &entries).await?;
            let field = Field::read(&self.store, competition, &entrants, found).await?;
            for pair in &field.attempts {
                if let Some((entrant, played)) = content.places.get_mut(&pair.0.entry) {
                    let attempt = key.part_of(&competition.definition, field.attempt(pair)?);
                    content.version = self.new_version();
                    Arc::make_mut(played).add(&competition.definition, entrant, &attempt);
                }
            }
            content.first_read =
                last.map_or(FirstRead::Complete, |last| FirstRead::UpTo(Some(last)));
        }
        let (end, Some(changes)) = log.since(content.position) else { return Ok(()) };
        self.add_entrants(competition, content).await?;
        let changed = self.changed_entrants(competition.key, changes).await?;
        for some in changed.chunks(CHUNK as usize) {
            let entrants = entrants_among(&self.store, competition.key, some).await?;
            for stored in entrants {
                let place = self.place(competition, key, &stored).await?;
                // Most games that end are not the last of their attempt, and change nothing here.
                if content.places.get(&stored.key) != Some(&place) {
                    content.places.insert(stored.key, place);
                    content.version = self.new_version();
                }
            }
        }
        content.position = end;
        Ok(())
    }

    /// Adds the entrants that registered since the last call.
    async fn add_entrants(
        &self,
        competition: &StoredCompetition,
        content: &mut Content,
    ) -> Result<(), StoreError> {
        loop {
            let after = content.places.last_key_value().map(|(&entry, _)| entry);
            let found = list_entrants(&self.store, competition.key, None, after, CHUNK).await?;
            let is_last = found.len() < CHUNK as usize;
            for StoredEntrant { key, entrant, .. } in found {
                content.version = self.new_version();
                content.places.insert(key, (Arc::new(entrant), Arc::default()));
            }
            if is_last {
                return Ok(());
            }
        }
    }

    /// Entrants that some changes concern, perhaps including those of other competitions.
    async fn changed_entrants(
        &self,
        competition: CompetitionKey,
        changes: Vec<Change>,
    ) -> Result<Vec<EntryKey>, StoreError> {
        let mut entries = BTreeSet::new();
        for some in changes.chunks(CHUNK as usize) {
            let (mut runs, mut episodes) = (Vec::new(), Vec::new());
            for change in some {
                match *change {
                    Change::Run(run) => runs.push(run),
                    Change::Episode(episode) => episodes.push(episode),
                    Change::Entrant(entry) | Change::Started(entry) => drop(entries.insert(entry)),
                    Change::Imports | Change::Revealed => {}
                }
            }
            if !(runs.is_empty() && episodes.is_empty()) {
                entries.extend(self.store.entrants_of(competition, &runs, &episodes).await?);
            }
        }
        Ok(entries.into_iter().collect())
    }

    /// Reads an entrant with all of its attempts.
    async fn place(
        &self,
        competition: &StoredCompetition,
        key: &Key,
        stored: &StoredEntrant,
    ) -> Result<EntrantAttempts, StoreError> {
        let own = std::slice::from_ref(stored);
        let field = Field::of_entrants(&self.store, competition, own).await?;
        let mut played = Played::default();
        for pair in &field.attempts {
            let attempt = key.part_of(&competition.definition, field.attempt(pair)?);
            played.add(&competition.definition, &stored.entrant, &attempt);
        }
        Ok((Arc::new(stored.entrant.clone()), Arc::new(played)))
    }
}

impl Key {
    /// Part of an attempt that this board shows.
    fn part_of(&self, definition: &Definition, attempt: Attempt) -> Attempt {
        let mut attempt = attempt.part(definition, self.part);
        if let Some(before) = self.before {
            attempt.is_over &= attempt.ended_at.is_some_and(|at| at < before);
        }
        attempt
    }
}

impl Content {
    const fn new(position: LogPosition, version: Version) -> Self {
        Self { version, position, first_read: FirstRead::UpTo(None), places: BTreeMap::new() }
    }

    /// Approximate bytes in memory.
    fn bytes(&self) -> u64 {
        let place = |(entrant, played): &EntrantAttempts| {
            size_of::<EntrantAttempts>() + size_of::<EntryKey>() + entrant.bytes() + played.bytes()
        };
        (size_of::<Self>() + self.places.values().map(place).sum::<usize>()) as u64
    }
}
