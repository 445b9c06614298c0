//! Competitions with entrants: an ended one, or a large open one.

use std::time::Duration;

use jiff::Timestamp;
use swarmbench::competitions::{self, new_entrant_id, new_id};
use swarmbench::ids::{CompetitionKey, EntryKey};
use swarmbench::keys::{Key, KeyRow, OwnerKey, Role};
use swarmbench::run::definition::Definition;
use swarmbench::store::StoreError;
use swarmbench::store::competitions::Declared;
use swarmbench::store::entries::{CompetitionRow, EntrantRow, Entry, Secret};
use swarmbench_boards::competition::definition::{Definition as Announced, Window};
use swarmbench_boards::competition::entrant::Declaration;
use swarmbench_boards::competition::sealed::Sealed;
use swarmbench_clock::after;
use swarmbench_engine::TaskName;
use swarmbench_protocol::carried::Carried;

use super::{FillError, Filling, REST, SPAN, random, settings};

/// Sealed seeds of an attempt in an ended competition; every task is played once on each.
const SEEDS: u32 = 20;

/// Games of an attempt in an open competition. With a single game the total would be its score.
pub(super) const OPEN_GAMES: u64 = 2;

/// Time until a large competition closes.
const OPEN_FOR: Duration = Duration::from_hours(30 * 24);

/// Minimum number of entrants: a board of one shows nothing.
const ENTRANTS_MIN: u64 = 2;

pub(super) struct Shape {
    entrants: u64,
    /// Attempts of each entrant.
    attempts: u32,
    tasks: Vec<String>,
    seeds: u32,
    closes_at: Timestamp,
    pub(super) is_over: bool,
}

impl Shape {
    /// An ended competition of about `games` games, with one attempt for each entrant.
    pub(super) fn over(filling: &Filling, games: u64) -> Self {
        let tasks = TaskName::ALL.map(|task| task.name().to_owned()).to_vec();
        Self {
            entrants: (games / (tasks.len() as u64 * u64::from(SEEDS))).max(ENTRANTS_MIN),
            attempts: 1,
            tasks,
            seeds: SEEDS,
            closes_at: after(filling.since, SPAN + REST / 2),
            is_over: true,
        }
    }

    /// An open competition with attempts of [`OPEN_GAMES`] games.
    pub(super) fn open(filling: &Filling, entrants: u32, attempts: u32) -> Self {
        Self {
            entrants: entrants.into(),
            attempts,
            tasks: vec![TaskName::Foraging.name().to_owned()],
            seeds: u32::try_from(OPEN_GAMES).expect("a small number"),
            closes_at: after(filling.since, SPAN + REST + OPEN_FOR),
            is_over: false,
        }
    }
}

/// An announced competition with its entrants.
pub(super) struct Competition {
    pub(super) key: CompetitionKey,
    pub(super) id: String,
    definition: Announced,
    sealed: Sealed,
    entrants: Vec<(EntryKey, OwnerKey, Declaration)>,
    pub(super) is_over: bool,
}

impl Competition {
    /// Writes a competition and its entrants, without attempts.
    pub(super) async fn create(
        filling: &Filling,
        number: u64,
        shape: Shape,
    ) -> Result<Self, FillError> {
        let Shape { entrants: count, attempts, tasks, seeds, closes_at, is_over } = shape;
        let entropy = random(b'c', number);
        let at = filling.since;
        let opens_at = at;
        let settings = swarmbench_protocol::suite::SuiteSettings {
            round_deadline_ms: Some(60_000),
            ..settings()
        };
        let (name, window) = (format!("Cup {}", number + 1), Window { opens_at, closes_at });
        let definition = Announced {
            description: "Small games by drawn acts.".to_owned(),
            idle_timeout_ms: millis(Duration::from_hours(24)),
            ..Announced::plain(&name, tasks, seeds, settings, window, attempts as usize)
        };
        let problems = definition.problems_when_new(at);
        if let Some((field, problem)) = problems.first() {
            return Err(FillError::Settings(format!("{field} {problem}")));
        }
        let sealed = Sealed::draw(definition.sealed_seeds(), &entropy);
        let id = new_id(at, &entropy);
        let row = CompetitionRow {
            id: id.clone(),
            definition: serde_json::to_string(&definition).expect("string keys"),
            salt: Secret(sealed.salt.to_vec()),
            seeds: Secret(sealed.seeds.concat()),
            commitment: sealed.commitment(),
            opens_at,
            closes_at,
            at,
        };
        let store = &filling.store;
        store.keep(vec![Entry::AddCompetition(Box::new(row))]).await?;
        let missing = || StoreError::Missing("the competition is not there".into());
        let key = competitions::find(store, &id).await?.ok_or_else(missing)?.key;
        let mut entries = Vec::new();
        for entrant in 0..count {
            let name = format!("Team {}", entrant + 1);
            let (key_of, token) =
                Key::new(Role::Entrant, &name, None, at, &entropy).map_err(FillError::Settings)?;
            let declaration = Declaration {
                model: format!("model-{entrant}"),
                temperature: Some(1.0),
                top_p: None,
                agent_meta: Carried::default(),
                prompt_template: None,
                template: None,
            };
            let owner = key_of.id.clone();
            entries.push(Entry::AddKey(Box::new(KeyRow {
                key: key_of,
                hash: token.hash(),
                acts_for: None,
            })));
            entries.push(Entry::AddEntrant(Box::new(EntrantRow {
                category: None,
                terms: None,
                contact: None,
                id: new_entrant_id(at, &entropy),
                competition: key,
                owner,
                name,
                model: declaration.model.clone(),
                declaration: serde_json::to_string(&declaration).expect("string keys"),
                template: None,
                vouched: false,
                invitation: None,
                address: None,
                at,
            })));
        }
        store.keep(entries).await?;
        let stored = competitions::entrants(store, key, None, Declared::Whole).await?;
        let entrants = stored.into_iter().map(|one| (one.key, one.owner, one.entrant.declaration));
        Ok(Self { key, id, definition, sealed, entrants: entrants.collect(), is_over })
    }

    /// Number of attempts of all entrants together.
    pub(super) fn attempts(&self) -> usize {
        self.entrants.len() * self.definition.attempts.len()
    }

    /// Number of games of an attempt.
    pub(super) fn games(&self) -> u64 {
        self.definition.games() as u64
    }

    pub(super) fn closes_at(&self) -> Timestamp {
        self.definition.closes_at
    }

    /// The attempt with an index, where the first attempts of all entrants precede the second ones: entry and number, key,
    /// and definition of the run.
    pub(super) fn attempt(
        &self,
        index: usize,
    ) -> Result<((EntryKey, u32), OwnerKey, Definition), String> {
        let (entry, owner, declaration) = &self.entrants[index % self.entrants.len()];
        let number = u32::try_from(index / self.entrants.len() + 1).map_err(|e| e.to_string())?;
        let run = self.definition.run(&self.id, declaration, number, &self.sealed);
        Ok(((*entry, number), *owner, run.ok_or("there is no attempt")?))
    }
}

fn millis(duration: Duration) -> u64 {
    swarmbench_clock::millis(duration)
}
