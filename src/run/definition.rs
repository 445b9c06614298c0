//! What a run is: a suite, who plays it, and how.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use swarmbench_engine::Config;

use super::RunError;
use super::suite::{Game, Suite};
use crate::episode::spec::{Spec, Visibility};
use crate::hosted;
use crate::prompt;
use crate::store::runs::StoredRun;

/// All that was decided about a run when it was created; stored as JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// What is played.
    pub suite: Suite,
    /// The model's name, as declared.
    pub model: String,
    /// The sampling temperature, as declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// The nucleus of sampling, as declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_p: Option<f64>,
    /// Further declarations about the player.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub meta: Map<String, Value>,
    /// A prompt template of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// The built-in player that the server hosts on all seats, if the server plays;
    /// `default` for the one that each task has of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
    /// How many games are open at a time, at most.
    pub parallel: u32,
    /// Who reads it and its episodes before their end: `public`, `owner` or `sealed`.
    pub visibility: String,
    /// After so long without any act an episode ends as abandoned.
    pub idle_timeout_ms: u64,
    /// From then on no new round begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closes_at: Option<Timestamp>,
}

impl Definition {
    /// What was stored of a run.
    ///
    /// # Errors
    /// Where this program cannot read it.
    pub fn of(stored: &StoredRun) -> Result<Self, RunError> {
        serde_json::from_str(&stored.definition).map_err(|error| RunError::Definition {
            run: stored.id.clone(),
            problem: error.to_string(),
        })
    }

    /// Who reads it, if this program knows the name.
    #[must_use]
    pub fn visibility(&self) -> Option<Visibility> {
        Visibility::ALL.into_iter().find(|known| known.name() == self.visibility)
    }

    /// What one of its games is.
    ///
    /// # Errors
    /// What this program does not know or does not allow.
    pub fn spec(&self, run: &str, game: &Game, salt: Option<String>) -> Result<Spec, String> {
        let suite = &self.suite;
        let config = Config::check(&suite.settings_of(game)).map_err(|error| error.to_string())?;
        let visibility = self.visibility();
        Ok(Spec {
            round_deadline: suite.settings.round_deadline_ms.map(Duration::from_millis),
            bank: Duration::from_millis(suite.settings.bank_ms),
            manual_start: false,
            idle_timeout: Duration::from_millis(self.idle_timeout_ms),
            visibility: visibility.ok_or_else(|| format!("visibility {:?}", self.visibility))?,
            model: self.model.clone(),
            agent_meta: self.agent_meta(),
            prompt_template: self.prompt_template.as_deref().unwrap_or(prompt::BUILT_IN).into(),
            custom_template: self.prompt_template.is_some(),
            run: Some(run.to_owned()),
            salt,
            closes_at: self.closes_at,
            open_seats: Vec::new(),
            fill_after: None,
            fill_with: None,
            player: self
                .player
                .as_deref()
                .map(|name| hosted::player(name, config.task()))
                .transpose()?,
            config: Arc::new(config),
        })
    }

    /// The `agent_meta` of its episodes: the declared sampling and further declarations.
    fn agent_meta(&self) -> Map<String, Value> {
        let mut meta = self.meta.clone();
        for (name, value) in [("temperature", self.temperature), ("top_p", self.top_p)] {
            if let Some(value) = value {
                meta.insert(name.to_owned(), json!(value));
            }
        }
        meta
    }

    /// Tells prompt templates apart: the first 12 hexadecimal digits of SHA-256 of the text; none for the
    /// built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        self.prompt_template.as_deref().map(digest_of_template)
    }
}

/// The first 12 hexadecimal digits of SHA-256 of the text of a prompt template.
#[must_use]
pub fn digest_of_template(text: &str) -> String {
    data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6])
}
