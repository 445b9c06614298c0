//! Estimates of the tokens and the cost of runs, before anything is played.

use std::sync::Arc;

use anyhow::anyhow;
use swarmbench_engine::{Act, Config, Message, Seed, Settings};
use swarmbench_players::{default_for, game};
use swarmbench_prompt::{BUILT_IN, tasks};

use swarmbench_client::eval::plan::{Planned, Who};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

/// Approximate bytes per token, for English and for maps.
const BYTES_PER_TOKEN: u64 = 4;

/// Assumed tokens of an answer: a few sentences, an action and a message. Reasoning models write many more.
const ANSWER_TOKENS: u64 = 100;

/// Maximum rounds played for the estimate. Prompts reach their full length once agents remember as many rounds as they can.
const ROUNDS_MAX: u32 = 20;

/// Seed in place of sealed ones: the length of prompts hardly depends on the layout.
pub(super) const SEALED_ESTIMATE_SEED: u32 = 27;

/// Message that every agent sends in every round.
const SAID: &str = "I am next to it now and go on to the left in the next round";

/// Explanation of the estimate.
pub(super) const ESTIMATED: &str = "(how: the prompts of a game of a built-in player on the first seed of each task, in which \
     everybody speaks; 4 bytes a token; every game takes all its rounds; 100 tokens an answer, or --max-tokens if that is \
     less. Models that reason write many times more, up to --max-tokens)";

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
        self.questions += other.questions;
        self.prompt_tokens += other.prompt_tokens;
        self.completion_tokens += other.completion_tokens;
        self.cost = match (self.cost, other.cost) {
            (None, cost) | (cost, None) => cost,
            (Some(one), Some(more)) => Some(one + more),
        };
    }
}

/// Estimate of a model's run; none for built-in players.
pub(super) fn estimate(run: &Planned) -> anyhow::Result<Option<Estimate>> {
    let Who::Model(model) = &run.who else { return Ok(None) };
    let tasks = run.suite.tasks.len() as u64;
    let questions = run.acts_max();
    let mut prompt_tokens = 0;
    for task in &run.suite.tasks {
        let system = run.system_of(task).map_or(0, |system| system.len() as u64);
        let bytes = prompt_bytes(run, task)? + system;
        prompt_tokens += bytes.div_ceil(BYTES_PER_TOKEN) * (questions / tasks.max(1));
    }
    let answer = model.max_tokens.map_or(ANSWER_TOKENS, |most| most.min(ANSWER_TOKENS));
    let completion_tokens = questions * answer;
    let cost = model.price.map(|price| price.of(prompt_tokens, completion_tokens));
    Ok(Some(Estimate { questions, prompt_tokens, completion_tokens, cost }))
}

/// Mean bytes of a task's prompts, over all rounds of a game and all agents.
fn prompt_bytes(run: &Planned, task: &str) -> anyhow::Result<u64> {
    let suite = &run.suite;
    let seed = suite.seeds.first().copied();
    let seed = seed.unwrap_or_else(|| Seed::from(SEALED_ESTIMATE_SEED));
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
    let (mut sum, mut last, mut count) = (0, 0, 0);
    for _ in 0..rounds {
        if played.world().is_done() {
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
        last = bytes / (agents.len() as u64).max(1);
        sum += last;
        count += 1;
        let said = Message::new(SAID);
        let speak = |act: Act| Act { message: act.message.or_else(|| said.clone()), ..act };
        let acts: Vec<Act> = played.decide().into_iter().map(speak).collect();
        played.step(&acts);
    }
    // Prompts of the remaining rounds are taken to be as long as the last one.
    Ok((sum + last * all.saturating_sub(count)).div_ceil(all.max(1)))
}
