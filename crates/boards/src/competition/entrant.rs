//! Entrants of a competition.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;

use super::EntrantStatus;
use crate::run::{EVALUATION, SYSTEM_MESSAGE, reads_prompts};

/// Maximum characters of a contact.
pub const CONTACT_CHARS_MAX: usize = 200;

/// Participant of a competition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entrant {
    /// Public id.
    pub id: String,
    /// Displayed name.
    pub name: String,
    /// Declaration of the player.
    #[serde(flatten)]
    pub declaration: Declaration,
    /// Status of participation.
    pub status: EntrantStatus,
    /// Reason of a status other than `active`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// True if an organizer vouches for the model.
    pub vouched: bool,
    /// Time of registration.
    pub registered_at: Timestamp,
    /// Category, if the competition has categories.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// Version of the terms that was accepted last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terms: Option<u32>,
    /// True if the personal data were erased; not in a published file.
    #[serde(skip)]
    pub erased: bool,
}

impl Entrant {
    /// Approximate bytes in memory, without metadata.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let declared = &self.declaration;
        let texts = [&declared.prompt_template, &declared.template, &self.reason, &self.category]
            .map(|text| text.as_ref().map_or(0, String::len));
        let names = self.id.len() + self.name.len() + declared.model.len();
        size_of::<Self>() + names + texts.into_iter().sum::<usize>()
    }

    /// Entrant without the fields that [`FIRST_FORMAT`](super::export::FIRST_FORMAT) lacks.
    #[must_use]
    pub fn in_first_format(self) -> Self {
        Self { category: None, terms: None, ..self }
    }
}

/// Declaration of an entrant's player. It never changes: another model is another entrant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Declaration {
    /// Name of the model.
    pub model: String,
    /// Sampling temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Nucleus sampling parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_p: Option<f64>,
    /// Further declarations.
    #[serde(default, skip_serializing_if = "Carried::is_empty")]
    pub agent_meta: Carried,
    /// Custom prompt template.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// Digest of the prompt template, if it is known without the text.
    #[serde(skip)]
    pub template: Option<String>,
}

impl Declaration {
    /// Digest of the prompt template; `None` for the built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        let of_text =
            self.prompt_template.as_deref().map(swarmbench_protocol::suite::digest_of_template);
        of_text.or_else(|| self.template.clone())
    }

    /// Name of the prompt in the entrant's games, if its player reads prompts.
    #[must_use]
    pub fn prompt_name(&self) -> Option<String> {
        let system_message = self.agent_meta.get(SYSTEM_MESSAGE);
        let own = || Identity::declared(self.template_digest(), system_message);
        let prompt = || own().with_harness(self.agent_meta.get(EVALUATION)).to_string();
        reads_prompts(&self.model, None, &self.agent_meta).then(prompt)
    }
}
