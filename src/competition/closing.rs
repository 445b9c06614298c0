//! What a server does with competitions whose time is over: it ends their runs once the last rounds have been played,
//! and then opens everything to all.

use std::time::Duration;

use crate::clock::{Clock, after};
use crate::journal::{Entry, Journal, JournalError};
use crate::run::RunStatus;
use crate::run::manager::Runs;
use crate::store::Store;
use crate::store::competitions::StoredCompetition;

/// How often it looks.
const PAUSE: Duration = Duration::from_secs(1);

/// Looks after competitions that have closed, for ever.
pub async fn look_after(store: &Store, runs: &Runs, clock: &dyn Clock) {
    loop {
        if let Err(error) = close_all(store, runs, clock).await {
            tracing::error!(%error, "competitions cannot be closed");
        }
        clock.sleep_until(after(clock.now(), PAUSE)).await;
    }
}

async fn close_all(store: &Store, runs: &Runs, clock: &dyn Clock) -> Result<(), JournalError> {
    for competition in store.closing_competitions(clock.now()).await? {
        close(store, runs, clock, &competition).await?;
    }
    Ok(())
}

/// Does what can be done now to close a competition.
async fn close(
    store: &Store,
    runs: &Runs,
    clock: &dyn Clock,
    competition: &StoredCompetition,
) -> Result<(), JournalError> {
    for attempt in store.attempts(competition.key, None).await? {
        // A run ends with its last game; where none is open it may not know yet that its time is over.
        if attempt.status == RunStatus::Running.name() {
            runs.advance(attempt.run).await?;
        }
    }
    // Whoever began to start an attempt in time has started it.
    let _closed = runs.while_nobody_enters().await;
    let attempts = store.attempts(competition.key, None).await?;
    let is_over = attempts
        .iter()
        .all(|attempt| attempt.status != RunStatus::Running.name() && attempt.unfinished == 0);
    if is_over {
        let reveal = Entry::Reveal { competition: competition.key, at: clock.now() };
        store.keep(vec![reveal]).await?;
        tracing::info!(competition = %competition.id, attempts = attempts.len(), "closed");
    }
    Ok(())
}
