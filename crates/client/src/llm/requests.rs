//! Requests to one model at its endpoint: how many at once, which are tried again, and when they stop for ever.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use backon::BackoffBuilder;
use serde_json::{Map, Value};
use tokio_util::sync::CancellationToken;

use super::allowance::Allowance;
use super::allowance::Turns;
use super::completion::{self, Refusal};
use super::endpoint::{Endpoint, Kind, Passing, Trouble};
use super::gate::{Gate, Refusals};
use super::route::Route;
use super::settings::Settings;
use super::spent::Counters;
use super::stop::{Said, Stop};

use swarmbench_clock::{after, millis};

/// Retries of an address that never answered. It may be mistyped, and then its user must not wait for minutes.
const NOBODY_RETRIES: u32 = 2;

/// A request of one kind, and how its answer is read.
pub(crate) trait Request {
    /// A good answer.
    type Answer;

    /// What it asks for, for the log.
    fn subject(&self) -> String;

    /// The fields of the body that differ from request to request.
    fn fields(&self) -> Map<String, Value>;

    /// Reads JSON; `None` if it is none.
    fn parse(&self, body: &[u8]) -> Option<Value> {
        completion::parse(body)
    }

    /// Reads the body of a success; `None` if it is something else.
    fn read(&self, body: &Value) -> Option<Self::Answer>;

    /// An answer in spite of a refusal: where the request is at fault, and not the endpoint or its settings.
    fn excuse(&self, status: u16, refusal: &Refusal, said: &Said) -> Option<Self::Answer>;

    /// What an answer costs of the budget.
    fn tokens(&self, answer: &Self::Answer) -> u64;
}

/// An answer, and what it took.
#[derive(Debug)]
pub(crate) struct Answered<A> {
    pub(crate) answer: A,
    /// The duration of the request that succeeded.
    pub(crate) latency: Duration,
    /// Retries before it.
    pub(crate) retries: u32,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Requests {
    endpoint: Endpoint,
    allowance: Allowance,
    gate: Arc<Gate>,
    turns: Turns,
    pub(crate) counters: Counters,
    /// Why it stopped for ever; the error of all later requests.
    stop: OnceLock<Stop>,
    /// Wakes those who pause when it has stopped.
    stopped: CancellationToken,
}

impl Requests {
    /// # Errors
    /// [`Stop::Settings`] where a setting cannot work.
    pub(crate) fn new(
        settings: Settings,
        route: Route,
        allowance: &Allowance,
    ) -> Result<Self, Stop> {
        let endpoint = Endpoint::new(settings, route)?;
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

    pub(crate) fn settings(&self) -> &Settings {
        &self.endpoint.settings
    }

    /// The server that is asked.
    pub(crate) fn origin(&self) -> String {
        self.endpoint.origin()
    }

    /// The address that is asked, as it may be shown.
    pub(crate) fn url(&self) -> &str {
        &self.endpoint.shown
    }

    /// The fields that all requests have.
    pub(crate) fn body(&self) -> &Map<String, Value> {
        &self.endpoint.body
    }

    /// Sends a request until it is answered. Dropping the future cancels it.
    ///
    /// # Errors
    /// Why no answer can be had. All but [`Stop::BudgetSpent`] and [`Stop::Interrupted`] are also the errors of all later
    /// requests.
    pub(crate) async fn send<R: Request>(&self, request: &R) -> Result<Answered<R::Answer>, Stop> {
        let clock = &**self.allowance.clock();
        let settings = self.settings();
        let mut pauses = settings.pauses().build();
        let mut refusals = Refusals::default();
        let mut retries = 0;
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
            let in_flight = self.counters.request();
            let asked = self.endpoint.ask(request, clock).await;
            in_flight.over();
            let passing = match asked {
                Ok((answer, latency)) => {
                    pass.answered();
                    self.allowance.spend(request.tokens(&answer));
                    return Ok(Answered { answer, latency, retries });
                }
                Err(Trouble::Final(stop)) => return Err(self.stop(stop)),
                Err(Trouble::Passing(passing)) => passing,
            };
            let Passing { kind, said, wait, is_nobody } = passing;
            self.counters.trouble(kind, &said);
            tracing::debug!(
                model = settings.model,
                subject = request.subject(),
                "no answer: {said}"
            );
            if let Some(wait) = wait.filter(|wait| *wait > settings.patience) {
                return Err(self.stop(self.come_later(wait, said)));
            }
            let pause = if kind == Kind::Load {
                pass.refused(wait, &mut refusals, settings.pauses(), settings.retries, clock)
            } else if is_nobody && retries >= NOBODY_RETRIES {
                Err(retries + 1)
            } else {
                drop(pass);
                // The endpoint's own pause may be too short if it asks for one again and again.
                pauses
                    .next()
                    .map(|grown| Some(wait.unwrap_or_default().max(grown)))
                    .ok_or(retries + 1)
            };
            let pause = pause.map_err(|tries| {
                let (url, route) = (self.endpoint.shown.clone(), self.endpoint.route);
                self.stop(Stop::Unreachable { url, route, tries, last: said })
            })?;
            // The next request finds the gate as it is now.
            drop(turn);
            retries += 1;
            self.counters.retry();
            if let Some(pause) = pause {
                self.unless_stopped(clock.sleep_until(after(clock.now(), pause))).await?;
            }
        }
    }

    /// Waits for something, or until this model has stopped or everything is interrupted.
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

    /// Stops for ever. The first reason is reported.
    pub(crate) fn stop(&self, stop: Stop) -> Stop {
        let first = self.stop.get_or_init(|| stop).clone();
        self.stopped.cancel();
        first
    }

    fn come_later(&self, wait: Duration, last: String) -> Stop {
        Stop::ComeLater {
            url: self.endpoint.shown.clone(),
            route: self.endpoint.route,
            wait_s: millis(wait).div_ceil(1000),
            patience_s: self.endpoint.settings.patience.as_secs(),
            last,
        }
    }
}
