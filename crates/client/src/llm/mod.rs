//! Language models: questions to any endpoint that has chat completions, responses or messages, and cassettes that answer in
//! its place.
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
//! A question is one message, the prompt, after a system message if the model has one. By default it has no history: the rules of
//! the game define what an agent remembers, and the prompt contains it. A harness may put earlier messages before the prompt.
//!
//! - [`settings`]: the model, its endpoint and its parameters. [`key`]: its key, which is never shown. [`headers`]:
//!   further headers. [`api`]: differences between the interfaces of endpoints.
//! - [`allowance`]: limits of concurrent requests at each endpoint and of tokens, shared by all models of an
//!   evaluation.
//! - [`price`]: prices of tokens and budgets. [`price_list`]: files with prices. `usage`: tokens and costs that endpoints report.
//! - `requests`: sending, retries, and the final stop.
//! - [`cassette`]: answers in a file.
//! - [`completion`]: parsed answers of endpoints. [`responses`]: those of one interface. `stream`: answers that come in pieces. [`stop`]: reasons why there is none.

pub mod allowance;
pub mod api;
pub mod cassette;
pub mod completion;
mod endpoint;
mod gate;
pub mod headers;
pub mod key;
pub mod price;
pub mod price_list;
mod requests;
pub mod responses;
pub mod settings;
pub mod spent;
pub mod stop;
mod stream;
mod usage;

pub use allowance::Allowance;
pub use api::Api;
pub use cassette::Cassette;
pub use completion::{Failure, ModelAnswer};
pub use headers::Headers;
pub use key::ApiKey;
pub use price::{Budget, Price};
pub use price_list::PriceList;
pub use settings::{Sampling, Settings};
pub use spent::Spent;
pub use stop::Stop;

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value, json};

use cassette::RecordedModel;
use completion::{Completion, Refusal};
use requests::Requests;
use stop::Said;

