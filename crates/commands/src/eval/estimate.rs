//! Estimates of the tokens and the cost of runs, before anything is played.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::anyhow;
use serde_json::json;
use swarmbench_engine::{Act, Config, Message, Seed, Settings};
use swarmbench_players::{default_for, game};
use swarmbench_prompt::{BUILT_IN, tasks};

use swarmbench_client::eval::plan::{ModelPlan, Planned};
use swarmbench_client::llm::cassette::Recorded;
use swarmbench_client::llm::price::to_usd;
use swarmbench_protocol::act::Usage;
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

/// Approximate bytes per token, for English and for maps.
const BYTES_PER_TOKEN: u64 = 4;

/// Assumed tokens of an answer: a few sentences, an action and a message. Reasoning models write many more.
const ANSWER_TOKENS: u64 = 100;

/// Maximum rounds played for the estimate. Prompts reach their full length once agents remember as many rounds as they can.
const ROUNDS_MAX: u32 = 20;

/// Bytes of prompts after which the rounds of such a game are enough.
const PROMPTS_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// Seed in place of sealed ones: the length of prompts hardly depends on the layout.
pub(super) const SEALED_ESTIMATE_SEED: u32 = 27;

/// Message that every agent sends in every round.
const SAID: &str = "I am next to it now and go on to the left in the next round";

/// Explanation of the estimate.
pub(super) const ESTIMATED: &str = "(how: the prompts of a game of a built-in player on the first seed of each task, in which \
     everybody speaks; 4 bytes a token; every game takes all its rounds; answers as long, tries as many and caches as full as those \
     of the model in --cassette, or else answers of 100 tokens, or --max-tokens if that is less, at the first try and without a \
     cache. Its error: where answers were as long, 1 % too low for a model that always speaks, and 10 % too high for one that seldom \
     does. An assumed length is the larger error: models that reason write many times more, up to --max-tokens, so play one game with --cassette, and estimate again)";

/// Tokens of the reply to an invalid answer.
const TOLD_TOKENS: u64 = 30;

/// Approximate upper bound of a run's consumption.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Estimate {
    pub(super) questions: u64,
    pub(super) prompt_tokens: u64,
    pub(super) completion_tokens: u64,
    /// Cost of the tokens, if the price is known.
    pub(super) cost: Option<f64>,
}

impl Estimate {
    /// Adds the estimate of another run.
    pub(super) fn add(&mut self, other: &Self) {
        self.questions = self.questions.saturating_add(other.questions);
        self.prompt_tokens = self.prompt_tokens.saturating_add(other.prompt_tokens);
        self.completion_tokens = self.completion_tokens.saturating_add(other.completion_tokens);
        self.cost = match (self.cost, other.cost) {
            (None, cost) | (cost, None) => cost,
            (Some(one), Some(more)) => Some(one + more),
        };
    }
}

/// What is recorded of a model.
pub(super) type Recording<'a> = dyn Fn(&ModelPlan) -> anyhow::Result<Option<Recorded>> + 'a;

/// Mean bytes of prompts of the games that were played for estimates, by all that they depend on.
pub(super) type PromptBytes = BTreeMap<String, u64>;

/// Estimate of a run, with answers like recorded ones; none for built-in players.
pub(super) fn estimate(
    run: &Planned,
    recorded: &Recording<'_>,
    known: &mut PromptBytes,
) -> anyhow::Result<Option<Estimate>> {
    let mut all: Option<Estimate> = None;
    for (model, seats) in run.models() {
        all.get_or_insert_default().add(&of_model(run, model, seats, recorded(model)?, known)?);
    }
    Ok(all)
}

