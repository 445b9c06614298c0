//! The text of a message (rules: *Messages*).

use std::sync::Arc;

/// The text of a message: one line, not empty, at most 120 characters and `...`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Message(Arc<str>);

impl Message {
    /// Characters (Unicode code points) after which a message is cut.
    pub const CHARS_MAX: usize = 120;

    /// Makes a message of any text: line breaks and control characters become spaces, the ends are trimmed, and a text
    /// of more than [`Self::CHARS_MAX`] characters is cut. `None` if the text is empty then.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let mut line = String::with_capacity(text.len().min(4 * Self::CHARS_MAX));
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            if c == '\r' && chars.peek() == Some(&'\n') {
                continue;
            }
            let breaks = c.is_control() || matches!(c, '\u{2028}' | '\u{2029}');
            line.push(if breaks { ' ' } else { c });
        }
        let trimmed = line.trim();
        match trimmed.char_indices().nth(Self::CHARS_MAX) {
            _ if trimmed.is_empty() => None,
            None => Some(Self(trimmed.into())),
            Some((end, _)) => Some(Self(format!("{}...", &trimmed[..end]).into())),
        }
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The message with each character replaced by another one.
    pub(crate) fn with_chars(&self, replace: impl FnMut(char) -> char) -> Self {
        Self(self.0.chars().map(replace).collect::<String>().into())
    }

    /// Approximate memory of the text, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.0.len() + 2 * size_of::<usize>()
    }
}

impl std::fmt::Display for Message {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}