use swarmbench_protocol::act::Usage;

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
    /// Messages before the prompt, as objects with `role` and `content`; for the interface `responses` also items of earlier
    /// [answers](ModelAnswer::items).
    pub items: Vec<Value>,
    /// JSON schema that the answer must follow, if the endpoint knows how.
    pub schema: Option<Value>,
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
            && settings.sampling.max_tokens.or(settings.sampling.max_completion_tokens).is_none()
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
    /// A [`Stop`] if there is no answer. All but [`Stop::NotOnCassette`], [`Stop::BudgetSpent`], [`Stop::MoneySpent`] and [`Stop::Interrupted`] are
    /// also the errors of all later questions to this model.
    pub async fn answer(&self, question: &Question) -> Result<ModelAnswer, Stop> {
        let Inner { requests, recorded } = &*self.0;
        if let Some(recorded) = recorded
            && let Some(mut answer) = recorded.find(question)?
        {
            requests.settings().add_cost(&mut answer.usage);
            requests.counters.replayed(&answer);
            return Ok(answer);
        }
        let mut answer = self.ask(question).await?;
        if let Some(recorded) = recorded {
            recorded.record(question, &answer).map_err(|stop| requests.stop(stop))?;
        }
        // A recording has what the endpoint reported, and may be replayed at other prices.
        requests.settings().add_cost(&mut answer.usage);
        Ok(answer)
    }

    /// Asks a question of six words and drops the answer, to check the address, the key and the settings.
    ///
    /// # Errors
    /// See [`Model::answer`].
    pub async fn probe(&self) -> Result<(), Stop> {
        let requests = &self.0.requests;
        let probe = Chat { text: PROBE, question: None, settings: requests.settings() };
        self.count(&probe, &requests.send(&probe).await?);
        Ok(())
    }

    /// Asks the endpoint, and asks again if it rejects the question.
    async fn ask(&self, question: &Question) -> Result<ModelAnswer, Stop> {
        let requests = &self.0.requests;
        let settings = requests.settings();
        let chat = Chat { text: &question.prompt, question: Some(question), settings };
        let answers = || requests.counters.spent().answers;
        let before = answers();
        let mut completion = requests.send(&chat).await?;
        if completion.is_rejected() {
            if answers() == before {
                // No answer has shown yet that the endpoint takes any question with these settings.
                self.probe().await?;
            }
            completion = requests.send(&chat).await?;
        }
        self.count(&chat, &completion);
        Ok(completion.answer)
    }

    fn count(&self, chat: &Chat<'_>, completion: &Completion) {
        let counters = &self.0.requests.counters;
        if completion.is_rejected() {
            counters.rejected();
        } else {
            counters.answered(completion, chat.has_odd_cost(completion));
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

/// Tokens of a request beside its texts: roles and separators.
const FRAME_TOKENS: usize = 64;

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
        let items = self.question.map_or(&[][..], |question| &question.items);
        let mut fields = self.settings.api.fields(system, self.text, items);
        let schema = self.question.and_then(|question| question.schema.as_ref());
        fields.extend(schema.map(|schema| self.settings.api.schema(schema)));
        fields
    }

    /// Parses the body of a success; `None` for other bodies.
    fn read(&self, body: &Value) -> Option<Completion> {
        let Completion { mut answer, tokens, has_false_cost } =
            completion::read(self.settings.api.completion(body)?.as_ref())?;
        if self.settings.carries_reasoning {
            // Reasoning is carried whole or not at all, so nothing of it is replaced.
            answer.items = responses::items(body);
            if answer.items.iter().any(|item| self.settings.has_secret(item)) {
                answer.items.clear();
            }
        }
        answer.response = self.settings.redacted_answer(answer.response);
        answer.reasoning = answer.reasoning.map(|text| self.settings.redacted_answer(text));
        Some(Completion { answer: answer.bounded(), tokens, has_false_cost })
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
            has_false_cost: false,
        })
    }

    /// Tokens that an answer takes from the budget.
    fn tokens(&self, completion: &Completion) -> u64 {
        if completion.is_rejected() {
            return 0;
        }
        let Usage { prompt_tokens, completion_tokens, .. } = self.metered(completion);
        let sum = prompt_tokens.unwrap_or(0).saturating_add(completion_tokens.unwrap_or(0));
        completion.tokens.unwrap_or(0).max(sum)
    }

    /// Usage of an answer: as reported by the endpoint, and a fourth of the bytes where it reports no tokens.
    fn metered(&self, completion: &Completion) -> Usage {
        let [asked, said] = self.estimated(completion);
        let mut usage = completion.answer.usage;
        usage.prompt_tokens = usage.prompt_tokens.or(Some(asked));
        usage.completion_tokens = usage.completion_tokens.or(Some(said));
        usage
    }

    /// Tokens of prompt and answer by their bytes.
    fn estimated(&self, completion: &Completion) -> [u64; 2] {
        let answer = &completion.answer;
        let thought = answer.reasoning.as_ref().map_or(0, String::len);
        let tokens = |bytes: usize| u64::try_from(bytes.div_ceil(4)).unwrap_or(u64::MAX);
        // One sum, as both parts together are rounded up once.
        let all = tokens(self.bytes() + answer.response.len() + thought);
        let asked = tokens(self.bytes()).min(all);
        [asked, all - asked]
    }

    /// Bytes of the texts of the question.
    fn bytes(&self) -> usize {
        let system = self.question.and_then(|question| question.system.as_ref());
        let items = self.question.map_or(&[][..], |question| &question.items);
        let items: usize = items.iter().map(|item| item.to_string().len()).sum();
        let schema = self.question.and_then(|question| question.schema.as_ref());
        let schema = schema.map_or(0, |schema| schema.to_string().len());
        self.text.len() + system.map_or(0, String::len) + items + schema
    }

    /// Cost of an answer for a budget, in billionths of a US dollar: as reported, but not less than by the price.
    fn cost(&self, completion: &Completion) -> u64 {
        let usage = completion.answer.usage;
        // An answer with unknown tokens, or with more than a price can express, counts as the highest cost of its request.
        let price_of = |price: Price| price.of_usage(&usage).unwrap_or_else(|| self.cost_max());
        let priced = self.settings.price.map(price_of).filter(|_| !completion.is_rejected());
        usage.cost_nano_usd.max(priced).unwrap_or(0)
    }

    /// True if the endpoint reports an impossible cost, or the answer costs more than the highest cost of its request.
    fn has_odd_cost(&self, completion: &Completion) -> bool {
        let has_price = self.settings.price.is_some();
        completion.has_false_cost || has_price && self.cost(completion) > self.cost_max()
    }

    /// The highest cost of the request in billionths of a US dollar: a token has at least one byte, and an answer at most its limit
    /// of tokens.
    fn cost_max(&self) -> u64 {
        let extra = json!(self.settings.extra).to_string().len();
        let asked = u64::try_from(self.bytes() + extra + FRAME_TOKENS).unwrap_or(u64::MAX);
        let price = self.settings.price;
        price.map_or(0, |price| price.at_most(asked, self.settings.answer_tokens_max()))
    }
}
