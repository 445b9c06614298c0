//! Gate before a model at an endpoint. It distinguishes single refusals from an endpoint that is at its limit.
//!
//! A question that is refused for the endpoint's load (429, 503, 529) pauses alone, and no other waits for it. Only when more
//! than 10 of the last 32 requests were refused does the gate close for all: no request begins until the pause is over, and
//! only half as many may be in flight then. While few are refused, the limit grows by one for as many answers as may be in
//! flight. So requests settle at what the endpoint allows, and an endpoint that refuses one request in ten at random is asked
//! at full speed.

use std::sync::Mutex;
use std::time::Duration;

use backon::{BackoffBuilder, ExponentialBackoff, ExponentialBuilder};
use jiff::Timestamp;
use tokio::sync::{Semaphore, SemaphorePermit};

use swarmbench_clock::{Clock, after};

#[cfg(test)]
mod tests;

/// Maximum refusals among the last 32 requests before the gate closes: a third of them.
const REFUSALS_MAX: u32 = 10;

/// Refusals among the last 32 requests, an eighth of them, from which the limit of requests in flight stops growing.
const REFUSALS_TO_STAY: u32 = 4;

/// Gate; see the module.
#[derive(Debug)]
pub(super) struct Gate {
    most: usize,
    turns: Semaphore,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// Maximum requests in flight.
    width: usize,
    /// Number of permits to drop when they are returned.
    owed: usize,
    /// Answers since the width changed.
    answers: usize,
    /// Number of all answers.
    answers_ever: u64,
    /// The last 32 requests, the latest in the lowest bit: 1 for a refusal.
    recent: u32,
    /// Time from which a request may begin.
    open_at: Timestamp,
    /// Number of closings. The refusal of a request that began before the last closing says nothing new.
    closings: u64,
    /// Closings in a row without an answer between them.
    closings_in_row: u32,
    /// Pauses of these closings.
    pauses: Option<ExponentialBackoff>,
}

/// Refusals of one question.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    /// Refusals in a row without an answer to any question between them.
    in_row: u32,
    /// [`State::answers_ever`] at the last refusal.
    answers: u64,
    pauses: Option<ExponentialBackoff>,
}

/// Request that has a place in flight. It ends with [`Pass::answered`], [`Pass::refused`], or a drop, which says nothing about
/// the endpoint's load.
#[derive(Debug)]
pub(super) struct Pass<'a> {
    gate: &'a Gate,
    turn: Option<SemaphorePermit<'a>>,
    closings: u64,
}

impl Gate {
    pub(super) fn new(most: usize) -> Self {
        let state = State {
            width: most,
            owed: 0,
            answers: 0,
            answers_ever: 0,
            recent: 0,
            open_at: Timestamp::MIN,
            closings: 0,
            closings_in_row: 0,
            pauses: None,
        };
        Self { most, turns: Semaphore::new(most), state: Mutex::new(state) }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("nothing panics while it holds this")
    }

    /// Waits for a place in flight. The gate may still be closed.
    pub(super) async fn pass(&self) -> Pass<'_> {
        let turn = self.turns.acquire().await.expect("it is never closed");
        Pass { gate: self, turn: Some(turn), closings: 0 }
    }
}

impl Pass<'_> {
    pub(super) async fn opened(&mut self, clock: &dyn Clock) {
        while !self.is_open(clock) {
            let open_at = self.gate.state().open_at;
            clock.sleep_until(open_at).await;
        }
    }

    /// True if a request may begin now.
    pub(super) fn is_open(&mut self, clock: &dyn Clock) -> bool {
        let state = self.gate.state();
        self.closings = state.closings;
        clock.now() >= state.open_at
    }

    /// True if any request to this model at this address was answered.
    pub(super) fn has_answers(&self) -> bool {
        self.gate.state().answers_ever > 0
    }

    /// Reports an answer: more requests may be in flight, unless many are refused.
    pub(super) fn answered(self) {
        let mut state = self.gate.state();
        state.closings_in_row = 0;
        state.pauses = None;
        state.answers_ever += 1;
        state.recent <<= 1;
        if state.width == self.gate.most || state.recent.count_ones() >= REFUSALS_TO_STAY {
            return;
        }
        state.answers += 1;
        if state.answers >= state.width {
            state.answers = 0;
            state.width += 1;
            if state.owed > 0 {
                state.owed -= 1;
            } else {
                self.gate.turns.add_permits(1);
            }
        }
    }

    /// Reports a refusal for the endpoint's load, with the pause that the endpoint may have `asked` for. Returns the pause of
    /// this question; `None` if the gate is closed for all.
    ///
    /// # Errors
    /// The number of refusals in a row, if no pauses are left.
    pub(super) fn refused(
        self,
        asked: Option<Duration>,
        refusals: &mut Refusals,
        pauses: ExponentialBuilder,
        retries: u32,
        clock: &dyn Clock,
    ) -> Result<Option<Duration>, u32> {
        let mut state = self.gate.state();
        let now = clock.now();
        let asked = asked.unwrap_or_default();
        let is_news = self.closings == state.closings;
        if is_news {
            state.recent = state.recent << 1 | 1;
        }
        if is_news && state.recent.count_ones() > REFUSALS_MAX {
            state.closings += 1;
            state.closings_in_row += 1;
            let Some(grown) = state.pauses.get_or_insert_with(|| pauses.build()).next() else {
                return Err(state.closings_in_row);
            };
            let width = (state.width / 2).max(1);
            let fewer = state.width - width;
            state.width = width;
            state.answers = 0;
            state.owed += fewer - self.gate.turns.forget_permits(fewer);
            state.open_at = state.open_at.max(after(now, asked.max(grown)));
            return Ok(None);
        }
        if now < state.open_at {
            state.open_at = state.open_at.max(after(now, asked));
            return Ok(None);
        }
        if refusals.answers != state.answers_ever {
            refusals.answers = state.answers_ever;
            refusals.in_row = 0;
        }
        refusals.in_row += 1;
        if refusals.in_row > retries {
            return Err(refusals.in_row);
        }
        let own = refusals.pauses.get_or_insert_with(|| pauses.without_max_times().build());
        Ok(Some(own.next().unwrap_or_default().max(asked)))
    }
}

impl Drop for Pass<'_> {
    fn drop(&mut self) {
        let mut state = self.gate.state();
        if state.owed > 0 {
            state.owed -= 1;
            if let Some(turn) = self.turn.take() {
                turn.forget();
            }
        }
    }
}
