//! Language models: questions to any endpoint that speaks chat completions, and cassettes that answer in its place.
//!
//! A [`Model`] answers [`Question`]s: a game, an agent, a round, and the prompt of that observation. It returns a [`ModelAnswer`],
//! or a [`Stop`] that says why there are no more answers. Mistakes are divided as follows:
//!
//! - The model's own mistake (it refuses, says nothing, runs out of tokens) is an answer with a [`Failure`]. It is
//!   not retried, it costs the model its move, and the game continues.
//! - A question that the endpoint rejects (400, 413, 422) although it takes others also costs the model its move: it
//!   is asked only twice, as a prompt longer than the model's context gets the same error every time. If the endpoint
//!   takes no question at all, a setting is wrong, and everything stops with its error.
//! - The endpoint's mistake is retried with growing pauses. If it persists, everything stops; no move is lost, and
//!   the run can resume later.
//!
//! A question is one message, the prompt, after a system message if the model has one, without history: the rules of the game
//! define what an agent remembers, and the prompt contains it.
//!
//! - [`settings`]: the model, its endpoint and its parameters. [`key`]: its key, which is never shown. [`headers`]:
//!   further headers. [`api`]: differences between the interfaces of endpoints.
//! - [`allowance`]: limits of concurrent requests at each endpoint and of tokens, shared by all models of an
//!   evaluation.
//! - `requests`: sending, retries, and the final stop.
//! - [`cassette`]: answers in a file.
//! - [`completion`]: parsed answers of endpoints. [`stop`]: reasons why there is none.

pub mod allowance;
pub mod api;
pub mod cassette;
pub mod completion;
mod endpoint;
mod gate;
pub mod headers;
pub mod key;
mod requests;
pub mod settings;
pub mod spent;
pub mod stop;

pub use allowance::Allowance;
pub use api::Api;
pub use cassette::Cassette;
pub use completion::{Failure, ModelAnswer};
pub use headers::Headers;
pub use key::ApiKey;
pub use settings::{Sampling, Settings};
pub use spent::Spent;
pub use stop::Stop;

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value};

use cassette::RecordedModel;
use completion::{Completion, Refusal};
use requests::{Answered, Requests};
use stop::Said;

use swarmbench_clock::millis;

/// A question to a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// Name of the game, the same whenever it is played: a cassette finds answers by it.
    pub game: String,
    /// Id of the asking agent.
    pub agent: String,
    /// Number of the round.
    pub round: u32,
    /// System message before the prompt, if the model has one.
    pub system: Option<String>,
    /// Observation as text.
    pub prompt: String,
}

/// Language model that answers questions. Clones share it.
#[derive(Clone, Debug)]
pub struct Model(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    requests: Requests,
    recorded: Option<RecordedModel>,
}

impl Model {
    /// Creates a model within an allowance. A cassette supplies the answers that it has. Others come from the endpoint and are
    /// recorded; with [`Cassette::replay`] the endpoint is never asked.
    ///
    /// # Errors
    /// [`Stop::Settings`] if a setting cannot work, [`Stop::Cassette`] if the cassette cannot be written.
    pub fn new(
        settings: Settings,
        allowance: &Allowance,
        cassette: Option<&Cassette>,
    ) -> Result<Self, Stop> {
        if settings.api == Api::Anthropic
            && settings.sampling.max_tokens.is_none()
            && !settings.extra.contains_key("max_tokens")
        {
            return Err(Stop::Settings(format!(
                "the messages of Anthropic need a limit of tokens for each answer of {}: name one, such as --max-tokens 4096",
                settings.model
            )));
        }
        let requests = Requests::new(settings, allowance)?;
        let recorded = cassette.map(|cassette| cassette.model(requests.body())).transpose()?;
        Ok(Self(Arc::new(Inner { requests, recorded })))
    }

