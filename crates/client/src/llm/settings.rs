//! Settings of a model: its name, endpoint and parameters.

use std::time::Duration;

use backon::ExponentialBuilder;
use reqwest::Url;
use serde_json::{Map, Value, json};

use super::api::Api;
use super::headers::Headers;
use super::key::ApiKey;
use super::stop::Stop;

/// Model at an endpoint, parameters of its requests, and limits of its retries.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Name of the model at the endpoint.
    pub model: String,
    /// Interface of the endpoint for conversations.
    pub api: Api,
    /// Address of the endpoint up to `/chat/completions` or `/messages`, such as `https://api.openai.com/v1`. `/v1` is not
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
    /// Further fields of the request's body, such as `reasoning_effort`.
    pub extra: Map<String, Value>,
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
            timeout: Self::TIMEOUT,
            retries: Self::RETRIES,
            patience: Self::PATIENCE,
        }
    }

    /// Fields of the body, without the messages. Cassettes identify models by them.
    ///
    /// # Errors
    /// [`Stop::Settings`] if a further field has its own setting, or contains the key.
    pub fn body(&self) -> Result<Map<String, Value>, Stop> {
        let Sampling { temperature, top_p, max_tokens, seed } = self.sampling;
        let own = [
            ("model", Some(json!(self.model))),
            ("temperature", temperature.map(|value| json!(value))),
            ("top_p", top_p.map(|value| json!(value))),
            ("max_tokens", max_tokens.map(|value| json!(value))),
            ("seed", seed.map(|value| json!(value))),
        ];
        let own = own.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?)));
        let mut body: Map<String, Value> = own.collect();
        for (name, value) in &self.extra {
            if ["model", "messages", "system", "stream", "n"].contains(&name.as_str()) {
                return Err(Stop::Settings(format!(
                    "the further field {name:?} of the request's body has its own value here"
                )));
            }
            if body.insert(name.clone(), value.clone()).is_some() {
                return Err(Stop::Settings(format!(
                    "{name:?} of the request's body is given twice"
                )));
            }
        }
        let text = Value::Object(body.clone()).to_string();
        if let Some(key) = self.secrets().find(|key| key.is_in(&text)) {
            let variable = key.variable();
            return Err(Stop::Settings(format!(
                "the request's body holds the key of {variable}, and bodies are written to cassettes"
            )));
        }
        Ok(body)
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
        let (path, end) = (url.path().trim_end_matches('/'), self.api.path());
        let path = format!("{}{end}", path.strip_suffix(end).unwrap_or(path));
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

/// Sampling parameters. A missing parameter is not sent, so the endpoint's default applies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sampling {
    /// Temperature: 0 takes the likeliest token.
    pub temperature: Option<f64>,
    /// Nucleus: the share of the likeliest tokens.
    pub top_p: Option<f64>,
    /// Maximum tokens of an answer.
    pub max_tokens: Option<u64>,
    /// Seed, for endpoints that take one.
    pub seed: Option<i64>,
}
