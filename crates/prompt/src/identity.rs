//! The identity of a prompt, which tells the prompts of two players apart.

use std::fmt;

use swarmbench_protocol::suite::digest_of_template;

use super::{REVISION, TOOLKIT};

/// Characters of a digest in a [name](Identity).
const SHOWN_CHARS: usize = 8;

/// The prompt of a player. Boards never put two different ones into one row. Its text is its name: `default`,
/// `toolkit`, `custom:0123abcd`; a system message is part of it, as in `toolkit+system:0123abcd`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// The digest of the template; `None` for the built-in one.
    pub template: Option<String>,
    /// The revision of the program's own words; `None` for the first one, and for prompts without such words.
    pub revision: Option<u32>,
    /// The digest of the system message, if there is one.
    pub system: Option<String>,
}

impl Identity {
    /// The identity of a prompt made by this template (`None` for the built-in one) with the words of this revision,
    /// and with the JSON that `agent_meta` declares as its `system_message`: a text, or an object with a text for each
    /// task.
    #[must_use]
    pub fn of(template: Option<&str>, revision: u32, system: Option<&str>) -> Self {
        let is_revised = revision > 1 && template.is_none_or(has_own_words);
        Self {
            template: template.map(digest_of_template),
            revision: is_revised.then_some(revision),
            system: system.map(digest_of_system),
        }
    }

    /// The identity that is declared before any game, with the current words.
    #[must_use]
    pub fn declared(template_digest: Option<String>, system: Option<&str>) -> Self {
        let system = system.map(digest_of_system);
        Self { template: template_digest, revision: Some(REVISION), system }
    }
}

fn digest_of_system(message: &str) -> String {
    let text: Option<String> = serde_json::from_str(message).ok();
    digest_of_template(text.as_deref().unwrap_or(message))
}

/// The template may print the program's own words, which are in `task.description` and in `meaning` of actions.
fn has_own_words(template: &str) -> bool {
    ["description", "meaning", "{{ task }}", "{{ actions }}"]
        .iter()
        .any(|name| template.contains(name))
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let short = |digest: &str| digest.chars().take(SHOWN_CHARS).collect::<String>();
        match (&self.template, self.revision) {
            (None, Some(REVISION)) => f.write_str("default")?,
            (None, revision) => write!(f, "default:{}", revision.unwrap_or(1))?,
            (Some(digest), _) if *digest == digest_of_template(TOOLKIT) => {
                f.write_str("toolkit")?;
            }
            (Some(digest), _) => write!(f, "custom:{}", short(digest))?,
        }
        match &self.system {
            Some(digest) => write!(f, "+system:{}", short(digest)),
            None => Ok(()),
        }
    }
}
