//! Key of an endpoint, which is never shown.

use reqwest::header::HeaderValue;
use secrecy::{ExposeSecret, SecretString};
use serde_json::Value;

/// Text in place of the key.
pub(super) const PLACEHOLDER: &str = "[key]";

/// Minimum bytes of a key that is removed from answers: a key of this length cannot be there by chance. Local endpoints often
/// have short keys such as `EMPTY`, which a model may well say.
const SECRET_BYTES_MIN: usize = 16;

/// A key with characters that are not allowed in a header.
#[derive(Debug)]
pub(super) struct NoKey;

/// Key, and the variable that it came from. `Debug` does not show the key.
#[derive(Clone, Debug)]
pub struct ApiKey {
    variable: String,
    is_set: bool,
    secret: Option<SecretString>,
}

impl ApiKey {
    /// Key in an environment variable; `value` is `None` if the variable is not set. White space around the key is removed, and
    /// an empty value is no key: most local endpoints need none.
    #[must_use]
    pub fn new(variable: impl Into<String>, value: Option<String>) -> Self {
        let is_set = value.is_some();
        let key = value.map(|value| value.trim().to_owned()).filter(|key| !key.is_empty());
        Self { variable: variable.into(), is_set, secret: key.map(SecretString::from) }
    }

    /// Environment variable of the key.
    #[must_use]
    pub fn variable(&self) -> &str {
        &self.variable
    }

    /// True if the endpoint has a key.
    #[must_use]
    pub const fn is_there(&self) -> bool {
        self.secret.is_some()
    }

    pub(super) fn text(&self) -> Option<&str> {
        self.secret.as_ref().map(ExposeSecret::expose_secret)
    }

    /// Header with the key after `prefix`. A key must be ASCII: endpoints decode and quote other characters in ways that would
    /// keep the key from being recognized and removed.
    pub(super) fn header(&self, prefix: &str) -> Option<Result<HeaderValue, NoKey>> {
        let secret = self.text()?;
        let value = secret.is_ascii().then(|| HeaderValue::try_from(format!("{prefix}{secret}")));
        let Some(Ok(mut header)) = value else { return Some(Err(NoKey)) };
        header.set_sensitive(true);
        Some(Ok(header))
    }

    /// State of the key, as the beginning of a sentence.
    pub(super) fn state(&self) -> String {
        let variable = &self.variable;
        match (&self.secret, self.is_set) {
            (Some(_), _) => format!("it refuses the key in {variable}"),
            (None, true) => format!("no key was sent, as {variable} is empty"),
            (None, false) => format!("no key was sent, as {variable} is not set"),
        }
    }

    /// Text without the key. A short key is removed where it is a word of its own: as a part of others it is there by chance. A
    /// long one is removed in any case of its letters, as the host of an address is in lower case.
    pub(super) fn redacted(&self, text: &str) -> String {
        let Some(secret) = self.text() else { return text.to_owned() };
        let is_long = secret.len() >= SECRET_BYTES_MIN;
        let mut shown = String::new();
        let mut rest = text;
        while let Some(at) = find(rest, secret) {
            let (found, after) = rest[at..].split_at(secret.len());
            shown.push_str(&rest[..at]);
            let is_part =
                shown.ends_with(char::is_alphanumeric) || after.starts_with(char::is_alphanumeric);
            let is_key = is_long || found == secret && !is_part;
            shown.push_str(if is_key { PLACEHOLDER } else { found });
            rest = after;
        }
        shown + rest
    }

    /// Answer without the key, which an endpoint may have shown to the model. Short keys stay.
    pub(super) fn redacted_answer(&self, text: String) -> String {
        match &self.secret {
            Some(secret) if secret.expose_secret().len() >= SECRET_BYTES_MIN => {
                self.redacted(&text)
            }
            _ => text,
        }
    }

    /// True if a text has the key as a part, which only a long one can be by mistake.
    pub(super) fn is_part_of(&self, text: &str) -> bool {
        self.text().is_some_and(|key| key.len() >= SECRET_BYTES_MIN && find(text, key).is_some())
    }

    /// True if a value has the key in one of its texts or names; of a short key, if it is one of them.
    pub(super) fn is_in(&self, value: &Value) -> bool {
        let is_shown = |text: &str| {
            self.text().is_some_and(|key| {
                if key.len() < SECRET_BYTES_MIN { text == key } else { find(text, key).is_some() }
            })
        };
        match value {
            Value::String(text) => is_shown(text),
            Value::Array(list) => list.iter().any(|value| self.is_in(value)),
            Value::Object(fields) => {
                fields.iter().any(|(name, value)| is_shown(name) || self.is_in(value))
            }
            Value::Null | Value::Bool(_) | Value::Number(_) => false,
        }
    }
}

/// Place of a secret in a text, in any case of its letters.
fn find(text: &str, secret: &str) -> Option<usize> {
    let mut windows = text.as_bytes().windows(secret.len());
    windows.position(|bytes| bytes.eq_ignore_ascii_case(secret.as_bytes()))
}
