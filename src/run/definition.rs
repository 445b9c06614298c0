//! What a run is: a suite, who plays it, and how.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::suite::Suite;

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
    /// What else was told of who plays.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub meta: Map<String, Value>,
    /// A prompt template of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// The built-in player that the server hosts on all seats, where nobody else plays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
    /// How many games are open at a time, at most.
    pub parallel: u32,
    /// Who reads its episodes before their end: `public`, `owner` or `sealed`.
    pub visibility: String,
    /// After so long without any act an episode ends as abandoned.
    pub idle_timeout_ms: u64,
    /// From then on no new round begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closes_at: Option<Timestamp>,
}

impl Definition {
    /// Tells prompt templates apart: the first 12 hexadecimal digits of SHA-256 of the text; none for the
    /// built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        let text = self.prompt_template.as_ref()?;
        Some(data_encoding::HEXLOWER.encode(&Sha256::digest(text)[..6]))
    }
}
