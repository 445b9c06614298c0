//! Games that were read from files.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::game_settings;
use crate::time::Timestamp;

/// Imported game. It is not verified: everything in it comes from its files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ImportSummary {
    /// Id of the game.
    #[cfg_attr(feature = "openapi", schema(example = "imp_5f0c1e6a7d9b48f2a3c4d5e6f7081920"))]
    pub id: String,
    /// Name of the game in its files.
    pub run_id: String,
    /// Always false: this server neither received the acts nor computed the states.
    pub verified: bool,
    /// Name of the task.
    pub task: String,
    /// Name of the model that played, as the files say.
    pub model: String,
    /// Seed of the game.
    pub seed: u64,
    /// Last score.
    pub score: f64,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Number of acts; 0 if the file with them was missing or broken.
    pub acts: u64,
    /// Settings that the files contain.
    pub settings: ImportConfig,
    /// Time of the import.
    pub imported_at: Timestamp,
}

/// Settings of an imported game. The toolkit's files contain only the first five.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[expect(missing_docs, reason = "the same as of an episode")]
pub struct ImportConfig {
    pub num_agents: u32,
    pub max_round: u32,
    pub width: u32,
    pub height: u32,
    pub view_size: u32,
    pub rules: Option<String>,
    pub control: Option<String>,
    pub memory: Option<i64>,
    pub noise: Option<f64>,
    pub max_delay: Option<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub answer_reader: Option<String>,
}

game_settings! {
    partial
    /// Known settings of games.
    #[serde_with::skip_serializing_none]
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    pub struct KnownSettings {
        /// Rule set: `paper` or `reference`.
        pub rules: Option<String>,
        /// `decentralized` or `centralized`.
        pub control: Option<String>,
        ..settings,
    }
}

impl KnownSettings {
    /// Whether all settings that both know are equal.
    #[must_use]
    pub fn agrees(&self, other: &Self) -> bool {
        let (one, other) = (self.by_name(), other.by_name());
        one.iter().all(|(name, value)| other.get(name).is_none_or(|other| other == value))
    }

    fn by_name(&self) -> Map<String, Value> {
        let Value::Object(known) = json!(self) else { unreachable!("a struct is an object") };
        known
    }
}

impl From<&ImportConfig> for KnownSettings {
    fn from(settings: &ImportConfig) -> Self {
        serde_json::from_value(json!(settings)).expect("the same names, and smaller numbers")
    }
}

page! {
    /// Page of imported games, newest first.
    ImportList of ImportSummary
}
