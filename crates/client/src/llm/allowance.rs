//! The limits that all models of one evaluation share.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use tokio::sync::{Semaphore, SemaphorePermit};

use super::gate::Gate;
use super::stop::Stop;
use swarmbench_clock::Clock;

/// The limits of concurrent requests and of all tokens, and the clock for waiting. Cloning shares it.
#[derive(Clone)]
pub struct Allowance(Arc<Inner>);

struct Inner {
    clock: Arc<dyn Clock>,
    at_once: usize,
    turns: Semaphore,
    budget: Option<u64>,
    spent: AtomicU64,
    gates: Mutex<BTreeMap<(String, String), Arc<Gate>>>,
}

impl std::fmt::Debug for Allowance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Allowance")
            .field("at_once", &self.0.at_once)
            .field("budget", &self.0.budget)
            .field("spent", &self.spent())
            .finish_non_exhaustive()
    }
}

impl Allowance {
    /// At most `at_once` requests in flight (at least one), and at most `budget` tokens of prompts and answers in all.
    #[must_use]
    pub fn new(at_once: usize, budget: Option<u64>, clock: Arc<dyn Clock>) -> Self {
        let at_once = at_once.clamp(1, Semaphore::MAX_PERMITS);
        Self(Arc::new(Inner {
            clock,
            at_once,
            turns: Semaphore::new(at_once),
            budget,
            spent: AtomicU64::new(0),
            gates: Mutex::default(),
        }))
    }

    /// Tokens that were spent so far. If an endpoint reports no usage, four bytes of prompt and answer count as a
    /// token.
    #[must_use]
    pub fn spent(&self) -> u64 {
        self.0.spent.load(Ordering::Relaxed)
    }

    /// Tokens that may be spent.
    #[must_use]
    pub fn budget(&self) -> Option<u64> {
        self.0.budget
    }

    pub(super) fn clock(&self) -> &Arc<dyn Clock> {
        &self.0.clock
    }

    /// The gate before a model at an endpoint; models that differ in how they are asked share it.
    pub(super) fn gate(&self, url: &str, model: &str) -> Arc<Gate> {
        let mut gates = self.0.gates.lock().expect("nothing panics while it holds this");
        let place = (url.to_owned(), model.to_owned());
        gates.entry(place).or_insert_with(|| Arc::new(Gate::new(self.0.at_once))).clone()
    }

    /// Waits for a permit to make a request, first come, first served.
    pub(super) async fn turn(&self) -> SemaphorePermit<'_> {
        self.0.turns.acquire().await.expect("it is never closed")
    }

    /// Whether another request may begin.
    pub(super) fn check(&self) -> Result<(), Stop> {
        match self.0.budget {
            Some(budget) if self.spent() >= budget => {
                Err(Stop::BudgetSpent { spent: self.spent(), budget })
            }
            _ => Ok(()),
        }
    }

    pub(super) fn spend(&self, tokens: u64) {
        self.0.spent.fetch_add(tokens, Ordering::Relaxed);
    }
}
