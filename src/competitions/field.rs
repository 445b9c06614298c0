//! Stored entrants of a competition, with their attempts.

use crate::competitions::{StoredCompetition, StoredEntrant};
use crate::run::RunStatus;
use crate::store::competitions::StoredAttempt;
use crate::store::games::RunGames;
use crate::store::{Store, StoreError};
use swarmbench_boards::Slot;
use swarmbench_boards::competition::entrant::Entrant;
use swarmbench_boards::competition::standings::{self, Attempt, Part};
use swarmbench_protocol::competition::AttemptSummary;

/// Some attempts of a competition, with their entrants and games.
#[derive(Debug)]
pub struct Field<'a> {
    competition: &'a StoredCompetition,
    /// Entrants in the order of registration, which is that of their keys.
    entrants: &'a [StoredEntrant],
    /// Attempts in the order of their starts.
    pub attempts: Vec<(StoredAttempt, RunGames)>,
}

impl<'a> Field<'a> {
    /// Reads the games of attempts.
    pub async fn read(
        store: &Store,
        competition: &'a StoredCompetition,
        entrants: &'a [StoredEntrant],
        attempts: Vec<StoredAttempt>,
    ) -> Result<Self, StoreError> {
        let keys: Vec<_> = attempts.iter().map(|attempt| attempt.run).collect();
        let mut games = store.games_of_all(&keys).await?;
        let attempts = attempts
            .into_iter()
            .map(|attempt| {
                let games = games.remove(&attempt.run).unwrap_or_default();
                (attempt, games)
            })
            .collect();
        Ok(Self { competition, entrants, attempts })
    }

    /// Reads all attempts of some entrants.
    pub async fn of_entrants(
        store: &Store,
        competition: &'a StoredCompetition,
        entrants: &'a [StoredEntrant],
    ) -> Result<Self, StoreError> {
        let mut attempts = Vec::new();
        for entrant in entrants {
            attempts.extend(store.attempts_of(entrant.key).await?);
        }
        attempts.sort_by_key(|attempt| attempt.run);
        Self::read(store, competition, entrants, attempts).await
    }

    /// Index of an attempt's entrant; `None` for an entrant of another field.
    pub fn place_of(&self, attempt: &StoredAttempt) -> Option<usize> {
        self.entrants.binary_search_by_key(&attempt.entry, |entrant| entrant.key).ok()
    }

    fn entrant_of(&self, attempt: &StoredAttempt) -> Result<&'a Entrant, StoreError> {
        let place = self.place_of(attempt);
        let place = place.ok_or_else(|| StoreError::broken("an attempt without an entrant"))?;
        Ok(&self.entrants[place].entrant)
    }

    /// Attempt in the form that the board takes.
    pub fn attempt(
        &self,
        (attempt, games): &(StoredAttempt, RunGames),
    ) -> Result<Attempt, StoreError> {
        let StoredCompetition { id, definition, sealed, .. } = self.competition;
        let plan = Slot::plan(&definition.suite(id, sealed, attempt.number));
        let plan = plan.ok_or_else(|| StoreError::broken("a competition with an unknown task"))?;
        let ended = games.iter().filter(|game| game.is_over());
        Ok(Attempt {
            entrant: self.entrant_of(attempt)?.id.clone(),
            number: attempt.number,
            replays: attempt.replays,
            run: attempt.id.clone(),
            status: attempt.status.clone(),
            is_over: attempt.status != RunStatus::Running.name() && attempt.unfinished == 0,
            voided: attempt.void_reason.is_some(),
            created_at: attempt.created_at,
            ended_at: attempt.ended_at,
            games: ended.filter_map(|game| game.in_plan(&plan)).collect(),
            plan,
        })
    }

    /// Attempts as they are shown. Before the end, entrants see the results on the public seeds, and organizers those on `all`.
    pub fn summaries(&self, all: bool) -> Result<Vec<AttemptSummary>, StoreError> {
        let is_final = all || self.competition.revealed_at.is_some();
        let part = if is_final { Part::Final } else { Part::Public };
        let mut summaries = Vec::with_capacity(self.attempts.len());
        for pair in &self.attempts {
            let (stored, _) = pair;
            let definition = &self.competition.definition;
            let attempt = self.attempt(pair)?;
            let of_part = attempt.clone().part(definition, part);
            let result = standings::result(definition, self.entrant_of(stored)?, &of_part);
            let tasks = standings::tasks_of(definition, &result);
            summaries.push(AttemptSummary {
                entrant: attempt.entrant,
                attempt: attempt.replays.unwrap_or(attempt.number),
                on_spare_seeds: attempt.replays.is_some(),
                run: attempt.run,
                status: attempt.status,
                created_at: attempt.created_at.into(),
                ended_at: attempt.ended_at.map(Into::into),
                games: attempt.plan.len(),
                games_ended: attempt.games.iter().filter(|game| !game.voided).count(),
                voided: stored.void_reason.clone(),
                tasks: attempt.is_over.then(|| tasks.iter().map(Into::into).collect()),
                total: result.total(&definition.tasks()).filter(|_| attempt.is_over),
            });
        }
        Ok(summaries)
    }
}
