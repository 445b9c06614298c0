//! Who takes part in a competition.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;

use super::EntrantStatus;

/// Characters of a contact.
pub const CONTACT_CHARS_MAX: usize = 200;

/// Who takes part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entrant {
    /// Its public id.
    pub id: String,
    /// The name that is shown.
    pub name: String,
    /// The declaration of who plays.
    #[serde(flatten)]
    pub declaration: Declaration,
    /// Whether it takes part.
    pub status: EntrantStatus,
    /// Why it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Whether an organizer vouches for the model.
    pub vouched: bool,
    /// When it registered.
    pub registered_at: Timestamp,
    /// Its category, if the competition has some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// The version of the terms that it accepted last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terms: Option<u32>,
    /// Whether its personal data were erased; no part of a published file.
    #[serde(skip)]
    pub erased: bool,
}

impl Entrant {
    /// About how many bytes it takes in memory, without metadata.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let declared = &self.declaration;
        let texts = [&declared.prompt_template, &declared.template, &self.reason, &self.category]
            .map(|text| text.as_ref().map_or(0, String::len));
        let names = self.id.len() + self.name.len() + declared.model.len();
        size_of::<Self>() + names + texts.into_iter().sum::<usize>()
    }

    /// The same for programs that know [`FIRST_FORMAT`](super::export::FIRST_FORMAT) only.
    #[must_use]
    pub fn in_first_format(self) -> Self {
        Self { category: None, terms: None, ..self }
    }
}

/// What an entrant declared of who plays. It never changes: another model is another entrant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Declaration {
    /// The model's name.
    pub model: String,
    /// The sampling temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// The nucleus of sampling.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top_p: Option<f64>,
    /// Further declarations.
    #[serde(default, skip_serializing_if = "Carried::is_empty")]
    pub agent_meta: Carried,
    /// A prompt template of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_template: Option<String>,
    /// The digest of the prompt template, if it is known without the text.
    #[serde(skip)]
    pub template: Option<String>,
}

impl Declaration {
    /// The digest of the prompt template; `None` for the built-in one.
    #[must_use]
    pub fn template_digest(&self) -> Option<String> {
        let of_text =
            self.prompt_template.as_deref().map(swarmbench_protocol::suite::digest_of_template);
        of_text.or_else(|| self.template.clone())
    }

    /// Which prompt its games have.
    #[must_use]
    pub fn prompt(&self) -> Identity {
        Identity::declared(self.template_digest(), self.agent_meta.get("system_message"))
    }
}
