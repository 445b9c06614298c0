//! Language models: questions to any endpoint that speaks chat completions, and cassettes that answer in its place.
//!
//! A [`Model`] is asked [`Question`]s: a game, an agent, a round, and the prompt of that observation. It gives an
//! [`Answer`], or says with a [`Stop`] why no more can be had. The line between the two:
//!
//! - What the model itself does wrong (it refuses, says nothing, runs out of tokens) is an answer with a [`Failure`].
//!   It is not tried again, it costs the model its move, and the game continues.
//! - A question that the endpoint rejects (400, 413, 422) although it takes others costs the model its move, too: it is
//!   asked twice, and the same error comes for ever where a prompt is longer than the model's context. Where the
//!   endpoint takes no question at all, a setting is wrong, and everything stops with its error.
//! - What the endpoint does wrong is tried again with growing pauses. Where it stays wrong, everything stops; no move
//!   is lost, and the run can resume later.
//!
//! A question has one message, the prompt, after a system message if the model has one, and no history: what an agent
//! remembers is for the rules of the game to say, and it is in the prompt.
//!
//! - [`settings`]: which model is asked, where and how. [`key`]: its key, which is never shown. [`headers`]: further
//!   headers. [`api`]: what differs between the interfaces of endpoints.
//! - [`allowance`]: requests at once at each endpoint, and tokens, shared by all models of an evaluation.
//! - `requests`: how requests are sent, tried again and given up.
//! - [`cassette`]: answers in a file.
//! - [`completion`]: what an endpoint's answer says. [`stop`]: why there is none.

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
pub use completion::{Answer, Failure};
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
    /// The game, by a name that is the same whenever it is played: a cassette finds answers by it.
    pub game: String,
    /// The agent who asks.
    pub agent: String,
    /// The round.
    pub round: u32,
    /// The system message, if the model has one: it comes before the prompt.
    pub system: Option<String>,
    /// The observation as text.
    pub prompt: String,
}

/// A language model that answers questions. Cloning shares it.
#[derive(Clone, Debug)]
pub struct Model(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    requests: Requests,
    recorded: Option<RecordedModel>,
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

    /// The name of the model, as the endpoint knows it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.requests.settings().model
    }

    /// The server that is asked, as `https://api.openai.com`: its limits are for all of its models.
    #[must_use]
    pub fn server(&self) -> String {
        self.0.requests.origin()
    }

    /// How long one request may take.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        self.0.requests.settings().timeout
    }

    /// Sends a request. Dropping the future cancels it; an answer that has arrived is on the cassette by then.
    ///
    /// # Errors
    /// Why no answer can be had. All but [`Stop::NotOnCassette`], [`Stop::BudgetSpent`] and [`Stop::Interrupted`] are also
    /// the errors of all later questions to this model.
    pub async fn answer(&self, question: &Question) -> Result<Answer, Stop> {
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

    /// Asks a question of six words, and throws the answer away: whether the address, the key and the settings are right.
    ///
    /// # Errors
    /// As [`Model::answer`].
    pub async fn probe(&self) -> Result<(), Stop> {
        let requests = &self.0.requests;
        let probe = Chat { text: PROBE, question: None, settings: requests.settings() };
        self.count(&requests.send(&probe).await?.completion);
        Ok(())
    }

    /// Asks the endpoint, and asks again where it rejects the question.
    async fn ask(&self, question: &Question) -> Result<Answer, Stop> {
        let requests = &self.0.requests;
        let settings = requests.settings();
        let chat = Chat { text: &question.prompt, question: Some(question), settings };
        let answers = || requests.counters.spent().answers;
        let before = answers();
        let mut answered = requests.send(&chat).await?;
        if answered.completion.is_rejected() {
            if answers() == before {
                // Nothing tells yet whether the endpoint takes any question with these settings.
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

    /// What was asked and spent so far.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.0.requests.counters.spent()
    }

    /// The error of the last failed request, such as `429, slow down`; none while the last one was
    /// answered. For people who wonder why nothing moves.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        self.0.requests.counters.last_trouble()
    }
}

/// Asks an endpoint that rejected a question, and has answered none meanwhile, whether it takes any.
const PROBE: &str = "Reply with the word OK.";

/// A question on its way.
struct Chat<'a> {
    text: &'a str,
    /// None for a probe, which shows what is wrong with the settings.
    question: Option<&'a Question>,
    settings: &'a Settings,
}

impl Chat<'_> {
    /// The purpose of the request, for the log.
    fn subject(&self) -> String {
        self.question.map_or_else(
            || "a probe".to_owned(),
            |question| format!("{} in round {}", question.agent, question.round),
        )
    }

    /// The fields of the body that differ from request to request.
    fn fields(&self) -> Map<String, Value> {
        let system = self.question.and_then(|question| question.system.as_deref());
        self.settings.api.fields(system, self.text)
    }

    /// Reads the body of a success; `None` if it is something else.
    fn read(&self, body: &Value) -> Option<Completion> {
        let body = self.settings.api.completion(body)?;
        let Completion { mut answer, tokens } = completion::read(&body)?;
        answer.response = self.settings.redacted_answer(answer.response);
        answer.reasoning = answer.reasoning.map(|text| self.settings.redacted_answer(text));
        Some(Completion { answer: answer.bounded(), tokens })
    }

    /// An answer in spite of a refusal: a filter took offence at the question, or the endpoint does not take it as it is.
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
            answer: Answer { reasoning, failure, ..Answer::default() },
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
