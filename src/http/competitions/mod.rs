//! Competitions: created and managed by organizers, entered and played by entrants, watched by everybody.

pub(super) mod actions;
pub(super) mod announcements;
pub(super) mod attempts;
pub(super) mod board;
pub(super) mod cancel;
pub(super) mod change;
pub(super) mod change_entrant;
pub(super) mod codes;
pub(super) mod create;
pub(super) mod entrants;
pub(super) mod exclude;
pub(super) mod export;
pub(super) mod list;
pub(super) mod members;
pub(super) mod practice;
pub(super) mod register;
pub(super) mod replace_key;
pub(super) mod show;
pub(super) mod start;
pub(super) mod void;

use std::collections::{HashMap, HashSet};

use jiff::Timestamp;

use super::App;
use super::auth::Caller;
use super::error::{ApiError, Code};
use crate::competitions::{self, StoredCompetition, StoredEntrant};
use crate::run::RunStatus;
use crate::store::competitions::{Declared, StoredAttempt};
use crate::store::games::RunGames;
use swarmbench_boards::Slot;
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::entrant::Entrant;
use swarmbench_boards::competition::shown::{self, Revealed, State};
use swarmbench_boards::competition::standings::{self, Attempt, Part, Standing, standings};
use swarmbench_protocol::competition::{AttemptSummary, Competition, CompetitionRow};

impl App {
    /// A competition of which the caller may know.
    async fn competition(&self, caller: &Caller, id: &str) -> Result<StoredCompetition, ApiError> {
        caller.may_look_around(&self.access)?;
        self.stored_competition(id).await
    }

    /// A competition, for callers whose rights are checked already.
    async fn stored_competition(&self, id: &str) -> Result<StoredCompetition, ApiError> {
        let found = competitions::find(&self.store, id).await?;
        found.ok_or_else(|| ApiError::not_found("the competition"))
    }

    async fn entrant(
        &self,
        competition: &StoredCompetition,
        id: &str,
    ) -> Result<StoredEntrant, ApiError> {
        let found = competitions::find_entrant(&self.store, competition.key, id).await?;
        found.ok_or_else(|| ApiError::not_found("the entrant"))
    }

    /// All who take part in a competition, with all that they played.
    async fn field(
        &self,
        competition: StoredCompetition,
        declared: Declared,
    ) -> Result<Field, ApiError> {
        // In this order each attempt has its entrant, also if another one registers meanwhile.
        let attempts = self.store.attempts(competition.key, None).await?;
        let entrants = competitions::entrants(&self.store, competition.key, None, declared).await?;
        self.field_of(competition, entrants, attempts).await
    }

    /// Some who take part in a competition, with all that they played.
    async fn part_of_field(
        &self,
        competition: StoredCompetition,
        entrants: Vec<StoredEntrant>,
    ) -> Result<Field, ApiError> {
        let mut attempts = Vec::new();
        for entrant in &entrants {
            attempts.extend(self.store.attempts(competition.key, Some(entrant.key)).await?);
        }
        attempts.sort_by_key(|attempt| attempt.run);
        self.field_of(competition, entrants, attempts).await
    }

    async fn field_of(
        &self,
        competition: StoredCompetition,
        entrants: Vec<StoredEntrant>,
        attempts: Vec<StoredAttempt>,
    ) -> Result<Field, ApiError> {
        let keys: Vec<_> = attempts.iter().map(|attempt| attempt.run).collect();
        let mut games = self.store.games_of_all(&keys).await?;
        let attempts = attempts
            .into_iter()
            .map(|attempt| {
                let games = games.remove(&attempt.run).unwrap_or_default();
                (attempt, games)
            })
            .collect();
        Ok(Field { competition, entrants, attempts })
    }
}

/// Refuses what nobody does any more in a competition that was cancelled, or whose seeds are public.
fn check_not_over(competition: &StoredCompetition) -> Result<(), ApiError> {
    let closed = |detail: String| Err(ApiError::new(Code::Closed, detail));
    match &competition.cancelled {
        Some((at, reason)) => closed(format!("the competition was cancelled at {at}: {reason}")),
        None if competition.revealed_at.is_some() => {
            closed("the competition is closed: its seeds are public".to_owned())
        }
        None => Ok(()),
    }
}

/// Refuses what nobody does any more in a competition that has closed or was cancelled.
fn check_open(competition: &StoredCompetition, now: Timestamp) -> Result<(), ApiError> {
    check_not_over(competition)?;
    let closes_at = competition.definition.closes_at;
    if closes_at <= now {
        let detail = format!("the competition closed at {closes_at}");
        return Err(ApiError::new(Code::Closed, detail));
    }
    Ok(())
}

