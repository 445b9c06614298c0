//! Further headers of requests, whose secrets come from environment variables.

use std::collections::BTreeMap;

use reqwest::header::{HeaderMap, HeaderName, HeaderValue};

use super::key::ApiKey;

/// Maximum headers of one model.
const HEADERS_MAX: usize = 32;

/// Headers that HTTP sets for each request.
const OWN: [&str; 6] =
    ["connection", "content-length", "content-type", "host", "te", "transfer-encoding"];

/// Parts of names of headers that must hold a secret.
const SECRET: [&str; 6] = ["auth", "cookie", "key", "password", "secret", "token"];

/// Further headers of each request. `Debug` shows none of their secrets.
#[derive(Clone, Debug, Default)]
pub struct Headers {
    values: HeaderMap,
    /// Environment variables in the values.
    secrets: Vec<ApiKey>,
}

impl Headers {
    /// Parses headers by their names. In a value, `$NAME` and `${NAME}` stand for an environment variable, which is a
    /// secret, and `$$` for a dollar sign. `lookup` reads a variable.
    ///
    /// # Errors
    /// Fault of a header, and how to fix it.
    pub fn parse(
        texts: &BTreeMap<String, String>,
        lookup: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, String> {
        if texts.len() > HEADERS_MAX {
            return Err(format!("{} headers; a request has at most {HEADERS_MAX}", texts.len()));
        }
        let mut headers = Self::default();
        for (name, text) in texts {
            let parsed = HeaderName::try_from(name.trim())
                .map_err(|_| format!("{name:?} is no name of a header, such as api-key"))?;
            if OWN.contains(&parsed.as_str()) {
                return Err(format!("the header {parsed} follows from the request: leave it out"));
            }
            let before = headers.secrets.len();
            let value = headers.filled_in(&parsed, text.trim(), &lookup)?;
            let is_secret = headers.secrets.len() > before;
            let sounds_secret = SECRET.iter().any(|part| parsed.as_str().contains(part));
            if sounds_secret && !is_secret {
                return Err(format!(
                    "the header {parsed} has its value in plain text, where others can read it: put the value into an \
                     environment variable, such as MY_KEY, and say '{parsed}: $MY_KEY'"
                ));
            }
            let value = value.is_ascii().then(|| HeaderValue::try_from(value).ok()).flatten();
            let mut value = value.ok_or_else(|| {
                format!(
                    "the value of the header {parsed} has characters that no header has: a line break, perhaps, or a \
                     letter that is not ASCII"
                )
            })?;
            value.set_sensitive(is_secret);
            if headers.values.insert(parsed.clone(), value).is_some() {
                return Err(format!("the header {parsed} is given twice"));
            }
        }
        Ok(headers)
    }

    /// Replaces the variables in a value.
    fn filled_in(
        &mut self,
        header: &HeaderName,
        text: &str,
        lookup: &impl Fn(&str) -> Option<String>,
    ) -> Result<String, String> {
        let mut value = String::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('$') {
            value.push_str(before);
            if let Some(after) = after.strip_prefix('$') {
                value.push('$');
                rest = after;
                continue;
            }
            let is_of_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let (variable, after) = match after.strip_prefix('{') {
                Some(braced) => braced.split_once('}').unwrap_or(("", after)),
                None => after.split_at(after.find(|c| !is_of_name(c)).unwrap_or(after.len())),
            };
            if variable.is_empty() || !variable.chars().all(is_of_name) {
                return Err(format!(
                    "in the header {header}, no variable follows after $: write $NAME or ${{NAME}}, or $$ for a dollar sign"
                ));
            }
            let secret = ApiKey::new(variable, lookup(variable));
            match secret.text() {
                Some(text) => value.push_str(text),
                None => {
                    return Err(format!(
                        "the header {header} needs the environment variable {variable}, which is empty or not set: \
                         `export {variable}=…`"
                    ));
                }
            }
            self.secrets.push(secret);
            rest = after;
        }
        value.push_str(rest);
        Ok(value)
    }

    /// True if any header holds a secret.
    #[must_use]
    pub fn has_secret(&self) -> bool {
        !self.secrets.is_empty()
    }

    pub(super) fn values(&self) -> &HeaderMap {
        &self.values
    }

    pub(super) fn secrets(&self) -> &[ApiKey] {
        &self.secrets
    }
}
