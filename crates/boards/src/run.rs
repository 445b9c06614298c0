//! Definition of a run: the suite, the player and the conditions.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use swarmbench_engine::{Config, SettingErrors};
use swarmbench_journal::record::{RecordedConfig, TeamHolder};
use swarmbench_journal::record::{first_prompt_revision, is_first_prompt_revision};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::names::BUILT_IN;
use swarmbench_protocol::run::RunHolder;
use swarmbench_protocol::suite::{PlannedGame, Suite, digest_of_template};

/// Value of `kind` in an `agent_meta`, and of a row, when people played.
pub const HUMAN: &str = "human";

/// Value of `kind` of a row whose seats belong to the holders of a team.
pub const TEAM: &str = "team";

/// Field of an `agent_meta` with the model's system message: a text, or an object with one for each task.
pub const SYSTEM_MESSAGE: &str = "system_message";

/// Field of an `agent_meta` with what an evaluation asked of the model.
pub const EVALUATION: &str = "eval";

/// Fields of an evaluation, and of its further fields of requests (`extra`), that say how answers are sampled: the limits, the
/// reasoning, and the parameters that endpoints have beside temperature and `top_p`.
const SAMPLING: &str = "effort thinking_budget reasoning_summary max_tokens max_completion_tokens max_output_tokens \
     temperature top_p top_k top_a min_p typical_p tfs_z mirostat seed frequency_penalty presence_penalty \
     repetition_penalty logit_bias best_of num_predict reasoning_effort reasoning thinking enable_thinking \
     chat_template_kwargs output_config verbosity options";

/// Maximum bytes of a sampling that is shown. A longer one ends in a digest, so that different ones differ.
const SAMPLING_BYTES_MAX: usize = 160;

/// Sampling beside temperature and `top_p` that an evaluation declares, such as `effort low, top_k 20`; `None` if there is none.
#[must_use]
pub fn sampling(eval: &Map<String, Value>) -> Option<String> {
    let extra = eval.get("extra").and_then(Value::as_object);
    let fields = [Some(eval), extra].into_iter().flatten();
    let parts: Vec<String> = fields
        .flat_map(|fields| {
            SAMPLING.split_whitespace().filter_map(move |name| Some((name, fields.get(name)?)))
        })
        .map(|(name, value)| {
            format!("{name} {}", value.as_str().map_or_else(|| value.to_string(), str::to_owned))
        })
        .collect();
    let text = parts.join(", ");
    if text.len() <= SAMPLING_BYTES_MAX {
        return Some(text).filter(|text| !text.is_empty());
    }
    let digest = data_encoding::HEXLOWER.encode(&Sha256::digest(&text)[..4]);
    Some(format!("{}… {digest}", &text[..text.floor_char_boundary(SAMPLING_BYTES_MAX)]))
}

/// [`sampling`] of the evaluation in an `agent_meta`.
fn declared_sampling(meta: &Carried) -> Option<String> {
    sampling(&serde_json::from_str(meta.get(EVALUATION)?).ok()?)
}

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
    /// Holders of a team as they were declared, each with its own seats in every game; empty if one player has all seats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holders: Vec<RunHolder>,
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

fn recorded(holder: &RunHolder) -> TeamHolder {
    let RunHolder { name, model, seats, player, .. } = holder.clone();
    TeamHolder { name, model, seats, player }
}

fn holder_reads_prompts(holder: &RunHolder) -> bool {
    reads_prompts(&holder.model, holder.player.as_deref(), &holder.agent_meta)
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
            visibility: self.visibility_of_games().to_owned(),
            model: self.model.clone(),
            custom_template: self.prompt_template.is_some(),
            closes_at: self.closes_at,
            player: self.player.clone(),
            holders: self.recorded_holders(),
            ..RecordedConfig::of(&config)
        })
    }

    /// Holders of the team, as the journals of the games record them.
    #[must_use]
    pub fn recorded_holders(&self) -> Vec<TeamHolder> {
        self.holders.iter().map(recorded).collect()
    }

    /// Readers of the games before their end. In a public game each holder of a team could read what the others see.
    #[must_use]
    pub fn visibility_of_games(&self) -> &str {
        match (self.holders.as_slice(), self.visibility.as_str()) {
            ([_, ..], "public") => "owner",
            (_, visibility) => visibility,
        }
    }

    /// True if the seats belong to several holders.
    #[must_use]
    pub fn is_team(&self) -> bool {
        !self.holders.is_empty()
    }

    /// Holders of the team as they are shown, with what follows from their declarations.
    #[must_use]
    pub fn shown_holders(&self) -> Vec<RunHolder> {
        let shown = |holder: &RunHolder| {
            let meta = &holder.agent_meta;
            let template = self.prompt_template.as_deref();
            let own = Identity::of(template, self.prompt_revision, meta.get(SYSTEM_MESSAGE));
            let prompt = || own.with_harness(meta.get(EVALUATION)).to_string();
            let prompt = holder_reads_prompts(holder).then(prompt);
            RunHolder { sampling: declared_sampling(meta), prompt, ..holder.clone() }
        };
        self.holders.iter().map(shown).collect()
    }

    /// True if the server plays all seats, so that no client has a token.
    #[must_use]
    pub fn is_all_hosted(&self) -> bool {
        match self.holders.as_slice() {
            [] => self.player.is_some(),
            holders => holders.iter().all(|holder| holder.player.is_some()),
        }
    }

    /// The `agent_meta` of the run's episodes: the declared sampling and further declarations.
    #[must_use]
    pub fn agent_meta(&self) -> Carried {
        self.meta.with(&[("temperature", self.temperature), ("top_p", self.top_p)])
    }

    /// Sampling beside temperature and `top_p`, if an evaluation declares it.
    #[must_use]
    pub fn further_sampling(&self) -> Option<String> {
        declared_sampling(&self.meta)
    }

    /// Identity of the player's prompt. It is independent of the prompt revision if the player reads no prompts.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        let revision = if self.reads_prompts() { self.prompt_revision } else { 1 };
        let template = self.prompt_template.as_deref();
        let own = Identity::of(template, revision, self.meta.get(SYSTEM_MESSAGE));
        own.with_harness(self.meta.get(EVALUATION))
    }

    /// Name of that prompt, if the player reads prompts.
    #[must_use]
    pub fn prompt_name(&self) -> Option<String> {
        self.reads_prompts().then(|| self.prompt().to_string())
    }

    fn reads_prompts(&self) -> bool {
        match self.holders.as_slice() {
            [] => reads_prompts(&self.model, self.player.as_deref(), &self.meta),
            holders => holders.iter().any(holder_reads_prompts),
        }
    }

    /// Digest of the prompt template: the first 12 hexadecimal digits of SHA-256; `None` for the built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        self.prompt_template.as_deref().map(digest_of_template)
    }
}