/// A competition as it is shown to everybody.
fn shown(stored: &StoredCompetition, now: Timestamp) -> Competition {
    let revealed = stored.revealed_at.map(|at| Revealed {
        at,
        salt: stored.sealed.salt,
        seeds: stored.sealed.seeds.clone(),
    });
    let StoredCompetition { id, definition, commitment, created_at, cancelled, hidden, .. } =
        stored;
    let state = State { revealed, cancelled: cancelled.clone(), hidden: *hidden };
    shown::competition(id, definition, commitment, *created_at, state, now)
}

/// A competition with all who take part and all that they played.
struct Field {
    competition: StoredCompetition,
    /// In the order in which they registered, which is that of their numbers.
    entrants: Vec<StoredEntrant>,
    /// In the order in which they were started.
    attempts: Vec<(StoredAttempt, RunGames)>,
}

impl Field {
    fn entrant_of(&self, attempt: &StoredAttempt) -> Result<&StoredEntrant, ApiError> {
        let found = self.entrants.binary_search_by_key(&attempt.entry, |entrant| entrant.key);
        let found = found.ok().map(|place| &self.entrants[place]);
        found.ok_or_else(|| ApiError::new(Code::Internal, "an attempt without an entrant"))
    }

    /// An attempt as far as the board is concerned.
    fn attempt(&self, (attempt, games): &(StoredAttempt, RunGames)) -> Result<Attempt, ApiError> {
        let StoredCompetition { id, definition, sealed, .. } = &self.competition;
        let seeds = sealed.of_attempt(attempt.number, definition.seeds);
        let plan = Slot::plan(&definition.suite(id, seeds));
        let plan = plan.ok_or_else(|| ApiError::new(Code::Internal, "an unknown task"))?;
        let ended = games.iter().filter(|game| game.is_over());
        Ok(Attempt {
            entrant: self.entrant_of(attempt)?.entrant.id.clone(),
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

    fn all_entrants(&self) -> Vec<Entrant> {
        self.entrants.iter().map(|entrant| entrant.entrant.clone()).collect()
    }

    /// The board on some of the seeds, of all that was over at a time, or of all that is.
    fn standings(
        &self,
        definition: &Definition,
        part: Part,
        before: Option<Timestamp>,
    ) -> Result<Vec<Standing>, ApiError> {
        let mut attempts = Vec::with_capacity(self.attempts.len());
        for attempt in &self.attempts {
            let mut attempt = self.attempt(attempt)?.part(definition, part);
            if let Some(before) = before {
                attempt.is_over &= attempt.ended_at.is_some_and(|at| at < before);
            }
            attempts.push(attempt);
        }
        Ok(standings(definition, &self.all_entrants(), &attempts))
    }

    /// Those in a category alone.
    fn in_category(mut self, category: &str) -> Self {
        self.entrants.retain(|one| one.entrant.category.as_deref() == Some(category));
        let keys: HashSet<_> = self.entrants.iter().map(|entrant| entrant.key).collect();
        self.attempts.retain(|(attempt, _)| keys.contains(&attempt.entry));
        self
    }

    /// The rows of the board as they are shown, with the results in each task or without.
    fn shown(
        &self,
        part: Part,
        before: Option<Timestamp>,
        with_tasks: bool,
    ) -> Result<Vec<CompetitionRow>, ApiError> {
        let entrants = self.entrants.iter().map(|entrant| (&entrant.entrant.id, &entrant.entrant));
        let entrants: HashMap<_, _> = entrants.collect();
        let rows = self.standings(&self.competition.definition, part, before)?;
        let shown = rows
            .iter()
            .filter_map(|row| Some(shown::row(row, entrants.get(&row.row.entrant)?, with_tasks)));
        Ok(shown.collect())
    }

    /// The attempts of all of them. Before the end they see themselves what the public seeds make, and organizers `all`.
    fn summaries(&self, all: bool) -> Result<Vec<AttemptSummary>, ApiError> {
        let is_final = all || self.competition.revealed_at.is_some();
        let part = if is_final { Part::Final } else { Part::Public };
        let mut summaries = Vec::new();
        for pair in &self.attempts {
            let (stored, _) = pair;
            let entrant = self.entrant_of(stored)?;
            let definition = &self.competition.definition;
            let attempt = self.attempt(pair)?;
            let of_part = attempt.clone().part(definition, part);
            let result = standings::result(definition, &entrant.entrant, &of_part);
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
