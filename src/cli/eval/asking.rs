//! The options for requests to models.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value};

use super::super::options::{KEY_VARIABLE, api_base, api_key};
use swarmbench_client::eval::experiment::Experiment;
use swarmbench_client::eval::plan::{ModelPlan, Plan, Who};
use swarmbench_client::llm::{Allowance, ApiKey, Cassette, Model, Sampling, Settings};
use swarmbench_clock::SystemClock;

/// An address for models that are never asked there, as a cassette answers.
const NOWHERE: &str = "http://127.0.0.1:9/v1";

#[derive(Debug, clap::Args)]
pub(super) struct Asking {
    #[arg(
        long,
        value_name = "URL",
        help = "The endpoint, up to /chat/completions, such as https://api.openai.com/v1 [env: OPENAI_BASE_URL]"
    )]
    api_base: Option<String>,
    #[arg(
        long,
        value_name = "NAME",
        help = "The environment variable that holds its key (OPENAI_API_KEY)"
    )]
    api_key_env: Option<String>,
    /// How freely a model draws; not sent where it is left out. Several are several runs.
    #[arg(long, value_delimiter = ',')]
    pub(super) temperature: Vec<f64>,
    /// From which share of the likeliest tokens it draws; not sent where it is left out. Several are several runs.
    #[arg(long, value_delimiter = ',')]
    pub(super) top_p: Vec<f64>,
    /// How many tokens an answer may have; not sent where it is left out.
    #[arg(long, value_name = "TOKENS")]
    max_tokens: Option<u64>,
    #[arg(
        long,
        value_name = "JSON",
        value_parser = object,
        help = "Further fields of each request as a JSON object, such as '{\"reasoning_effort\": \"low\"}'"
    )]
    extra: Option<Map<String, Value>>,
    /// Questions at once, over all games (16).
    #[arg(long, value_name = "QUESTIONS", value_parser = clap::value_parser!(u32).range(1..=4096))]
    requests: Option<u32>,
    /// The token budget of this call, prompts and answers: stop when it is spent. The same command resumes with a new one.
    #[arg(long, value_name = "TOKENS", value_parser = clap::value_parser!(u64).range(1..))]
    budget: Option<u64>,
    /// Seconds that one request may take.
    #[arg(long, value_name = "SECONDS", default_value_t = Settings::TIMEOUT.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    timeout: u64,
    /// How often a question is asked again that the endpoint did not answer.
    #[arg(long, value_name = "TIMES", default_value_t = Settings::RETRIES)]
    retries: u32,
    /// Seconds that one pause before the next try may take.
    #[arg(long, value_name = "SECONDS", default_value_t = Settings::PATIENCE.as_secs(), value_parser = clap::value_parser!(u64).range(1..))]
    patience: u64,
    /// Record all answers in this file; those that are in it already are taken from there.
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    cassette: Option<PathBuf>,
    /// Answer from this recording alone, and ask no endpoint.
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
}

fn object(text: &str) -> Result<Map<String, Value>, String> {
    serde_json::from_str(text).map_err(|error| format!("not a JSON object: {error}"))
}

impl Asking {
    /// Whether a recording alone answers.
    pub(super) fn is_replay(&self) -> bool {
        self.replay.is_some()
    }

    /// What was said on the command line.
    pub(super) fn said(&self) -> Experiment {
        Experiment {
            api_base: self.api_base.clone(),
            api_key_env: self.api_key_env.clone(),
            max_tokens: self.max_tokens,
            extra: self.extra.clone(),
            requests: self.requests,
            budget: self.budget,
            ..Experiment::default()
        }
    }

    /// The models of all runs, in order; none where a built-in player plays. All that can be checked without asking is
    /// checked.
    pub(super) fn models(
        &self,
        experiment: &Experiment,
        plan: &Plan,
    ) -> anyhow::Result<Vec<Option<Model>>> {
        let cassette = match (&self.cassette, &self.replay) {
            (Some(path), _) => Some(Cassette::record(path)?),
            (None, Some(path)) => Some(Cassette::replay(path)?),
            (None, None) => None,
        };
        let requests = experiment.requests.unwrap_or(super::REQUESTS);
        let at_once = usize::try_from(requests).unwrap_or(usize::MAX);
        let allowance = Allowance::new(at_once, experiment.budget, Arc::new(SystemClock));
        let model = |run: &swarmbench_client::eval::plan::Planned| match &run.who {
            Who::Player(_) => Ok(None),
            Who::Model(plan) => {
                let settings = self.settings(plan, cassette.as_ref())?;
                Ok(Some(Model::new(settings, &allowance, cassette.as_ref())?))
            }
        };
        plan.runs.iter().map(model).collect()
    }

    fn settings(&self, plan: &ModelPlan, cassette: Option<&Cassette>) -> anyhow::Result<Settings> {
        let key_variable = plan.api_key_env.as_deref();
        let (base, key) = if cassette.is_some_and(Cassette::is_replay) {
            (NOWHERE.to_owned(), ApiKey::new(key_variable.unwrap_or(KEY_VARIABLE), None))
        } else {
            (
                api_base(plan.api_base.as_deref(), &plan.name, "--api-base")?,
                api_key(key_variable, &plan.name, "--api-key-env")?,
            )
        };
        Ok(Settings {
            sampling: Sampling {
                temperature: plan.temperature,
                top_p: plan.top_p,
                max_tokens: plan.max_tokens,
                seed: None,
            },
            extra: plan.extra.clone(),
            timeout: Duration::from_secs(self.timeout),
            retries: self.retries,
            patience: Duration::from_secs(self.patience),
            ..Settings::new(&plan.model, base, key)
        })
    }
}
