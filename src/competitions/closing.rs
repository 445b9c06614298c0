//! Closing of competitions whose time is over: their runs end after the last rounds, and then everything becomes public.
//!
//! Publication cannot be undone, so nothing of this happens while the time of day is in doubt.

use std::collections::BTreeMap;
use std::time::Duration;

use jiff::Timestamp;

use super::StoredCompetition;
use crate::ids::Place;
use crate::run::RunError;
use crate::run::manager::Runs;
use crate::store::entries::Entry;
use crate::store::{Store, StoreError};
use swarmbench_clock::{Clock, after};

/// Interval of the loop.
const PAUSE: Duration = Duration::from_secs(1);

/// Maximum pause before a competition that could not be closed is tried again.
const PAUSE_MAX: Duration = Duration::from_mins(1);

/// Closes competitions whose time is over; never returns.
pub async fn run(store: &Store, runs: &Runs, clock: &dyn Clock) {
    let mut failed = Failed::default();
    loop {
        if clock.doubt().is_none() {
            failed = close_all(store, runs, clock, failed).await;
        }
        clock.sleep_until(after(clock.now(), PAUSE)).await;
    }
}

/// Competitions that could not be closed, by their public ids.
type Failed = BTreeMap<String, Failure>;

/// Error of a competition that could not be closed, and the time of the next try.
struct Failure {
    error: String,
    pause: Duration,
    again_at: Timestamp,
}

/// Closes each competition independently, so that one failure does not delay others. Returns those that could not be closed.
async fn close_all(store: &Store, runs: &Runs, clock: &dyn Clock, mut before: Failed) -> Failed {
    let closing = match store.closing_competitions(clock.wall()).await {
        Ok(closing) => closing,
        // The writer logs once that the database is away.
        Err(StoreError::Away) => return before,
        Err(error) => {
            tracing::error!(%error, "competitions that have closed cannot be listed");
            return before;
        }
    };
    let mut failed = Failed::new();
    for id in closing {
        let last = match before.remove(&id) {
            Some(last) if last.again_at > clock.now() => {
                failed.insert(id, last);
                continue;
            }
            last => last,
        };
        if let Err(error) = close(store, runs, clock, &id).await {
            let failure = failure(&id, error.to_string(), last, clock.now());
            failed.insert(id, failure);
        }
    }
    failed
}

/// Records that a competition could not be closed; logs the error if it differs from the last one.
fn failure(id: &str, error: String, last: Option<Failure>, now: Timestamp) -> Failure {
    metrics::counter!("swarmbench_closing_failures_total").increment(1);
    if last.as_ref().is_none_or(|last| last.error != error) {
        tracing::error!(competition = id, error, "a competition cannot be closed");
    }
    let pause = last.map_or(PAUSE, |last| (last.pause * 2).min(PAUSE_MAX));
    Failure { error, pause, again_at: after(now, pause) }
}

/// Takes all steps to close a competition that are possible now.
async fn close(store: &Store, runs: &Runs, clock: &dyn Clock, id: &str) -> Result<(), RunError> {
    // An unreadable competition stays sealed, as publication cannot be undone.
    let Some(competition) = super::find(store, id).await? else { return Ok(()) };
    if !store.owns_or_takes(Place::Competition(competition.key)).await? {
        return Ok(());
    }
    for attempt in store.running_attempts(competition.key).await? {
        // A run without an open game has not noticed that its time is over.
        runs.advance(attempt).await?;
    }
    // The lock waits for attempts whose start began in time.
    let _closed = runs.block_entries().await;
    reveal_if_over(store, clock, &competition).await
}

/// Publishes everything once all games have ended.
async fn reveal_if_over(
    store: &Store,
    clock: &dyn Clock,
    competition: &StoredCompetition,
) -> Result<(), RunError> {
    let is_over = !store.has_open_attempts(competition.key).await?;
    if is_over && clock.doubt().is_none() {
        let reveal = Entry::Reveal { competition: competition.key, at: clock.wall() };
        store.keep(vec![reveal]).await?;
        tracing::info!(competition = %competition.id, "closed");
    }
    Ok(())
}
