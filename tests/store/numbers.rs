//! Numbers that an engine gives to rows. PostgreSQL leaves gaps where an insert was refused, so histories have numbers of
//! their own, and each engine its own for the same rows.

use std::collections::HashMap;

use swarmbench::ids::{CompetitionKey, EntryKey, ImportKey};
use swarmbench::keys::{KeyRow, OwnerKey};
use swarmbench::store::Store;
use swarmbench::store::competitions::Declared;
use swarmbench::store::entries::{
    AuditRow, ClaimRow, EntrantFacts, EntrantRow, Entry, Holder, OpeningRow, RunRow,
};
use swarmbench::store::imports::ImportFilter;

/// Added to the number of a row that is not stored: no engine gives such a number.
const FAR: i64 = 7_000_000_000;

/// The number, in a history, of what is never stored.
pub(crate) const UNKNOWN: i64 = 1_000_000;

/// The public ids of rows, each at the place that is its number in a history.
#[derive(Default)]
pub(crate) struct Names {
    pub(crate) keys: Vec<String>,
    pub(crate) competitions: Vec<String>,
    pub(crate) entries: Vec<String>,
    pub(crate) imports: Vec<String>,
}

/// The numbers of the rows of one table.
#[derive(Default)]
struct Table {
    /// Number in the engine, by the number in the history.
    own: HashMap<i64, i64>,
    /// Number in the history, by the number in the engine.
    common: HashMap<i64, i64>,
}

impl Table {
    fn new(names: &[String], rows: impl Iterator<Item = (String, i64)>) -> Self {
        let places: HashMap<_, _> = names.iter().zip(0_i64..).collect();
        let mut table = Self::default();
        for (id, number) in rows {
            if let Some(place) = places.get(&id) {
                table.own.insert(*place, number);
                table.common.insert(number, *place);
            }
        }
        table
    }

    fn own(&self, number: i64) -> i64 {
        self.own.get(&number).copied().unwrap_or_else(|| number.saturating_add(FAR))
    }
}

/// The store of one engine, and its numbers.
pub(crate) struct Side {
    pub(crate) store: Store,
    keys: Table,
    competitions: Table,
    entries: Table,
    imports: Table,
    /// The numbers of the games that wait to be measured, in order.
    queue: Vec<i64>,
}

impl Side {
    pub(crate) fn of(store: Store) -> Self {
        let [keys, competitions, entries, imports] = [(); 4].map(|()| Table::default());
        Self { store, keys, competitions, entries, imports, queue: Vec::new() }
    }

    /// Looks up the numbers of all rows.
    pub(crate) async fn learn(&mut self, names: &Names) {
        let store = &self.store;
        let keys = store.keys().await.expect("keys are read");
        let keys = keys.into_iter().map(|key| (key.id, key.number.expect("it is stored").0));
        self.keys = Table::new(&names.keys, keys);
        let competitions = store.list_competitions(true, None, u32::MAX).await.expect("read");
        let mut entries = Vec::new();
        let nowhere = CompetitionKey(UNKNOWN + FAR);
        for competition in competitions.iter().map(|competition| competition.key).chain([nowhere]) {
            let all = store.entrants(competition, None, Declared::Short).await.expect("read");
            entries.extend(all.into_iter().map(|entrant| (entrant.id, entrant.key.0)));
        }
        self.entries = Table::new(&names.entries, entries.into_iter());
        let competitions = competitions.into_iter().map(|one| (one.id, one.key.0));
        self.competitions = Table::new(&names.competitions, competitions);
        let imports =
            store.list_imports(&ImportFilter::default(), None, u32::MAX).await.expect("read");
        let imports = imports.into_iter().map(|import| (import.id, import.key.0));
        self.imports = Table::new(&names.imports, imports);
        let queue = store.unmeasured(u32::MAX).await.expect("read");
        self.queue = queue.into_iter().map(|game| game.number).collect();
    }

    pub(crate) fn owner(&self, key: OwnerKey) -> OwnerKey {
        OwnerKey(self.keys.own(key.0))
    }

    pub(crate) fn competition(&self, key: CompetitionKey) -> CompetitionKey {
        CompetitionKey(self.competitions.own(key.0))
    }

    pub(crate) fn entry(&self, key: EntryKey) -> EntryKey {
        EntryKey(self.entries.own(key.0))
    }

    pub(crate) fn import(&self, key: ImportKey) -> ImportKey {
        ImportKey(self.imports.own(key.0))
    }

    /// The common number of a key.
    pub(crate) fn common_key(&self, own: i64) -> i64 {
        self.keys.common.get(&own).copied().unwrap_or(own)
    }

    /// The place in the queue of a game that waits to be measured.
    pub(crate) fn place_in_queue(&self, number: i64) -> Option<usize> {
        self.queue.iter().position(|queued| *queued == number)
    }

    pub(crate) fn queued(&self) -> usize {
        self.queue.len()
    }

    /// The numbers, in a history, of the rows that are stored: keys, competitions, entrants and imports.
    pub(crate) fn stored(&self) -> [Vec<i64>; 4] {
        [&self.keys, &self.competitions, &self.entries, &self.imports].map(|table| {
            let mut numbers: Vec<_> = table.own.keys().copied().collect();
            numbers.sort_unstable();
            numbers
        })
    }

