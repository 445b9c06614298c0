//! Settings of a model: its name, endpoint and parameters.

use std::time::Duration;

use backon::ExponentialBuilder;
use clap::ValueEnum;
use reqwest::Url;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::api::Api;
use super::headers::Headers;
use super::key::ApiKey;
use super::price::Price;
use super::stop::Stop;
use swarmbench_protocol::act::Usage;

/// Fields of requests that are set here and nowhere else.
const OWN_FIELDS: [&str; 8] =
    ["model", "messages", "system", "stream", "n", "input", "instructions", "previous_response_id"];

/// Assumed maximum tokens of an answer without a limit, for a budget of money.
pub const ANSWER_TOKENS_MAX: u64 = 32_768;

/// Model at an endpoint, parameters of its requests, and limits of its retries.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Name of the model at the endpoint.
    pub model: String,
    /// Interface of the endpoint for conversations.
    pub api: Api,
    /// Address of the endpoint up to `/chat/completions`, `/responses` or `/messages`, such as `https://api.openai.com/v1`. `/v1` is not
    /// added; a slash at the end is ignored, and a query stays.
    pub api_base: String,
    /// Key, if the endpoint requires one.
    pub key: ApiKey,
    /// Further headers of each request.
    pub headers: Headers,
    /// Maximum requests to this model in flight, not counted with those to other models of its endpoint. By default all models
    /// of an endpoint share the limit of the allowance.
    pub requests: Option<usize>,
    /// Sampling parameters.
    pub sampling: Sampling,
    /// Further fields of the request's body, such as `top_k`.
    pub extra: Map<String, Value>,
    /// True if streams are asked for. An endpoint that answers in no other way is asked for one in any case.
    pub streams: bool,
    /// True if responses are asked for encrypted reasoning, which a later request can carry: [`ModelAnswer::items`].
    ///
    /// [`ModelAnswer::items`]: super::ModelAnswer::items
    pub carries_reasoning: bool,
    /// Price of tokens, for answers whose cost the endpoint does not report.
    pub price: Option<Price>,
    /// Timeout of one request, from its beginning to the last byte of its answer.
    pub timeout: Duration,
    /// Maximum retries of one question. Refusals for the endpoint's load count only while the endpoint answers no other
    /// question of the model.
    pub retries: u32,
    /// Longest pause before a question is asked again.
    pub patience: Duration,
}

impl Settings {
    /// Default timeout: reasoning models think for minutes.
    pub const TIMEOUT: Duration = Duration::from_mins(10);
    /// Default retries: nine pauses are three to six minutes.
    pub const RETRIES: u32 = 9;
    /// Default longest pause.
    pub const PATIENCE: Duration = Duration::from_mins(10);

    /// Model with default settings; the endpoint decides the sampling.
    #[must_use]
    pub fn new(model: impl Into<String>, api_base: impl Into<String>, key: ApiKey) -> Self {
        Self {
            model: model.into(),
            api: Api::default(),
            api_base: api_base.into(),
            key,
            headers: Headers::default(),
            requests: None,
            sampling: Sampling::default(),
            extra: Map::new(),
            streams: false,
            carries_reasoning: false,
            price: None,
            timeout: Self::TIMEOUT,
            retries: Self::RETRIES,
            patience: Self::PATIENCE,
        }
    }

    /// Adds the cost by the price, if the endpoint reported none.
    pub(super) fn add_cost(&self, usage: &mut Usage) {
        if usage.cost_nano_usd.is_none() {
            usage.cost_nano_usd = self.price.and_then(|price| price.of_usage(usage));
        }
    }

    /// Maximum tokens of an answer, reasoning included: as set, of several limits the highest, or as the list of prices names it,
    /// or else [`ANSWER_TOKENS_MAX`].
    pub(super) fn answer_tokens_max(&self) -> u64 {
        let Sampling { max_tokens, max_completion_tokens, .. } = self.sampling;
        let names = ["max_tokens", "max_completion_tokens", "max_output_tokens"];
        let extra = names.iter().filter_map(|name| self.extra.get(*name)?.as_u64()).max();
        let listed = || self.price?.answer_tokens_max;
        max_tokens
            .max(max_completion_tokens)
            .max(extra)
            .or_else(listed)
            .unwrap_or(ANSWER_TOKENS_MAX)
    }

