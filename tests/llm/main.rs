//! Language models: asked at a real HTTP server that misbehaves in every way that endpoints do, and played from
//! cassettes.

mod answers;
mod endpoint;
mod time;

use std::path::Path;
use std::sync::Arc;

use endpoint::Endpoint;
use swarmbench::llm::{Allowance, ApiKey, Cassette, Model, Question, Settings, Stop};
use time::Leaps;

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
    pub(crate) fn new(endpoint: &Endpoint) -> Self {
        Self::with(endpoint, 4, None)
    }

    pub(crate) fn with(endpoint: &Endpoint, at_once: usize, budget: Option<u64>) -> Self {
        let clock = Arc::new(Leaps::default());
        let allowance = Allowance::new(at_once, budget, clock.clone());
        let key = ApiKey::new(VARIABLE, Some(KEY.to_owned()));
        Self { clock, allowance, settings: Settings::new("swarm-1", endpoint.base(), key) }
    }

    pub(crate) fn model(&self) -> Model {
        self.model_on(None)
    }

    pub(crate) fn model_on(&self, cassette: Option<&Cassette>) -> Model {
        Model::new(self.settings.clone(), &self.allowance, cassette).expect("good settings")
    }
}

/// The question of an agent in a round.
pub(crate) fn question(agent: u32, round: u32) -> Question {
    Question {
        game: "Transport/27".to_owned(),
        agent: format!("Agent_{agent}"),
        round,
        prompt: format!("You are Agent_{agent}. Round: {round}. What now?"),
    }
}

/// A cassette that is written.
pub(crate) fn record(path: &Path) -> Cassette {
    Cassette::record(path).expect("a cassette")
}

/// Why a model says nothing.
pub(crate) async fn stop_of(model: &Model) -> Stop {
    model.answer(&question(0, 0)).await.expect_err("it stops")
}
