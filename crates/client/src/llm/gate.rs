//! The gate before an endpoint, which closes for all requests when the endpoint reports its rate limit.
//!
//! When one request is refused for the endpoint's load (429, 503, 529), no other begins until the pause is over, and
//! only half as many may be in flight then. Every answer lets the number grow again, by one for as many answers as may
//! be in flight. So requests settle at what the endpoint bears, whatever its limit is.

use std::sync::Mutex;
use std::time::Duration;

use backon::{BackoffBuilder, ExponentialBackoff, ExponentialBuilder};
use jiff::Timestamp;
use tokio::sync::{Semaphore, SemaphorePermit};

use swarmbench_clock::{Clock, after};

/// See the module.
#[derive(Debug)]
pub(super) struct Gate {
    most: usize,
    turns: Semaphore,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// How many may be in flight.
    width: usize,
    /// How many permits have to be dropped when they are returned.
    owed: usize,
    /// Answers since the width changed.
    answers: usize,
    /// When the next request may begin.
    open_at: Timestamp,
    /// How often it has closed. The refusal of a request that began before the last time is no news.
    closings: u64,
    /// Refusals in a row, without an answer between them.
    refusals: u32,
    /// The pauses of these.
    pauses: Option<ExponentialBackoff>,
}

/// A request that went through the gate. Ends with the first of [`Pass::answered`], [`Pass::refused`], or a drop, which
/// says nothing about the endpoint's load.
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
            open_at: Timestamp::MIN,
            closings: 0,
            refusals: 0,
            pauses: None,
        };
        Self { most, turns: Semaphore::new(most), state: Mutex::new(state) }
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("nothing panics while it holds this")
    }

    /// Waits for a place among those that may be in flight. The gate may be closed all the same.
    pub(super) async fn pass(&self) -> Pass<'_> {
        let turn = self.turns.acquire().await.expect("it is never closed");
        Pass { gate: self, turn: Some(turn), closings: 0 }
    }
}

impl Pass<'_> {
    /// Waits until the gate is open.
    pub(super) async fn opened(&mut self, clock: &dyn Clock) {
        while !self.is_open(clock) {
            let open_at = self.gate.state().open_at;
            clock.sleep_until(open_at).await;
        }
    }

    /// Whether a request may begin now.
    pub(super) fn is_open(&mut self, clock: &dyn Clock) -> bool {
        let state = self.gate.state();
        self.closings = state.closings;
        clock.now() >= state.open_at
    }

    /// The endpoint answered: more requests may be in flight.
    pub(super) fn answered(self) {
        let mut state = self.gate.state();
        state.refusals = 0;
        state.pauses = None;
        if state.width == self.gate.most {
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

    /// The endpoint refused for its load, and may have `asked` for a pause. The error is the number of refusals in a
    /// row after which no pauses are left.
    pub(super) fn refused(
        self,
        asked: Option<Duration>,
        pauses: ExponentialBuilder,
        clock: &dyn Clock,
    ) -> Result<(), u32> {
        let mut state = self.gate.state();
        let now = clock.now();
        let mut pause = asked.unwrap_or_default();
        if self.closings == state.closings {
            state.closings += 1;
            state.refusals += 1;
            let Some(grown) = state.pauses.get_or_insert_with(|| pauses.build()).next() else {
                return Err(state.refusals);
            };
            pause = pause.max(grown);
            let width = (state.width / 2).max(1);
            let fewer = state.width - width;
            state.width = width;
            state.answers = 0;
            state.owed += fewer - self.gate.turns.forget_permits(fewer);
        }
        state.open_at = state.open_at.max(after(now, pause));
        Ok(())
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