/// Estimate of a model on `seats` seats of a run. A recording may have any numbers of tokens, so the sums saturate.
fn of_model(
    run: &Planned,
    model: &ModelPlan,
    seats: usize,
    recorded: Option<Recorded>,
    known_bytes: &mut PromptBytes,
) -> anyhow::Result<Estimate> {
    let tasks = run.suite.tasks.len() as u64;
    let questions = run.acts_max(seats);
    let mut prompt_tokens = 0_u64;
    let limit = model.sampling.max_tokens.or(model.sampling.max_completion_tokens);
    let known = recorded.map(|all| all.completion_tokens.div_ceil(all.answers));
    let answer = known.unwrap_or(ANSWER_TOKENS).min(limit.unwrap_or(u64::MAX));
    let [history, notes, tries] = model.harness.numbers().map(u64::from);
    for task in &run.suite.tasks {
        let system = model.system.as_ref().and_then(|system| system.of(task));
        let bytes =
            prompt_bytes(run, task, known_bytes)? + system.map_or(0, |system| system.len() as u64);
        let remembered = bytes.saturating_add(answer.saturating_mul(BYTES_PER_TOKEN));
        let bytes = (bytes + notes).saturating_add(history.saturating_mul(remembered));
        let asked = bytes.div_ceil(BYTES_PER_TOKEN).saturating_mul(questions / tasks.max(1));
        prompt_tokens = prompt_tokens.saturating_add(asked);
    }
    let all = recorded.unwrap_or_default();
    let retried = if tries == 0 {
        0
    } else {
        part(questions, all.answers.saturating_sub(all.acts), all.acts)
    };
    // The prompt of a further try also has the earlier answers and the reasons of their faults.
    let told = retried.saturating_mul(answer.saturating_add(TOLD_TOKENS));
    let repeated = part(prompt_tokens, retried, questions);
    prompt_tokens = prompt_tokens.saturating_add(repeated).saturating_add(told);
    let requests = questions.saturating_add(retried);
    // Prices may depend on the length of a prompt, so one request is priced.
    let asked = prompt_tokens / requests.max(1);
    let each = Usage {
        prompt_tokens: Some(asked),
        completion_tokens: Some(answer),
        cached_tokens: Some(part(asked, all.usage.cached_tokens, all.prompt_tokens)),
        cache_write_tokens: Some(part(asked, all.usage.cache_write_tokens, all.prompt_tokens)),
        reasoning_tokens: Some(part(answer, all.usage.reasoning_tokens, all.completion_tokens)),
        ..Usage::default()
    };
    let cost = model.price.and_then(|price| price.of_usage(&each));
    let cost = cost.map(|nano| to_usd(nano.saturating_mul(requests)));
    let completion_tokens = requests.saturating_mul(answer);
    Ok(Estimate { questions, prompt_tokens, completion_tokens, cost })
}

/// The same part of `whole` as `part` is of `all`.
fn part(whole: u64, part: u64, all: u64) -> u64 {
    let scaled = u128::from(whole) * u128::from(part) / u128::from(all.max(1));
    u64::try_from(scaled).unwrap_or(u64::MAX)
}

/// Mean bytes of a task's prompts, over all rounds of a game and all agents.
fn prompt_bytes(run: &Planned, task: &str, known: &mut PromptBytes) -> anyhow::Result<u64> {
    let suite = &run.suite;
    let first = suite.seeds.first();
    let key = json!([task, suite.rules, suite.settings, first, run.template]).to_string();
    if let Some(bytes) = known.get(&key) {
        return Ok(*bytes);
    }
    let seed = first.copied().unwrap_or_else(|| Seed::from(SEALED_ESTIMATE_SEED));
    let settings = Settings {
        task: task.to_owned(),
        rules: suite.rules.clone(),
        seed: i64::from(seed),
        ..Settings::from(&suite.settings)
    };
    let config = Config::check(&settings).map_err(|errors| anyhow!("{errors}"))?;
    let template = run.template.as_deref().unwrap_or(BUILT_IN);
    let all = u64::from(config.max_round());
    let rounds = config.max_round().min(ROUNDS_MAX);
    let mut played = game::LocalGame::new(Arc::new(config.clone()), default_for(config.task()), 1);
    let (mut sum, mut last, mut count, mut written) = (0, 0, 0, 0);
    for _ in 0..rounds {
        if played.world().is_done() || written > PROMPTS_BYTES_MAX {
            break;
        }
        let agents: Vec<_> =
            played.world().agents().filter(|&agent| played.world().is_alive(agent)).collect();
        let mut bytes = 0;
        for &agent in &agents {
            let seen = played.world().observe(agent);
            let description = tasks::description(&config);
            let sight = Sight::of(&seen, "ep".to_owned(), description, Status::Running, None);
            bytes += swarmbench_prompt::render(template, &sight, &config)?.len() as u64;
        }
        written += bytes;
        last = bytes / (agents.len() as u64).max(1);
        sum += last;
        count += 1;
        let said = Message::new(SAID);
        let speak = |act: Act| Act { message: act.message.or_else(|| said.clone()), ..act };
        let acts: Vec<Act> = played.decide().into_iter().map(speak).collect();
        played.step(&acts);
    }
    // Prompts of the remaining rounds are taken to be as long as the last one.
    let mean = (sum + last * all.saturating_sub(count)).div_ceil(all.max(1));
    known.insert(key, mean);
    Ok(mean)
}
