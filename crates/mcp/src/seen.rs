//! Observations, as the tools show them.

use serde::Deserialize;
use serde_json::Value;
use swarmbench_protocol::status::Status;

use crate::{MCP_STRUCTURED_BYTES_MAX, Refusal};

/// The unparsed observation, and the fields that the tools read.
pub(crate) struct Seen {
    body: Vec<u8>,
    pub(crate) facts: Facts,
}

/// The fields of an observation on which the tools' texts depend.
#[derive(Debug, Deserialize)]
pub(crate) struct Facts {
    pub(crate) agent: String,
    pub(crate) status: Status,
    pub(crate) round: u32,
    pub(crate) max_round: u32,
    pub(crate) score: f64,
    pub(crate) alive: bool,
    pub(crate) acted: bool,
    pub(crate) remaining_ms: Option<u64>,
    pub(crate) prompt: Option<String>,
}

impl Seen {
    pub(crate) fn read(body: Vec<u8>) -> Result<Self, Refusal> {
        let facts = serde_json::from_slice(&body).map_err(|error| {
            Refusal::NoAnswer(format!(
                "the server answered with something else than an observation: {error}"
            ))
        })?;
        Ok(Self { body, facts })
    }

    /// The unparsed observation.
    pub(crate) fn text(&self) -> &str {
        // The body was read as JSON, which is UTF-8.
        std::str::from_utf8(&self.body).unwrap_or_default()
    }

    /// The whole observation as JSON; `None` if it is larger than [`MCP_STRUCTURED_BYTES_MAX`].
    pub(crate) fn json(&self) -> Option<Value> {
        if self.body.len() > MCP_STRUCTURED_BYTES_MAX {
            return None;
        }
        serde_json::from_slice(&self.body).ok()
    }
}

impl Facts {
    /// True if the episode waits for this seat.
    pub(crate) const fn is_due(&self) -> bool {
        matches!(self.status, Status::Running) && self.alive && !self.acted
    }
}
