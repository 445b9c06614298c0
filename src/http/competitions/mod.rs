//! Competitions: created and managed by organizers, entered and played by entrants, watched by everybody.

pub(super) mod actions;
pub(super) mod announcements;
pub(super) mod attempts;
pub(super) mod board;
pub(super) mod cancel;
pub(super) mod change;
pub(super) mod change_entrant;
pub(super) mod codes;
pub(super) mod contacts;
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

use jiff::Timestamp;
use tokio::sync::OwnedMutexGuard;

use super::App;
use super::auth::Caller;
use super::checks::Problems;
use super::error::{ApiError, Code};
use crate::competitions::{self, StoredCompetition, StoredEntrant};
use crate::fair::Party;
use crate::ids::{EntryKey, RunKey};
use crate::keys::NAME_CHARS_MAX;
use crate::run::RunStatus;
use crate::store::entries::Entry;
use swarmbench_boards::competition::definition::practice_suite;
use swarmbench_boards::competition::shown::{self, Revealed, State};
use swarmbench_players::DEFAULT_PLAYER;
use swarmbench_protocol::competition::Competition;
use swarmbench_protocol::names;

impl App {
    /// Competition of which the caller may know.
    async fn competition(&self, caller: &Caller, id: &str) -> Result<StoredCompetition, ApiError> {
        caller.check_may_browse(&self.access)?;
        self.stored_competition(id).await
    }

    /// Competition, for callers whose rights are checked already.
    async fn stored_competition(&self, id: &str) -> Result<StoredCompetition, ApiError> {
        let found = competitions::find(&self.store, id).await?;
        found.ok_or_else(|| ApiError::not_found("the competition"))
    }

    /// Keeps entrants of a competition from being added, renamed and decided about by others. Rights are checked before, so that a
    /// stranger makes nobody wait. Others wait for the holder of the lock, so its reads are the server's: those of a party that asks
    /// for too much are late.
    async fn lock_entrants(&self, competition: &StoredCompetition) -> OwnedMutexGuard<()> {
        let lock = self.creations.lock(&format!("enter {}", competition.id)).await;
        Party::SERVER.refine();
        lock
    }

    /// An entrant, which others neither change nor erase while the lock is held. `check` refuses callers without rights before the
    /// lock is taken, and again under it, as the entrant may have been changed meanwhile.
    async fn lock_entrant(
        &self,
        id: &str,
        entrant: &str,
        check: impl Fn(&StoredEntrant) -> Result<(), ApiError>,
    ) -> Result<(StoredCompetition, OwnedMutexGuard<()>, StoredEntrant), ApiError> {
        let competition = self.stored_competition(id).await?;
        check(&self.entrant(&competition, entrant).await?)?;
        let lock = self.lock_entrants(&competition).await;
        let stored = self.entrant(&competition, entrant).await?;
        check(&stored)?;
        Ok((competition, lock, stored))
    }

    async fn entrant(
        &self,
        competition: &StoredCompetition,
        id: &str,
    ) -> Result<StoredEntrant, ApiError> {
        let found = competitions::find_entrant(&self.store, competition.key, id).await?;
        found.ok_or_else(|| ApiError::not_found("the entrant"))
    }

    /// Stores the entries that exclude entrants, and ends their runs. A run that starts meanwhile is ended before the answer,
    /// or by the request that starts it ([`App::check_not_excluded`]).
    async fn exclude(
        &self,
        competition: &StoredCompetition,
        excluded: &[StoredEntrant],
        entries: Vec<Entry>,
    ) -> Result<(), ApiError> {
        let practice = practice_suite(&competition.id);
        let playing = async || {
            let mut runs = Vec::new();
            for StoredEntrant { key, owner, .. } in excluded {
                runs.extend(self.store.playing(*key, *owner, &practice).await?);
            }
            Ok::<_, ApiError>(runs)
        };
        self.runs.end_all(&playing().await?, RunStatus::Aborted, entries).await?;
        Ok(self.runs.end_all(&playing().await?, RunStatus::Aborted, Vec::new()).await?)
    }

    /// Ends and refuses a new run whose entrant was excluded after its status was checked.
    async fn check_not_excluded(
        &self,
        competition: &StoredCompetition,
        entrant: &StoredEntrant,
        run: RunKey,
    ) -> Result<(), ApiError> {
        if !self.store.is_excluded(run).await? {
            return Ok(());
        }
        self.runs.end(run, RunStatus::Aborted).await?;
        start::check_active(&self.entrant(competition, &entrant.entrant.id).await?)?;
        Err(erased())
    }

    /// A founder has the key with which the entrant entered, not that of a later member of its team.
    async fn is_founder(&self, caller: &Caller, entrant: &StoredEntrant) -> Result<bool, ApiError> {
        let first = self.store.key(entrant.owner).await?;
        Ok(matches!((caller, first), (Caller::Key(key), Some(first)) if key.id == first.id))
    }

    /// Refuses a name that looks like a present or past name of another entrant.
    async fn check_name_is_free(
        &self,
        competition: &StoredCompetition,
        of: Option<EntryKey>,
        name: &str,
    ) -> Result<(), ApiError> {
        if self.store.is_name_taken(competition.key, of, name).await? {
            return Err(ApiError::field("name", "is or was that of another entrant"));
        }
        Ok(())
    }

    /// Stored form of the name of an entrant or a member, if the name is allowed.
    fn entrant_name(problems: &mut Problems, name: &str) -> Option<String> {
        let players = swarmbench_players::all().map(|player| player.name);
        let checked = names::of_entrant(name, NAME_CHARS_MAX, players.chain([DEFAULT_PLAYER]));
        checked.map_err(|problem| problems.refuse("name", problem)).ok()
    }
}

/// Refuses changes of an erased entrant.
fn check_not_erased(stored: &StoredEntrant) -> Result<(), ApiError> {
    if stored.entrant.erased { Err(erased()) } else { Ok(()) }
}

fn erased() -> ApiError {
    ApiError::new(Code::Closed, "this entrant was erased, which cannot be undone")
}

/// Refuses requests after the cancellation or the publication of a competition.
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

/// Refuses requests after the closing time or the cancellation of a competition.
fn check_open(competition: &StoredCompetition, now: Timestamp) -> Result<(), ApiError> {
    check_not_over(competition)?;
    let closes_at = competition.definition.closes_at;
    if closes_at <= now {
        let detail = format!("the competition closed at {closes_at}");
        return Err(ApiError::new(Code::Closed, detail));
    }
    Ok(())
}

/// Public view of a competition.
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
