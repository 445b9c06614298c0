//! Language models: questions to any endpoint that speaks chat completions, and cassettes that answer in its place.
//!
//! A [`Model`] is asked [`Question`]s: a game, an agent, a round, and the prompt of that observation. It gives an
//! [`Answer`], or says with a [`Stop`] why no more can be had. The line between the two:
//!
//! - What the model itself does wrong (it refuses, says nothing, runs out of tokens) is an answer with a [`Failure`].
//!   It is not tried again, it costs the model its move, and the game continues.
//! - What the endpoint does wrong is tried again with growing pauses. Where it stays wrong, everything stops; no move
//!   is lost, and the run can resume later.
//!
//! A question has one message, the prompt, and no history: what an agent remembers is for the rules of the game to
//! say, and it is in the prompt. The public toolkit asks the same way.
//!
//! - [`settings`]: which model is asked, where and how. [`key`]: its key, which is never shown.
//! - [`allowance`]: requests at once and tokens, shared by all models of an evaluation.
//! - [`cassette`]: answers in a file.
//! - [`completion`]: what an endpoint's answer says. [`stop`]: why there is none.

pub mod allowance;
pub mod cassette;
pub mod completion;
mod endpoint;
mod gate;
pub mod key;
pub mod settings;
pub mod spent;
pub mod stop;

pub use allowance::Allowance;
pub use cassette::Cassette;
pub use completion::{Answer, Failure};
pub use key::ApiKey;
pub use settings::{Sampling, Settings};
pub use spent::Spent;
pub use stop::Stop;

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use backon::BackoffBuilder;
use tokio_util::sync::CancellationToken;

use cassette::RecordedModel;
use completion::Completion;
use endpoint::{Endpoint, Kind, Passing, Trouble};
use gate::Gate;
use spent::Counters;

use swarmbench_clock::{after, millis};

/// Retries of an address that never answered. It may be mistyped, and then its user must not wait for minutes.
const NOBODY_RETRIES: u32 = 2;

/// A question to a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// The game, by a name that is the same whenever it is played: a cassette finds answers by it.
    pub game: String,
    /// The agent who asks.
    pub agent: String,
    /// The round.
    pub round: u32,
    /// The observation as text.
    pub prompt: String,
}

/// A language model that answers questions. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Model(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    endpoint: Endpoint,
    allowance: Allowance,
    gate: Arc<Gate>,
    recorded: Option<RecordedModel>,
    counters: Counters,
    /// Why it stopped for ever; the error of all later questions.
    stop: OnceLock<Stop>,
    /// Wakes those who pause when it has stopped.
    stopped: CancellationToken,
}

impl Model {
    /// A model that is asked within an allowance. With a cassette, what is on it is taken from there; what is not is
    /// asked and added, or with [`Cassette::replay`] never asked.
    ///
    /// # Errors
    /// [`Stop::Settings`] where a setting cannot work, [`Stop::Cassette`] where the cassette cannot be written.
    pub fn new(
        settings: Settings,
        allowance: &Allowance,
        cassette: Option<&Cassette>,
    ) -> Result<Self, Stop> {
        let endpoint = Endpoint::new(settings)?;
        let gate = allowance.gate(&endpoint.shown, &endpoint.settings.model);
        let recorded = cassette.map(|cassette| cassette.model(&endpoint.body)).transpose()?;
        Ok(Self(Arc::new(Inner {
            endpoint,
            allowance: allowance.clone(),
            gate,
            recorded,
            counters: Counters::default(),
            stop: OnceLock::new(),
            stopped: CancellationToken::new(),
        })))
    }

    /// The name of the model, as the endpoint knows it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.endpoint.settings.model
    }

    /// Sends a request. Dropping the future cancels it; an answer that has arrived is on the cassette by then.
    ///
    /// # Errors
    /// Why no answer can be had. All but [`Stop::NotOnCassette`] and [`Stop::BudgetSpent`] are also the errors of all
    /// later questions to this model.
    pub async fn answer(&self, question: &Question) -> Result<Answer, Stop> {
        let inner = &*self.0;
        if let Some(recorded) = &inner.recorded
            && let Some(answer) = recorded.find(question)?
        {
            inner.counters.replayed(&answer);
            return Ok(answer);
        }
        let completion = inner.ask(question).await?;
        inner.counters.answered(&completion.answer, completion.tokens.is_none());
        if let Some(recorded) = &inner.recorded {
            recorded.record(question, &completion.answer).map_err(|stop| inner.stop(stop))?;
        }
        Ok(completion.answer)
    }

    /// What was asked and spent so far.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.0.counters.spent()
    }

    /// The error of the last failed request, such as `429, slow down`; none while the last one was
    /// answered. For people who wonder why nothing moves.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        self.0.counters.last_trouble()
    }
}

impl Inner {
    async fn ask(&self, question: &Question) -> Result<Completion, Stop> {
        let clock = &**self.allowance.clock();
        let settings = &self.endpoint.settings;
        let mut pauses = settings.pauses().build();
        let mut retries = 0;
        loop {
            let mut pass = self.unless_stopped(self.gate.pass()).await?;
            let turn = loop {
                self.unless_stopped(pass.opened(clock)).await?;
                let turn = self.unless_stopped(self.allowance.turn()).await?;
                // The gate may have closed meanwhile; a request that waits for it returns its permit.
                if pass.is_open(clock) {
                    break turn;
                }
            };
            self.allowance.check()?;
            let in_flight = self.counters.request();
            let asked = self.endpoint.ask(&question.prompt, clock).await;
            drop(in_flight);
            let passing = match asked {
                Ok(mut completion) => {
                    pass.answered();
                    self.allowance.spend(cost(question, &completion));
                    completion.answer.retries = retries;
                    return Ok(completion);
                }
                Err(Trouble::Final(stop)) => return Err(self.stop(stop)),
                Err(Trouble::Passing(passing)) => passing,
            };
            let Passing { kind, said, wait, is_nobody } = passing;
            self.counters.trouble(kind, &said);
            tracing::debug!(
                model = settings.model,
                agent = question.agent,
                round = question.round,
                "no answer: {said}"
            );
            if let Some(wait) = wait.filter(|wait| *wait > settings.patience) {
                return Err(self.stop(self.come_later(wait, said)));
            }
            let pause = if kind == Kind::Load {
                pass.refused(wait, settings.pauses(), clock).map(|()| None)
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
                let url = self.endpoint.shown.clone();
                self.stop(Stop::Unreachable { url, tries, last: said })
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

    /// Waits for something, or until this model has stopped.
    async fn unless_stopped<T>(&self, what: impl Future<Output = T>) -> Result<T, Stop> {
        tokio::select! {
            biased;
            () = self.stopped.cancelled() => {
                Err(self.stop.get().expect("it is set before anybody is woken").clone())
            }
            done = what => Ok(done),
        }
    }

    /// Stops for ever. The first reason is reported.
    fn stop(&self, stop: Stop) -> Stop {
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

/// Tokens of an answer for the budget: as reported by the endpoint, or else a fourth of the bytes.
fn cost(question: &Question, completion: &Completion) -> u64 {
    completion.tokens.unwrap_or_else(|| {
        let answer = &completion.answer;
        let thought = answer.reasoning.as_ref().map_or(0, String::len);
        let bytes = question.prompt.len() + answer.response.len() + thought;
        u64::try_from(bytes.div_ceil(4)).unwrap_or(u64::MAX)
    })
}
