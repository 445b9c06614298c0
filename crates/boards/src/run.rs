//! Definition of a run: the suite, the player and the conditions.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_engine::{Config, SettingErrors};
use swarmbench_journal::record::RecordedConfig;
use swarmbench_journal::record::{first_prompt_revision, is_first_prompt_revision};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::names::BUILT_IN;
use swarmbench_protocol::suite::{PlannedGame, Suite, digest_of_template};

/// Value of `kind` in an `agent_meta`, and of a row, when people played.
pub const HUMAN: &str = "human";

/// Field of an `agent_meta` with the model's system message: a text, or an object with one for each task.
pub const SYSTEM_MESSAGE: &str = "system_message";

/// True if an `agent_meta` declares that people played.
#[must_use]
pub fn is_human(meta: &Carried) -> bool {
    meta.get("kind").is_some_and(|kind| kind.trim_matches('"') == HUMAN)
}

/// The name of the prompt of a player that reads none.
pub const NO_PROMPT: &str = "none";

/// True if a player reads prompts: built-in players and people read none.
#[must_use]
pub fn reads_prompts(model: &str, player: Option<&str>, meta: &Carried) -> bool {
    player.is_none() && !model.starts_with(BUILT_IN) && !is_human(meta)
}

/// Immutable part of a run; stored as JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Suite that is played.
    pub suite: Suite,
    /// Declared name of the model.
    pub model: String,
    /// Declared sampling temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Declared nucleus sampling parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_p: Option<f64>,
    /// Further declarations.
    #[serde(default, skip_serializing_if = "Carried::is_empty")]
    pub meta: Carried,
    /// Custom prompt template.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// Revision of the program's own words in prompts at the creation; runs before revision 2 name none.
    #[serde(default = "first_prompt_revision", skip_serializing_if = "is_first_prompt_revision")]
    pub prompt_revision: u32,
    /// Built-in player with which the server plays all seats; `default` is each task's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
    /// Maximum games that are open at a time.
    pub parallel: u32,
    /// Readers of the run and its episodes before their end: `public`, `owner` or `sealed`.
    pub visibility: String,
    /// Milliseconds without an act after which an episode ends as abandoned.
    pub idle_timeout_ms: u64,
    /// Time from which no round begins any more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closes_at: Option<Timestamp>,
    /// True if the run's creator may read its ended games while they are sealed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub own_games: bool,
}

impl Definition {
    /// All settings of one of the run's games, as the game's journal records them.
    ///
    /// # Errors
    /// Settings that this program does not allow.
    pub fn recorded(&self, game: &PlannedGame) -> Result<RecordedConfig, SettingErrors> {
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

    /// The `agent_meta` of the run's episodes: the declared sampling and further declarations.
    #[must_use]
    pub fn agent_meta(&self) -> Carried {
        self.meta.with(&[("temperature", self.temperature), ("top_p", self.top_p)])
    }

    /// Identity of the player's prompt. It is independent of the prompt revision if the player reads no prompts.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        let revision = if self.reads_prompts() { self.prompt_revision } else { 1 };
        Identity::of(self.prompt_template.as_deref(), revision, self.meta.get(SYSTEM_MESSAGE))
    }

    /// Name of that prompt, if the player reads prompts.
    #[must_use]
    pub fn prompt_name(&self) -> Option<String> {
        self.reads_prompts().then(|| self.prompt().to_string())
    }

    fn reads_prompts(&self) -> bool {
        reads_prompts(&self.model, self.player.as_deref(), &self.meta)
    }

    /// Digest of the prompt template: the first 12 hexadecimal digits of SHA-256; `None` for the built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        self.prompt_template.as_deref().map(digest_of_template)
    }
}