    /// Fields of the body, without the messages. Cassettes identify models by them.
    ///
    /// # Errors
    /// [`Stop::Settings`] if a further field has its own setting, or contains the key.
    pub fn body(&self) -> Result<Map<String, Value>, Stop> {
        let wrong = |what| Stop::Settings(format!("{}: {what}", self.model));
        let mut body = self.api.sampling(&self.sampling).map_err(wrong)?;
        body.insert("model".to_owned(), json!(self.model));
        if self.carries_reasoning && self.api == Api::Responses {
            body.insert("include".to_owned(), json!(["reasoning.encrypted_content"]));
        }
        for (name, value) in &self.extra {
            if OWN_FIELDS.contains(&name.as_str()) {
                return Err(Stop::Settings(format!(
                    "the further field {name:?} of the request's body has its own value here"
                )));
            }
            if body.insert(name.clone(), value.clone()).is_some() {
                return Err(Stop::Settings(format!(
                    "{name:?} of the request's body is given twice: by an option and as a further field"
                )));
            }
        }
        if self.api == Api::Responses {
            // All that a request needs is in it, so the endpoint keeps nothing unless it is told to.
            body.entry("store").or_insert(json!(false));
        }
        let holds = |key: &&ApiKey| {
            key.is_part_of(&self.model) || self.extra.values().any(|value| key.is_in(value))
        };
        if let Some(key) = self.secrets().find(holds) {
            let variable = key.variable();
            return Err(Stop::Settings(format!(
                "the request's body holds the key of {variable}, and bodies are written to cassettes"
            )));
        }
        Ok(body)
    }

    /// True if a value holds a secret.
    pub(super) fn has_secret(&self, value: &Value) -> bool {
        self.secrets().any(|key| key.is_in(value))
    }

    /// All secrets: the key, and those of headers.
    fn secrets(&self) -> impl Iterator<Item = &ApiKey> {
        std::iter::once(&self.key).chain(self.headers.secrets())
    }

    /// Secret that authenticates requests: the key, or the first secret of a header.
    pub(super) fn credential(&self) -> &ApiKey {
        self.secrets().find(|key| key.is_there()).unwrap_or(&self.key)
    }

    pub(super) fn redacted(&self, text: &str) -> String {
        self.secrets().fold(text.to_owned(), |text, key| key.redacted(&text))
    }

    /// Answer without secrets.
    pub(super) fn redacted_answer(&self, text: String) -> String {
        self.secrets().fold(text, |text, key| key.redacted_answer(text))
    }

    /// Address of requests.
    ///
    /// # Errors
    /// [`Stop::Settings`] if the base is no address, or contains credentials.
    pub(super) fn url(&self) -> Result<Url, Stop> {
        let wrong = |what: &str| {
            Stop::Settings(format!(
                "the api base {what}; it looks like https://api.openai.com/v1 or http://127.0.0.1:11434/v1"
            ))
        };
        let parsed = Url::parse(self.api_base.trim()).ok();
        let is_web = |url: &Url| url.has_host() && ["http", "https"].contains(&url.scheme());
        let mut url = parsed.filter(is_web).ok_or_else(|| wrong("is no address of a server"))?;
        if !url.username().is_empty() || url.password().is_some() {
            let variable = self.key.variable();
            return Err(wrong(&format!("holds credentials: put the key into {variable} instead")));
        }
        let path = url.path().trim_end_matches('/');
        let bases = Api::value_variants().iter().find_map(|api| path.strip_suffix(api.path()));
        let base = bases.unwrap_or(path);
        let path = format!("{base}{}", self.api.path());
        url.set_path(&path);
        Ok(url)
    }

    /// Growing pauses from 0.5 s to 60 s, with random jitter of up to as much again, and never longer than the patience.
    pub(super) fn pauses(&self) -> ExponentialBuilder {
        let half = self.patience / 2;
        ExponentialBuilder::default()
            .with_jitter()
            .with_min_delay(half.min(Duration::from_millis(500)))
            .with_max_delay(half.min(Duration::from_mins(1)))
            .with_max_times(usize::try_from(self.retries).unwrap_or(usize::MAX))
    }
}

/// Sampling parameters. A missing parameter is not sent, so the endpoint's default applies. Those that a run has no other place
/// for are serialized into its identity.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Sampling {
    /// Temperature: 0 takes the likeliest token.
    #[serde(skip)]
    pub temperature: Option<f64>,
    /// Nucleus: the share of the likeliest tokens.
    #[serde(skip)]
    pub top_p: Option<f64>,
    /// Maximum tokens of an answer.
    pub max_tokens: Option<u64>,
    /// The same limit by its newer name in chat completions, where it counts reasoning, too. Only one of both is set.
    pub max_completion_tokens: Option<u64>,
    /// Effort of the reasoning, such as `low`.
    pub effort: Option<String>,
    /// Tokens of reasoning, for Anthropic's messages.
    pub thinking_budget: Option<u64>,
    /// Summary of the reasoning that responses are asked for, such as `auto`.
    pub reasoning_summary: Option<String>,
    /// Seed, for endpoints that take one.
    #[serde(skip)]
    pub seed: Option<i64>,
}