    /// Name of the model at the endpoint.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.requests.settings().model
    }

    /// Origin of the endpoint, such as `https://api.openai.com`. Its limits apply to all of its models.
    #[must_use]
    pub fn server(&self) -> String {
        self.0.requests.origin()
    }

    /// Timeout of one request.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        self.0.requests.settings().timeout
    }

    /// Sends a request. Dropping the future cancels it; an answer that has arrived is already on the cassette.
    ///
    /// # Errors
    /// A [`Stop`] if there is no answer. All but [`Stop::NotOnCassette`], [`Stop::BudgetSpent`] and [`Stop::Interrupted`] are
    /// also the errors of all later questions to this model.
    pub async fn answer(&self, question: &Question) -> Result<ModelAnswer, Stop> {
        let Inner { requests, recorded } = &*self.0;
        if let Some(recorded) = recorded
            && let Some(answer) = recorded.find(question)?
        {
            requests.counters.replayed(&answer);
            return Ok(answer);
        }
        let answer = self.ask(question).await?;
        if let Some(recorded) = recorded {
            recorded.record(question, &answer).map_err(|stop| requests.stop(stop))?;
        }
        Ok(answer)
    }

    /// Asks a question of six words and drops the answer, to check the address, the key and the settings.
    ///
    /// # Errors
    /// See [`Model::answer`].
    pub async fn probe(&self) -> Result<(), Stop> {
        let requests = &self.0.requests;
        let probe = Chat { text: PROBE, question: None, settings: requests.settings() };
        self.count(&requests.send(&probe).await?.completion);
        Ok(())
    }

    /// Asks the endpoint, and asks again if it rejects the question.
    async fn ask(&self, question: &Question) -> Result<ModelAnswer, Stop> {
        let requests = &self.0.requests;
        let settings = requests.settings();
        let chat = Chat { text: &question.prompt, question: Some(question), settings };
        let answers = || requests.counters.spent().answers;
        let before = answers();
        let mut answered = requests.send(&chat).await?;
        if answered.completion.is_rejected() {
            if answers() == before {
                // No answer has shown yet that the endpoint takes any question with these settings.
                self.probe().await?;
            }
            answered = requests.send(&chat).await?;
        }
        let Answered { completion, latency, retries } = answered;
        self.count(&completion);
        let mut answer = completion.answer;
        answer.usage.latency_ms = Some(millis(latency));
        answer.retries = retries;
        Ok(answer)
    }

    fn count(&self, completion: &Completion) {
        let counters = &self.0.requests.counters;
        if completion.is_rejected() {
            counters.rejected();
        } else {
            counters.answered(completion);
        }
    }

    /// Requests and tokens so far.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.0.requests.counters.spent()
    }

    /// Tokens of the budget spent so far by all models that share it.
    #[must_use]
    pub fn spent_of_budget(&self) -> u64 {
        self.0.requests.spent_of_budget()
    }

    /// Error of the last failed request, such as `429, slow down`, to show why nothing moves; `None` once a later request was
    /// answered.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        self.0.requests.counters.last_trouble()
    }
}

/// Probe of an endpoint that rejected a question and has answered none meanwhile: does it take any?
const PROBE: &str = "Reply with the word OK.";

/// Question or probe in flight.
struct Chat<'a> {
    text: &'a str,
    /// `None` for a probe, whose rejection is an error of the settings.
    question: Option<&'a Question>,
    settings: &'a Settings,
}

impl Chat<'_> {
    fn subject(&self) -> String {
        self.question.map_or_else(
            || "a probe".to_owned(),
            |question| format!("{} in round {}", question.agent, question.round),
        )
    }

    /// Fields of the body that vary between requests.
    fn fields(&self) -> Map<String, Value> {
        let system = self.question.and_then(|question| question.system.as_deref());
        self.settings.api.fields(system, self.text)
    }

    /// Parses the body of a success; `None` for other bodies.
    fn read(&self, body: &Value) -> Option<Completion> {
        let body = self.settings.api.completion(body)?;
        let Completion { mut answer, tokens } = completion::read(&body)?;
        answer.response = self.settings.redacted_answer(answer.response);
        answer.reasoning = answer.reasoning.map(|text| self.settings.redacted_answer(text));
        Some(Completion { answer: answer.bounded(), tokens })
    }

    /// Turns a refusal into an answer with a failure, if a content filter refused the question or the endpoint rejects it.
    fn excuse(&self, status: u16, refusal: &Refusal, said: &Said) -> Option<Completion> {
        self.question?;
        let (what, failure) = match status {
            400 | 403 if refusal.is_filtered => ("content filter", Failure::ContentFilter),
            400 | 413 | 422 => ("rejected", Failure::Rejected),
            _ => return None,
        };
        let reasoning = Some(format!("[{what}] {}", said.0));
        let failure = Some(failure);
        Some(Completion {
            answer: ModelAnswer { reasoning, failure, ..ModelAnswer::default() },
            tokens: None,
        })
    }

    /// Tokens that an answer takes from the budget: as reported by the endpoint, or else a fourth of the bytes.
    fn tokens(&self, completion: &Completion) -> u64 {
        if completion.is_rejected() {
            return 0;
        }
        completion.tokens.unwrap_or_else(|| {
            let answer = &completion.answer;
            let thought = answer.reasoning.as_ref().map_or(0, String::len);
            let system = self.question.and_then(|question| question.system.as_ref());
            let asked = self.text.len() + system.map_or(0, String::len);
            let bytes = asked + answer.response.len() + thought;
            u64::try_from(bytes.div_ceil(4)).unwrap_or(u64::MAX)
        })
    }
}
