//! What a run is: a suite, who plays it, and how.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_engine::{Config, SettingErrors};
use swarmbench_journal::record::RecordedConfig;
use swarmbench_journal::record::{first_prompt_revision, is_first_prompt_revision};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::suite::{Game, Suite, digest_of_template};

/// The `kind` in an `agent_meta`, and of a row, where people played.
pub const HUMAN: &str = "human";

/// The field of an `agent_meta` with the system message that a model gets: a text, or an object with one for each task.
pub const SYSTEM_MESSAGE: &str = "system_message";

/// Whether an `agent_meta` declares that people played.
#[must_use]
pub fn is_human(meta: &Carried) -> bool {
    meta.get("kind").is_some_and(|kind| kind.trim_matches('"') == HUMAN)
}

/// The unchanging part of a run; stored as JSON.
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
    /// Further declarations.
    #[serde(default, skip_serializing_if = "Carried::is_empty")]
    pub meta: Carried,
    /// A prompt template of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// The revision of the program's own words in prompts when it was created; runs before revision 2 name none.
    #[serde(default = "first_prompt_revision", skip_serializing_if = "is_first_prompt_revision")]
    pub prompt_revision: u32,
    /// The built-in player with which the server plays all seats; `default` is each task's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
    /// How many games are open at a time, at most.
    pub parallel: u32,
    /// Who reads it and its episodes before their end: `public`, `owner` or `sealed`.
    pub visibility: String,
    /// The time without any act after which an episode ends as abandoned.
    pub idle_timeout_ms: u64,
    /// No round begins at or after this time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closes_at: Option<Timestamp>,
    /// Whether whoever created it reads its games once they have ended, also while they are sealed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub own_games: bool,
}

impl Definition {
    /// All settings of one of its games, as the game's journal has them.
    ///
    /// # Errors
    /// Settings that this program does not allow.
    pub fn recorded(&self, game: &Game) -> Result<RecordedConfig, SettingErrors> {
        let settings = &self.suite.settings;
        let config = Config::check(&self.suite.settings_of(game))?;
        Ok(RecordedConfig {
            round_deadline_ms: settings.round_deadline_ms,
            bank_ms: settings.bank_ms,
            idle_timeout_ms: self.idle_timeout_ms,
            visibility: self.visibility.clone(),
            model: self.model.clone(),
            custom_template: self.prompt_template.is_some(),
            closes_at: self.closes_at,
            player: self.player.clone(),
            ..RecordedConfig::of(&config)
        })
    }

    /// The `agent_meta` of its episodes: the declared sampling and further declarations.
    #[must_use]
    pub fn agent_meta(&self) -> Carried {
        self.meta.with(&[("temperature", self.temperature), ("top_p", self.top_p)])
    }

    /// Which prompt its player has: the same for all revisions of the program's words where the player reads no prompts.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        let reads_none = self.player.is_some()
            || self.model.starts_with(swarmbench_protocol::names::BUILT_IN)
            || is_human(&self.meta);
        let revision = if reads_none { 1 } else { self.prompt_revision };
        Identity::of(self.prompt_template.as_deref(), revision, self.meta.get(SYSTEM_MESSAGE))
    }

    /// The digest of the prompt template: the first 12 hexadecimal digits of SHA-256; `None` for the built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        self.prompt_template.as_deref().map(digest_of_template)
    }
}
