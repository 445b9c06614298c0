//! Permits to see seeds. The seed of a game tells its whole layout, and that of a sealed one what its entrants will see.

use serde_json::json;

use super::App;
use super::auth::{Caller, Opened, Subject};
use super::error::ApiError;
use crate::episode::spec::{Spec, Visibility};
use swarmbench_protocol::suite::Suite;

/// Permission to show the seed of a game, or the seeds of a run, and all that was played. This file alone makes one that grants it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SeedPermit(bool);

impl SeedPermit {
    /// Permit of the creator in the answer to a creation. A creator who plays with others gets none.
    pub(super) fn of_creator(caller: &Caller, spec: &Spec) -> Self {
        let is_open = spec.visibility != Visibility::Sealed;
        Self(is_open && (caller.is_organizer() || !spec.is_mixed()))
    }

    /// The permit of everybody, where the suite is a built-in one: its seeds are in the documentation.
    pub(super) fn of_built_in(suite: &Suite) -> Self {
        let same = Suite::built_in(&suite.name, &suite.rules);
        Self(same.is_some_and(|same| same.seeds == suite.seeds))
    }

    pub(super) const fn is_granted(self) -> bool {
        self.0
    }

    pub(super) fn show<T>(self, seed: T) -> Option<T> {
        self.0.then_some(seed)
    }

    pub(super) const fn or(self, other: Self) -> Self {
        Self(self.0 || other.0)
    }
}

/// True if only overseers may see the seed.
fn is_sealed(subject: Subject<'_>) -> bool {
    subject.visibility == Visibility::Sealed && subject.opened != Opened::All
}

impl App {
    /// Permit for the seed and the journal of the game or run with this id. Until the end only the creator gets it, or only
    /// organizers and judges if there are several holders. Where they alone get it, the audit log records the look before the
    /// answer is sent.
    pub(super) async fn may_see_seed(
        &self,
        caller: &Caller,
        subject: Subject<'_>,
        id: &str,
    ) -> Result<SeedPermit, ApiError> {
        if !is_sealed(subject) || !caller.reads_all() {
            return Ok(self.may_see_open_seed(caller, subject));
        }
        let audit_entry = caller.audit_entry(self, "sealed.read", id, json!({}), None);
        self.store.keep(audit_entry.into_iter().collect()).await?;
        Ok(SeedPermit(true))
    }

    /// The same in lists and exports of many games: they show no sealed seeds to organizers and judges, so that the audit log names each game of which
    /// somebody saw the seed.
    pub(super) fn may_see_open_seed(&self, caller: &Caller, subject: Subject<'_>) -> SeedPermit {
        let is_audited = is_sealed(subject) && caller.reads_all();
        let is_shown =
            caller.oversees(subject) || (subject.is_over && caller.may_read(&self.access, subject));
        SeedPermit(is_shown && !is_audited)
    }
}