    /// A text with the common numbers in place of those of this engine.
    pub(crate) fn common(&self, text: &str) -> String {
        let mut common = String::with_capacity(text.len());
        let mut rest = text;
        loop {
            let kinds = [
                ("OwnerKey(", &self.keys),
                ("CompetitionKey(", &self.competitions),
                ("EntryKey(", &self.entries),
                ("ImportKey(", &self.imports),
            ];
            let found = kinds.into_iter().filter_map(|(name, table)| {
                rest.find(name).map(|place| (place + name.len(), table))
            });
            let Some((place, table)) = found.min_by_key(|(place, _)| *place) else { break };
            common.push_str(&rest[..place]);
            rest = &rest[place..];
            let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
            let number = rest[..end].parse::<i64>().ok();
            match number.and_then(|number| table.common.get(&number)) {
                Some(number) => common.push_str(&number.to_string()),
                None => common.push_str(&rest[..end]),
            }
            rest = &rest[end..];
        }
        common.push_str(rest);
        common
    }

    /// An entry of a history with the numbers of this engine.
    pub(crate) fn own(&self, entry: &Entry) -> Entry {
        let owner = |key: Option<OwnerKey>| key.map(|key| self.owner(key));
        match entry.clone() {
            Entry::Open(row) => {
                let owner = owner(row.owner);
                Entry::Open(Box::new(OpeningRow { owner, ..*row }))
            }
            Entry::Claim(row) => {
                let owner = owner(row.holder.owner);
                let holder = Holder { owner, ..row.holder };
                Entry::Claim(Box::new(ClaimRow { holder, ..*row }))
            }
            Entry::AddKey(row) => {
                let acts_for = owner(row.acts_for);
                Entry::AddKey(Box::new(KeyRow { acts_for, ..*row }))
            }
            Entry::OpenRun(row) => {
                let owner = owner(row.owner);
                let attempt = row.attempt.map(|(entry, number)| (self.entry(entry), number));
                Entry::OpenRun(Box::new(RunRow { owner, attempt, ..*row }))
            }
            Entry::AddEntrant(row) => {
                let competition = self.competition(row.competition);
                Entry::AddEntrant(Box::new(EntrantRow { competition, ..*row }))
            }
            Entry::SetEntrant { entry, status, reason, vouched } => {
                Entry::SetEntrant { entry: self.entry(entry), status, reason, vouched }
            }
            Entry::DescribeEntrant(facts) => {
                let entry = self.entry(facts.entry);
                Entry::DescribeEntrant(Box::new(EntrantFacts { entry, ..*facts }))
            }
            Entry::RenameEntrant { entry, name, by_itself } => {
                Entry::RenameEntrant { entry: self.entry(entry), name, by_itself }
            }
            Entry::EraseEntrant { entry, name, at } => {
                Entry::EraseEntrant { entry: self.entry(entry), name, at }
            }
            Entry::ChangeCompetition { competition, definition, closes_at, hidden } => {
                let competition = self.competition(competition);
                Entry::ChangeCompetition { competition, definition, closes_at, hidden }
            }
            Entry::ExtendAttempts { competition, number, closes_at } => {
                let competition = self.competition(competition);
                Entry::ExtendAttempts { competition, number, closes_at }
            }
            Entry::CancelCompetition { competition, reason, at } => {
                let competition = self.competition(competition);
                Entry::CancelCompetition { competition, reason, at }
            }
            Entry::AddInvitations { competition, codes, at } => {
                let competition = self.competition(competition);
                Entry::AddInvitations { competition, codes, at }
            }
            Entry::Reveal { competition, at } => {
                Entry::Reveal { competition: self.competition(competition), at }
            }
            // In a history it is the place in the queue.
            Entry::Measured { number, metrics } => {
                let place = number.and_then(|place| usize::try_from(place).ok());
                let number = place.map(|place| self.queue.get(place).copied().unwrap_or(FAR));
                Entry::Measured { number, metrics }
            }
            Entry::Audit(row) => {
                let shown = row.shown.map(|(key, shown)| (self.competition(key), shown));
                Entry::Audit(Box::new(AuditRow { shown, ..*row }))
            }
            same @ (Entry::CheckToken(_)
            | Entry::BeginForks(_)
            | Entry::Start { .. }
            | Entry::Act(_)
            | Entry::Round(_)
            | Entry::End(_)
            | Entry::Seat(_)
            | Entry::ReplaceTokens { .. }
            | Entry::RevokeKey { .. }
            | Entry::Import { .. }
            | Entry::EndRun { .. }
            | Entry::ReopenRun { .. }
            | Entry::ReplaceRunToken { .. }
            | Entry::VoidEpisode { .. }
            | Entry::VoidRun { .. }
            | Entry::AddCompetition(_)
            | Entry::ReplaceKey { .. }
            | Entry::RevokeInvitations { .. }) => same,
        }
    }
}

macro_rules! variants {
    ($($name:ident),* $(,)?) => {
        /// All variants of [`Entry`].
        pub(crate) const VARIANTS: &[&str] = &[$(stringify!($name)),*];

        /// The variant of an entry. A new one has to be listed here, and histories then have to have it.
        pub(crate) fn variant(entry: &Entry) -> &'static str {
            match entry {
                $(Entry::$name { .. } => stringify!($name)),*
            }
        }
    };
}

variants! {
    CheckToken, Open, BeginForks, Start, Act, Round, End, Claim, Seat, ReplaceTokens, AddKey, RevokeKey, Import, OpenRun, EndRun,
    ReopenRun, ReplaceRunToken, VoidEpisode, VoidRun, AddCompetition, AddEntrant, SetEntrant, DescribeEntrant, RenameEntrant,
    EraseEntrant, ReplaceKey, ChangeCompetition, ExtendAttempts, CancelCompetition, AddInvitations, RevokeInvitations,
    Reveal, Measured, Audit,
}
