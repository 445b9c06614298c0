//! Language models: asked at a real HTTP server that misbehaves in every way that endpoints do, and played from cassettes.

mod answers;
mod api;
mod budget;
mod cassettes;
pub(crate) mod endpoint;
mod game;
mod money;
mod pieces;
mod prices;
pub(crate) mod responses;
mod retries;
pub(crate) mod schema;
mod secrets;
mod stops;
mod streams;
mod time;

use std::sync::Arc;

use endpoint::{Endpoint, PATIENCE};
use swarmbench_client::llm::{Allowance, ApiKey, Cassette, Model, Question, Settings, Stop};
use time::{Leaps, TIME_OUT};

/// A key that can be searched for.
pub(crate) const KEY: &str = "sk-test-0123456789abcdefghijklmnop";

/// The variable that it comes from.
pub(crate) const VARIABLE: &str = "SWARM_TEST_KEY";

/// A model at an endpoint, with all that a test may want to change.
pub(crate) struct Bench {
    pub(crate) clock: Arc<Leaps>,
    pub(crate) allowance: Allowance,
    pub(crate) settings: Settings,
}

impl Bench {
    /// Four requests at once, and time leaps.
    pub(crate) fn new(endpoint: &Endpoint) -> Self {
        Self::with(endpoint, Leaps::leaping(), 4, None)
    }

    pub(crate) fn with(
        endpoint: &Endpoint,
        clock: Leaps,
        at_once: usize,
        budget: Option<u64>,
    ) -> Self {
        let clock = Arc::new(clock);
        let allowance = Allowance::new(at_once, budget, clock.clone());
        let mut settings = Settings::new("swarm-1", endpoint.base(), key());
        settings.timeout = TIME_OUT;
        Self { clock, allowance, settings }
    }

    pub(crate) fn model(&self) -> Model {
        self.model_on(None)
    }

    pub(crate) fn model_on(&self, cassette: Option<&Cassette>) -> Model {
        self.try_model_on(cassette).expect("good settings")
    }

    pub(crate) fn try_model(&self) -> Result<Model, Stop> {
        self.try_model_on(None)
    }

    fn try_model_on(&self, cassette: Option<&Cassette>) -> Result<Model, Stop> {
        Model::new(self.settings.clone(), &self.allowance, cassette)
    }
}

/// The key, from its variable.
pub(crate) fn key() -> ApiKey {
    ApiKey::new(VARIABLE, Some(KEY.to_owned()))
}

/// The question of an agent in a round.
pub(crate) fn question(agent: u32, round: u32) -> Question {
    Question {
        system: None,
        game: "Transport/27".to_owned(),
        agent: format!("Agent_{agent}"),
        round,
        prompt: format!("You are Agent_{agent}. Round: {round}. What now?"),
        items: Vec::new(),
        schema: None,
    }
}

/// Why a model says nothing.
pub(crate) async fn stop_of(model: &Model) -> Stop {
    model.answer(&question(0, 0)).await.expect_err("it stops")
}

/// Asks in a task of its own.
pub(crate) fn ask(
    model: &Model,
    question: Question,
) -> tokio::task::JoinHandle<Result<swarmbench_client::llm::ModelAnswer, Stop>> {
    let model = model.clone();
    tokio::spawn(async move {
        tokio::time::timeout(PATIENCE, model.answer(&question)).await.expect("it ends")
    })
}
