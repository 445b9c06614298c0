//! Options for requests to models.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{anyhow, bail, ensure};
use serde_json::{Map, Value};
use tokio_util::sync::CancellationToken;

use swarmbench_client::eval::experiment::{Experiment, HarnessPlan, Price, SystemMessage};
use swarmbench_client::eval::plan::{MODELS_AT_ONCE_MAX, ModelPlan, Plan, Planned, REQUESTS_MAX};
use swarmbench_client::llm::cassette::Recorded;
use swarmbench_client::llm::{
    Allowance, Api, ApiKey, Budget, Cassette, Headers, Model, PriceList, Settings,
};
use swarmbench_clock::SystemClock;

/// Placeholder address for models that a cassette answers instead.
const NOWHERE: &str = "http://127.0.0.1:9/v1";

/// Default environment variable with the key of an endpoint.
const KEY_VARIABLE: &str = "OPENAI_API_KEY";

/// Address of Anthropic's own models, and the default environment variable with the key.
const ANTHROPIC: (&str, &str) = ("https://api.anthropic.com/v1", "ANTHROPIC_API_KEY");

#[derive(Debug, clap::Args)]
pub(super) struct Asking {
    #[arg(
        long,
        value_name = "URL",
        help = "The address of the endpoint, without /chat/completions or /responses, such as https://api.openai.com/v1 [env: OPENAI_BASE_URL]"
    )]
    api_base: Option<String>,
    #[arg(
        long,
        value_name = "NAME",
        help = "The environment variable with the endpoint's key (OPENAI_API_KEY; ANTHROPIC_API_KEY with --api anthropic)"
    )]
    api_key_env: Option<String>,
    /// The interface of the endpoint: openai for chat completions, responses for OpenAI's responses, anthropic for Anthropic's
    /// messages (openai).
    #[arg(long)]
    api: Option<Api>,
    #[arg(
        long = "header",
        value_name = "NAME: VALUE",
        value_parser = header,
        help = "An additional header of each request; may be repeated. $NAME in the value is an environment variable, so quote \
                the header: --header 'api-key: $AZURE_OPENAI_API_KEY'"
    )]
    headers: Vec<(String, String)>,
    /// The sampling temperature of models. Default: none is sent. Each of several values is a run of its own.
    #[arg(long, value_delimiter = ',')]
    pub(super) temperature: Vec<f64>,
    /// The nucleus sampling (top-p) of models. Default: none is sent. Each of several values is a run of its own.
    #[arg(long, value_delimiter = ',')]
    pub(super) top_p: Vec<f64>,
    /// The maximum number of tokens of an answer. Default: none is sent.
    #[arg(long, value_name = "TOKENS")]
    max_tokens: Option<u64>,
    #[arg(
        long,
        value_name = "TOKENS",
        conflicts_with = "max_tokens",
        help = "The same limit, instead of --max-tokens, for endpoints whose chat completions name it max_completion_tokens"
    )]
    max_completion_tokens: Option<u64>,
    /// The effort of the reasoning, as the endpoint calls it: none, minimal, low, medium, high, xhigh, max. Default: none is sent.
    #[arg(long, value_name = "EFFORT")]
    effort: Option<String>,
    /// The maximum number of tokens of reasoning, with --api anthropic. Default: none is sent.
    #[arg(long, value_name = "TOKENS", value_parser = clap::value_parser!(u64).range(1..))]
    thinking_budget: Option<u64>,
    /// The summary of the reasoning to ask for, with --api responses: auto, concise or detailed. Default: none is asked for.
    #[arg(long, value_name = "SUMMARY")]
    reasoning_summary: Option<String>,
    /// Ask for streams, and record the time to the first token. An endpoint that only streams is asked so in any case.
    #[arg(long)]
    stream: bool,
    #[arg(
        long,
        value_name = "JSON",
        value_parser = object,
        help = "Additional fields of each request, as a JSON object such as '{\"top_k\": 20}'"
    )]
    extra: Option<Map<String, Value>>,
    #[arg(
        long,
        value_name = "TEXT|@FILE",
        help = "The system message, sent before each prompt: a text, or @ and the name of a file. Default: none is sent"
    )]
    system: Option<String>,
    #[command(flatten)]
    harness: HarnessPlan,
    /// The maximum number of concurrent requests to each endpoint, over all its models and games (16).
    #[arg(long, value_name = "QUESTIONS", value_parser = clap::value_parser!(u32).range(1..=i64::from(REQUESTS_MAX)))]
    requests: Option<u32>,
    /// The number of models of one endpoint that play at the same time (1). Models of different endpoints always do.
    #[arg(long, value_name = "MODELS", value_parser = clap::value_parser!(u32).range(1..=i64::from(MODELS_AT_ONCE_MAX)))]
    models_at_once: Option<u32>,
    /// The budget of this command: tokens of prompts and answers together, or US dollars such as 5usd. Dollars are not exceeded while
    /// answers keep to their limit: --max-tokens, or that of --prices, or 32,768 tokens. The evaluation stops when it is spent; the same
    /// command resumes with a new budget.
    #[arg(long, value_name = "TOKENS|USD")]
    budget: Option<Budget>,
    #[arg(
        long,
        value_name = "SHARE",
        value_parser = share,
        help = "The share of a model's answers that may fail in one way before its run stops: 0.5, or off [default: 0.5]"
    )]
    stop_share: Option<f64>,
    #[arg(
        long,
        value_name = "IN,OUT",
        help = "The price of a million tokens of prompts and of answers in US dollars, such as 0.15,0.6. --dry-run and the board \
                show the cost"
    )]
    price: Option<Price>,
    #[arg(
        long,
        value_name = "FILE",
        help = "The file with prices of models that have no price of their own: LiteLLM's model_prices_and_context_window.json, \
                or models.dev's api.json. A cost that an endpoint reports wins"
    )]
    prices: Option<PathBuf>,
    /// The maximum duration of a request.
    #[arg(long, value_name = "SECONDS", default_value_t = Settings::TIMEOUT.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    timeout: u64,
    /// The maximum number of retries of a request that the endpoint did not answer.
    #[arg(long, value_name = "TIMES", default_value_t = Settings::RETRIES)]
    retries: u32,
    /// The maximum pause before a retry.
    #[arg(long, value_name = "SECONDS", default_value_t = Settings::PATIENCE.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    patience: u64,
    /// The file in which to record all answers. Answers that it already has are taken from there.
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    cassette: Option<PathBuf>,
    /// The recording from which all answers are taken: no endpoint is asked.
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
}

