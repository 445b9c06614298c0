//! Requests to one model at its endpoint: concurrency, retries, and the final stop.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use backon::BackoffBuilder;
use serde_json::{Map, Value};
use tokio_util::sync::CancellationToken;

use super::Chat;
use super::allowance::{Allowance, Turns};
use super::completion::Completion;
use super::endpoint::{Course, Endpoint, Kind, Passing, Trouble};
use super::gate::{Gate, Refusals};
use super::settings::Settings;
use super::spent::Counters;
use super::stop::Stop;

use swarmbench_clock::{after, millis};

/// Retries of an address that never gave an answer. The address may be mistyped, and its user should not wait for minutes.
const UNKNOWN_RETRIES: u32 = 2;

/// Requests to one model; see the module.
#[derive(Debug)]
pub(super) struct Requests {
    endpoint: Endpoint,
    allowance: Allowance,
    gate: Arc<Gate>,
    turns: Turns,
    pub(super) counters: Counters,
    /// Reason of the final stop; the error of all later requests.
    stop: OnceLock<Stop>,
    /// Cancelled after the final stop, which ends all pauses.
    stopped: CancellationToken,
}

impl Requests {
    /// # Errors
    /// [`Stop::Settings`] if a setting cannot work.
    pub(super) fn new(settings: Settings, allowance: &Allowance) -> Result<Self, Stop> {
        let endpoint = Endpoint::new(settings)?;
        let Settings { model, requests, .. } = &endpoint.settings;
        let gate = allowance.gate(&endpoint.shown, model, *requests);
        let turns = allowance.turns(endpoint.origin(), requests.is_some());
        Ok(Self {
            endpoint,
            allowance: allowance.clone(),
            gate,
            turns,
            counters: Counters::default(),
            stop: OnceLock::new(),
            stopped: CancellationToken::new(),
        })
    }

    pub(super) fn settings(&self) -> &Settings {
        &self.endpoint.settings
    }

    pub(super) fn origin(&self) -> String {
        self.endpoint.origin()
    }

    /// Fields of all requests.
    pub(super) fn body(&self) -> &Map<String, Value> {
        &self.endpoint.body
    }

    pub(super) fn spent_of_budget(&self) -> u64 {
        self.allowance.spent()
    }

    /// Sends a request until it is answered. Dropping the future cancels it.
    ///
    /// # Errors
    /// Reason why there is no answer. All but [`Stop::BudgetSpent`], [`Stop::MoneySpent`] and [`Stop::Interrupted`] are also the errors of all later
    /// requests.
    pub(super) async fn send(&self, chat: &Chat<'_>) -> Result<Completion, Stop> {
        let clock = &**self.allowance.clock();
        let settings = self.settings();
        let mut pauses = settings.pauses().build();
        let mut refusals = Refusals::default();
        let mut retries = 0;
        // Failures that say nothing of an endpoint at this address.
        let mut strange = 0;
        loop {
            let mut pass = self.unless_stopped(self.gate.pass()).await?;
            let turn = loop {
                self.unless_stopped(pass.opened(clock)).await?;
                let turn = self.unless_stopped(self.turns.turn()).await?;
                // The gate may have closed meanwhile; a request that waits for it returns its permit.
                if pass.is_open(clock) {
                    break turn;
                }
            };
            self.allowance.check()?;
            let hold = self.unless_stopped(self.allowance.hold(chat.cost_max())).await??;
            let in_flight = self.counters.request();
            let course = Course::default();
            let asked = self.endpoint.ask(chat, clock, &course).await;
            in_flight.over();
            match &asked {
                Ok(completion) if !completion.is_rejected() => hold.costs(chat.cost(completion)),
                _ if course.is_free() => hold.costs(0),
                // The endpoint may charge for what it has begun.
                _ => drop(hold),
            }
            let passing = match asked {
                Ok(mut completion) => {
                    pass.answered();
                    self.allowance.spend(chat.tokens(&completion));
                    completion.answer.retries = retries;
                    return Ok(completion);
                }
                Err(Trouble::Final(stop)) => return Err(self.stop(stop)),
                Err(Trouble::Passing(passing)) => passing,
            };
            let Passing { kind, said, wait, is_strange } = passing;
            let is_unknown = !pass.has_answers();
            strange += u32::from(is_strange);
            self.counters.trouble(kind, &said);
            tracing::debug!(model = settings.model, subject = chat.subject(), "no answer: {said}");
            if let Some(wait) = wait.filter(|wait| *wait > settings.patience) {
                return Err(self.stop(self.come_later(wait, said)));
            }
            let pause = if is_unknown && strange > UNKNOWN_RETRIES {
                Err(retries + 1)
            } else if kind == Kind::Load {
                pass.refused(wait, &mut refusals, settings.pauses(), settings.retries, clock)
            } else {
                drop(pass);
                // The pause also grows: the endpoint's own one may be too short if it asks again and again.
                pauses
                    .next()
                    .map(|grown| Some(wait.unwrap_or_default().max(grown)))
                    .ok_or(retries + 1)
            };
            let pause = pause.map_err(|tries| {
                let url = self.endpoint.shown.clone();
                self.stop(Stop::Unreachable { url, tries, last: said, is_unknown })
            })?;
            // The permit is returned after the gate has changed, so that the next request finds its new state.
            drop(turn);
            retries += 1;
            self.counters.retry();
            if let Some(pause) = pause {
                self.unless_stopped(clock.sleep_until(after(clock.now(), pause))).await?;
            }
        }
    }

    /// Waits for a future, the final stop of this model, or an interruption.
    async fn unless_stopped<T>(&self, what: impl Future<Output = T>) -> Result<T, Stop> {
        tokio::select! {
            biased;
            () = self.stopped.cancelled() => {
                Err(self.stop.get().expect("it is set before anybody is woken").clone())
            }
            () = self.allowance.interrupted() => Err(Stop::Interrupted),
            done = what => Ok(done),
        }
    }

    /// Stops this model for ever. Returns the first reason.
    pub(super) fn stop(&self, stop: Stop) -> Stop {
        let first = self.stop.get_or_init(|| stop).clone();
        self.stopped.cancel();
        first
    }

    fn come_later(&self, wait: Duration, last: String) -> Stop {
        Stop::ComeLater {
            url: self.endpoint.shown.clone(),
            wait_s: millis(wait).div_ceil(1000),
            patience_s: self.endpoint.settings.patience.as_secs(),
            last,
        }
    }
}
