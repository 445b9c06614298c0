//! The identity of a prompt, which tells the prompts of two players apart.

use std::fmt;

use swarmbench_protocol::suite::digest_of_template;

use super::{NAMED, REVISION};

/// Characters of a digest in a [name](Identity).
const SHOWN_CHARS: usize = 8;

/// Maximum bytes of the name of a harness.
const HARNESS_BYTES_MAX: usize = 100;

/// The prompt of a player. Boards never put two different ones into one row. Its text is its name: `default`,
/// `toolkit`, `static-first`, `custom:0123abcd`; a system message is part of it, as in `toolkit+system:0123abcd`, and
/// so is a harness, as in `default+harness:history=2`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// The digest of the template; `None` for the built-in one.
    pub template: Option<String>,
    /// The revision of the program's own words; `None` for the first one, and for prompts without such words.
    pub revision: Option<u32>,
    /// The digest of the system message, if there is one.
    pub system: Option<String>,
    /// The harness that an evaluation declares, such as `history=2,scratchpad=500`.
    pub harness: Option<String>,
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
            harness: None,
        }
    }

    /// The identity with the harness that `agent_meta` declares: `eval` is its field of that name, in which `harness` is an object.
    #[must_use]
    pub fn with_harness(self, eval: Option<&str>) -> Self {
        #[derive(serde::Deserialize)]
        struct Eval {
            #[serde(default)]
            harness: Option<serde_json::Map<String, serde_json::Value>>,
        }
        let eval = eval.and_then(|eval| serde_json::from_str::<Eval>(eval).ok());
        let harness = eval.and_then(|eval| eval.harness).filter(|harness| !harness.is_empty());
        Self { harness: harness.as_ref().map(name_of_harness), ..self }
    }

    /// The identity that is declared before any game, with the current words.
    #[must_use]
    pub fn declared(template_digest: Option<String>, system: Option<&str>) -> Self {
        let system = system.map(digest_of_system);
        Self { template: template_digest, revision: Some(REVISION), system, harness: None }
    }
}

/// The name of a harness: its fields, or a digest where they are long or could be taken for another part.
fn name_of_harness(harness: &serde_json::Map<String, serde_json::Value>) -> String {
    let part = |(name, value): (&String, &serde_json::Value)| match value.as_str() {
        Some(text) => format!("{name}={text}"),
        None => format!("{name}={value}"),
    };
    let name = harness.iter().map(part).collect::<Vec<_>>().join(",");
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_=,.-".contains(c);
    if name.len() <= HARNESS_BYTES_MAX && name.chars().all(is_plain) {
        return name;
    }
    digest_of_template(&serde_json::json!(harness).to_string()).chars().take(SHOWN_CHARS).collect()
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
            (Some(digest), _) => {
                let mut named = NAMED.iter();
                match named.find(|(_, text)| *digest == digest_of_template(text)) {
                    Some((name, _)) => f.write_str(name)?,
                    None => write!(f, "custom:{}", short(digest))?,
                }
            }
        }
        if let Some(digest) = &self.system {
            write!(f, "+system:{}", short(digest))?;
        }
        self.harness.as_ref().map_or(Ok(()), |harness| write!(f, "+harness:{harness}"))
    }
}
