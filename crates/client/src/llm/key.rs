//! Key of an endpoint, which is never shown.

use reqwest::header::HeaderValue;
use secrecy::{ExposeSecret, SecretString};

/// Text in place of the key.
const PLACEHOLDER: &str = "[key]";

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

    /// Text without the key.
    pub(super) fn redacted(&self, text: &str) -> String {
        match &self.secret {
            Some(secret) => text.replace(secret.expose_secret(), PLACEHOLDER),
            None => text.to_owned(),
        }
    }

    /// Answer without the key, which an endpoint may have shown to the model. Short keys stay.
    pub(super) fn redacted_answer(&self, text: String) -> String {
        match &self.secret {
            Some(secret)
                if secret.expose_secret().len() >= SECRET_BYTES_MIN
                    && text.contains(secret.expose_secret()) =>
            {
                self.redacted(&text)
            }
            _ => text,
        }
    }

    pub(super) fn is_in(&self, text: &str) -> bool {
        self.secret.as_ref().is_some_and(|secret| text.contains(secret.expose_secret()))
    }
}