fn object(text: &str) -> Result<Map<String, Value>, String> {
    serde_json::from_str(text).map_err(|error| format!("not a JSON object: {error}"))
}

/// Parses a header from the command line.
fn header(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once(':').ok_or("a header looks like 'api-key: $MY_KEY'")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

fn share(text: &str) -> Result<f64, String> {
    if text == "off" {
        return Ok(1.0);
    }
    let share = text.parse().ok().filter(|share| *share > 0.0 && *share <= 1.0);
    share.ok_or_else(|| "a share is more than 0 and at most 1, such as 0.5; or off".to_owned())
}

impl Asking {
    /// Whether all answers come from a recording.
    pub(super) fn is_replay(&self) -> bool {
        self.replay.is_some()
    }

    /// Refuses a header that is given twice, as the last one would win.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let mut names = BTreeSet::new();
        for (name, _) in &self.headers {
            ensure!(names.insert(name.to_ascii_lowercase()), "--header {name}: it is given twice");
        }
        Ok(())
    }

    /// Settings from the command line.
    pub(super) fn said(&self) -> Experiment {
        Experiment {
            api_base: self.api_base.clone(),
            api_key_env: self.api_key_env.clone(),
            api: self.api,
            headers: (!self.headers.is_empty()).then(|| self.headers.iter().cloned().collect()),
            max_tokens: self.max_tokens,
            max_completion_tokens: self.max_completion_tokens,
            effort: self.effort.clone(),
            thinking_budget: self.thinking_budget,
            reasoning_summary: self.reasoning_summary.clone(),
            stream: self.stream.then_some(true),
            extra: self.extra.clone(),
            system: self.system.clone().map(SystemMessage::Text),
            harness: self.harness,
            requests: self.requests,
            models_at_once: self.models_at_once,
            budget: self.budget,
            stop_share: self.stop_share,
            price: self.price,
            ..Experiment::default()
        }
    }

    /// The models of each run, in order; none for built-in players. Checks everything that can be checked without a request. No
    /// request begins after `stop`.
    pub(super) fn models(
        &self,
        experiment: &Experiment,
        plan: &Plan,
        stop: &CancellationToken,
    ) -> anyhow::Result<Vec<Vec<Model>>> {
        let cassette = match (&self.cassette, &self.replay) {
            (Some(path), _) => Some(Cassette::record(path)?),
            (None, Some(path)) => Some(Cassette::replay(path)?),
            (None, None) => None,
        };
        let requests = experiment.requests.unwrap_or(super::REQUESTS);
        let at_once = usize::try_from(requests).unwrap_or(usize::MAX);
        let clock = Arc::new(SystemClock);
        let allowed =
            |tokens| Allowance::interrupted_by(stop.clone(), at_once, tokens, clock.clone());
        let allowance = match experiment.budget {
            None => allowed(None),
            Some(Budget::Tokens(tokens)) => allowed(Some(tokens)),
            Some(Budget::NanoUsd(nano)) => {
                all_have_prices(plan)?;
                allowed(None).with_money(nano)
            }
        };
        let model = |(plan, _): &(&ModelPlan, usize)| {
            let settings = self.settings(plan, cassette.as_ref())?;
            anyhow::Ok(Model::new(settings, &allowance, cassette.as_ref())?)
        };
        plan.runs.iter().map(|run| run.models().iter().map(model).collect()).collect()
    }

    /// The recording that is named, to read it; none if it does not exist yet.
    pub(super) fn recording(&self) -> anyhow::Result<Option<Cassette>> {
        let path = self.cassette.as_deref().filter(|path| path.exists()).or(self.replay.as_deref());
        Ok(path.map(Cassette::replay).transpose()?)
    }

    /// What a recording has of a model that is asked in this way.
    pub(super) fn recorded(
        &self,
        cassette: Option<&Cassette>,
        plan: &ModelPlan,
    ) -> anyhow::Result<Option<Recorded>> {
        let Some(cassette) = cassette else { return Ok(None) };
        Ok(cassette.recorded(&self.settings(plan, Some(cassette))?.body()?))
    }

    /// The list of prices, if one is named.
    pub(super) fn price_list(&self) -> anyhow::Result<Option<PriceList>> {
        let Some(path) = &self.prices else { return Ok(None) };
        let read = PriceList::read(path);
        read.map(Some).map_err(|wrong| anyhow!("--prices {}: {wrong}", path.display()))
    }

    /// The price of a model in the list.
    pub(super) fn price(
        &self,
        list: &PriceList,
        plan: &ModelPlan,
    ) -> Result<Option<Price>, String> {
        let usual = (plan.api == Api::Anthropic).then(|| ANTHROPIC.0.to_owned());
        let base = plan.api_base.clone().or(usual).or_else(environment_base);
        let (path, model) =
            (self.prices.as_deref().unwrap_or(Path::new("")).display(), &plan.model);
        let price = list.of(model, base.as_deref()).map_err(|wrong| {
            format!("--prices {path}: {model}: {wrong}; --price, or price in a file, names one")
        })?;
        if price.is_none() {
            note!("--prices {path}: it has no price of {model}");
        }
        Ok(price)
    }

    fn settings(&self, plan: &ModelPlan, cassette: Option<&Cassette>) -> anyhow::Result<Settings> {
        let key_variable = plan.api_key_env.as_deref();
        let mut base = plan.api_base.as_deref();
        let mut usual_variable = KEY_VARIABLE;
        if plan.api == Api::Anthropic {
            base = base.or(Some(ANTHROPIC.0));
            usual_variable = ANTHROPIC.1;
        }
        let (base, key, headers) = if cassette.is_some_and(Cassette::is_replay) {
            let key = ApiKey::new(key_variable.unwrap_or(usual_variable), None);
            (NOWHERE.to_owned(), key, Headers::default())
        } else {
            let headers =
                headers(&plan.headers).map_err(|wrong| anyhow!("{}: {wrong}", plan.name))?;
            let key = if headers.has_secret() && key_variable.is_none() {
                // The secret header is this endpoint's; the default key may belong to another endpoint.
                ApiKey::new(usual_variable, None)
            } else {
                api_key(key_variable, usual_variable, &plan.name)?
            };
            (api_base(base, &plan.name)?, key, headers)
        };
        Ok(Settings {
            sampling: plan.sampling.clone(),
            streams: plan.stream,
            price: plan.price,
            carries_reasoning: plan.harness.carry_reasoning.unwrap_or_default(),
            extra: plan.extra.clone(),
            api: plan.api,
            headers,
            requests: plan.requests.and_then(|requests| usize::try_from(requests).ok()),
            timeout: Duration::from_secs(self.timeout),
            retries: self.retries,
            patience: Duration::from_secs(self.patience),
            ..Settings::new(&plan.model, base, key)
        })
    }
}

