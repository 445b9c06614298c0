//! Limits of one evaluation: concurrent requests at each endpoint, and tokens or money in total.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::{CancellationToken, WaitForCancellationFuture};

use super::gate::Gate;
use super::stop::Stop;
use swarmbench_clock::Clock;

/// Limits of concurrent requests and of tokens, the clock for waiting, and an interruption. Clones share them.
#[derive(Clone)]
pub struct Allowance(Arc<Inner>);

struct Inner {
    clock: Arc<dyn Clock>,
    at_once: usize,
    budget: Option<u64>,
    spent: AtomicU64,
    money: Option<Money>,
    interruption: CancellationToken,
    /// Permits by server.
    turns: Mutex<BTreeMap<String, Arc<Semaphore>>>,
    gates: Mutex<BTreeMap<GateKey, Arc<Gate>>>,
}

/// A budget of money in billionths of a US dollar.
#[derive(Debug)]
struct Money {
    budget: u64,
    /// What was spent, and what requests in flight may cost at most.
    held: Mutex<[u64; 2]>,
    /// Told when a request is over.
    over: Notify,
}

/// Part of a budget that is held for a request in flight, in billionths of a US dollar. A request that is given up may be
/// charged, so it counts in full.
pub(super) struct Hold<'a> {
    money: Option<&'a Money>,
    nano: u64,
    cost: u64,
}

impl Hold<'_> {
    /// Sets the cost of the request, which is over.
    pub(super) fn costs(mut self, nano: u64) {
        self.cost = nano;
    }
}

impl Drop for Hold<'_> {
    fn drop(&mut self) {
        let Some(money) = self.money else { return };
        let mut held = money.held.lock().expect("nothing panics while it holds this");
        held[0] = held[0].saturating_add(self.cost);
        held[1] -= self.nano;
        drop(held);
        money.over.notify_waiters();
    }
}

/// Key of a gate: an address, a model, and the model's own limit.
type GateKey = (String, String, Option<usize>);

/// Permits for requests to one endpoint, first come, first served; `None` for a model with its own limit.
#[derive(Debug)]
pub(super) struct Turns(Option<Arc<Semaphore>>);

impl Turns {
    pub(super) async fn turn(&self) -> Option<OwnedSemaphorePermit> {
        let turns = self.0.clone()?;
        Some(turns.acquire_owned().await.expect("it is never closed"))
    }
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
    /// Allows `at_once` requests in flight at each endpoint (at least one), and `budget` tokens of prompts and answers in
    /// total.
    #[must_use]
    pub fn new(at_once: usize, budget: Option<u64>, clock: Arc<dyn Clock>) -> Self {
        Self::interrupted_by(CancellationToken::new(), at_once, budget, clock)
    }

    /// Creates an allowance that begins no request after an interruption: questions that are not in flight by then
    /// end with [`Stop::Interrupted`].
    #[must_use]
    pub fn interrupted_by(
        interruption: CancellationToken,
        at_once: usize,
        budget: Option<u64>,
        clock: Arc<dyn Clock>,
    ) -> Self {
        Self(Arc::new(Inner {
            clock,
            at_once: at_once.clamp(1, Semaphore::MAX_PERMITS),
            budget,
            spent: AtomicU64::new(0),
            money: None,
            interruption,
            turns: Mutex::default(),
            gates: Mutex::default(),
        }))
    }

    /// Limits the money that is spent, in billionths of a US dollar. A request is begun if its highest cost, with those in flight,
    /// is left.
    ///
    /// # Panics
    /// If the allowance is already shared.
    #[must_use]
    pub fn with_money(mut self, budget: u64) -> Self {
        let inner = Arc::get_mut(&mut self.0).expect("no model has the allowance yet");
        inner.money = Some(Money { budget, held: Mutex::default(), over: Notify::new() });
        self
    }

    /// Holds the highest cost of a request, in billionths of a US dollar. Waits for requests in flight if it is not left without
    /// what they may still return.
    pub(super) async fn hold(&self, nano: u64) -> Result<Hold<'_>, Stop> {
        let Some(money) = &self.0.money else { return Ok(Hold { money: None, nano: 0, cost: 0 }) };
        loop {
            let over = money.over.notified();
            {
                let mut held = money.held.lock().expect("nothing panics while it holds this");
                let [spent, in_flight] = *held;
                if spent.saturating_add(in_flight).saturating_add(nano) <= money.budget {
                    held[1] += nano;
                    return Ok(Hold { money: Some(money), nano, cost: nano });
                }
                if in_flight == 0 {
                    return Err(Stop::MoneySpent { spent, budget: money.budget, next: nano });
                }
            }
            over.await;
        }
    }

    /// Tokens spent so far. If an endpoint reports no usage, four bytes of prompt and answer count as a token.
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

    /// Gate of a model at an endpoint. Models that differ only in the parameters of requests share a gate.
    pub(super) fn gate(&self, url: &str, model: &str, own: Option<usize>) -> Arc<Gate> {
        let mut gates = self.0.gates.lock().expect("nothing panics while it holds this");
        let most = own.map_or(self.0.at_once, |own| own.clamp(1, Semaphore::MAX_PERMITS));
        let place = (url.to_owned(), model.to_owned(), own);
        gates.entry(place).or_insert_with(|| Arc::new(Gate::new(most))).clone()
    }

    /// Permits for requests to a server.
    pub(super) fn turns(&self, server: String, has_own_limit: bool) -> Turns {
        if has_own_limit {
            return Turns(None);
        }
        let mut turns = self.0.turns.lock().expect("nothing panics while it holds this");
        let new = || Arc::new(Semaphore::new(self.0.at_once));
        Turns(Some(turns.entry(server).or_insert_with(new).clone()))
    }

    /// Completes after an interruption.
    pub(super) fn interrupted(&self) -> WaitForCancellationFuture<'_> {
        self.0.interruption.cancelled()
    }

    /// Checks that the budget allows another request.
    pub(super) fn check(&self) -> Result<(), Stop> {
        match self.0.budget {
            Some(budget) if self.spent() >= budget => {
                Err(Stop::BudgetSpent { spent: self.spent(), budget })
            }
            _ => Ok(()),
        }
    }

    pub(super) fn spend(&self, tokens: u64) {
        let add = |spent: u64| Some(spent.saturating_add(tokens));
        _ = self.0.spent.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add);
    }
}