/// Refuses a budget of money with a model whose requests have no highest cost.
fn all_have_prices(plan: &Plan) -> anyhow::Result<()> {
    for (model, _) in plan.runs.iter().flat_map(Planned::models) {
        ensure!(
            model.price.is_some(),
            "a budget in US dollars needs the price of {}, so that the most is known that a request may cost: --price, or \
             --prices with a list that has it",
            model.name
        );
    }
    Ok(())
}

/// Address in the environment.
fn environment_base() -> Option<String> {
    std::env::var("OPENAI_BASE_URL").ok().filter(|url| !url.is_empty())
}

/// Address of a model's endpoint: as named, or from the environment.
fn api_base(named: Option<&str>, model: &str) -> anyhow::Result<String> {
    match named.map(str::to_owned).or_else(environment_base) {
        Some(base) => Ok(base),
        None => bail!(
            "where is {model}? Name its endpoint with --api-base, such as https://api.openai.com/v1, or \
             http://127.0.0.1:11434/v1 for a model on this machine"
        ),
    }
}

/// Key for a model, from the named variable or the default one.
fn api_key(named: Option<&str>, usual: &str, model: &str) -> anyhow::Result<ApiKey> {
    let variable = named.unwrap_or(usual);
    let value = std::env::var(variable).ok();
    if named.is_some() && value.is_none() {
        bail!(
            "the environment variable {variable} is not set: put the key for {model} into it, `export {variable}=…`, or \
             name another with --api-key-env"
        );
    }
    Ok(ApiKey::new(variable, value))
}

fn headers(texts: &BTreeMap<String, String>) -> Result<Headers, String> {
    Headers::parse(texts, |name| std::env::var(name).ok())
}
