//! Reasons for which answers of language models did not count, and counts of each.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use swarmbench_engine::answer::Fault;

swarmbench_engine::named! {
    /// Reason for which an answer of a language model did not count, so that its agent did nothing.
    ///
    /// The first six are known to the client that asked the model, and it may send them with the answer. The last three are
    /// read from the answer's text, by the rules.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[serde(rename_all = "snake_case")]
    pub enum Failure {
        /// The model refused to answer.
        Refusal = "refusal",
        /// A filter of the endpoint removed the question or the answer, or a part of it.
        ContentFilter = "content_filter",
        /// The answer was cut where its tokens were used up, before it named an action.
        Truncated = "truncated",
        /// The model called a tool instead of answering.
        ToolCall = "tool_call",
        /// The model reasoned and then gave no answer.
        ReasoningOnly = "reasoning_only",
        /// The endpoint rejected this one question, such as one that is longer than the model's context.
        Rejected = "rejected",
        /// The answer has no text.
        Empty = "empty",
        /// The text has no `ACTION:` and no `MSG:` with a message.
        NoMarker = "no_marker",
        /// The text has an `ACTION:`, and what follows is no action of the task.
        UnknownAction = "unknown_action",
    }
}

impl Failure {
    /// Reason for an invalid text with this fault: the one that the client gave, or else the one that the text shows.
    #[must_use]
    pub fn of(said: Option<Self>, fault: Fault) -> Self {
        said.filter(|said| said.is_of_client()).unwrap_or(match fault {
            Fault::Empty => Self::Empty,
            Fault::NoMarker => Self::NoMarker,
            Fault::UnknownAction => Self::UnknownAction,
        })
    }

    /// Whether only the client that asked the model can know the reason; the others follow from the text.
    #[must_use]
    pub const fn is_of_client(self) -> bool {
        !matches!(self, Self::Empty | Self::NoMarker | Self::UnknownAction)
    }

    /// Words for people that follow a count, as in `3 cut at the token limit`.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Refusal => "refused",
            Self::ContentFilter => "filtered",
            Self::Truncated => "cut at the token limit",
            Self::ToolCall => "tool calls",
            Self::ReasoningOnly => "reasoning only",
            Self::Rejected => "rejected by the endpoint",
            Self::Empty => "empty",
            Self::NoMarker => "without ACTION: or MSG:",
            Self::UnknownAction => "with an unknown action",
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Counts of answers that did not count, by reason. In JSON an object with the reasons that occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Failures([u64; Failure::ALL.len()]);

impl Failures {
    /// No failures.
    pub const EMPTY: Self = Self([0; Failure::ALL.len()]);

    /// Counts one more failure.
    pub fn count(&mut self, failure: Failure) {
        self.0[failure as usize] = self.0[failure as usize].saturating_add(1);
    }

    /// Adds the counts of others.
    pub fn add(&mut self, others: Self) {
        for (sum, more) in self.0.iter_mut().zip(others.0) {
            *sum = sum.saturating_add(more);
        }
    }

    /// Count of one reason.
    #[must_use]
    pub const fn of(&self, failure: Failure) -> u64 {
        self.0[failure as usize]
    }

    /// Whether there are no failures.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Sum of all counts.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.iter().fold(0, |sum, &more| sum.saturating_add(more))
    }

    /// Reasons that occurred and their counts, most frequent first.
    #[must_use]
    pub fn most_frequent(&self) -> Vec<(Failure, u64)> {
        let mut kinds: Vec<_> = self.iter().filter(|&(_, count)| count > 0).collect();
        kinds.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        kinds
    }

    /// Counts of all reasons, in the order of [`Failure::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (Failure, u64)> + '_ {
        Failure::ALL.into_iter().zip(self.0)
    }

    /// Text for people, most frequent first, as in `3 refused, 1 empty`; empty without failures.
    #[must_use]
    pub fn words(&self) -> String {
        let kinds = self.most_frequent().into_iter();
        kinds
            .map(|(kind, count)| format!("{count} {}", kind.words()))
            .collect::<Vec<_>>()
            .join(", ")
    }

    /// Names of columns with one count for each reason: `failed_refusal` and so on.
    pub fn columns() -> impl Iterator<Item = String> {
        Failure::ALL.into_iter().map(|kind| format!("failed_{kind}"))
    }

    /// Counts as texts, in the order of [`Failures::columns`].
    pub fn cells(&self) -> impl Iterator<Item = String> + '_ {
        self.0.iter().map(u64::to_string)
    }
}

impl Serialize for Failures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter().filter(|&(_, count)| count > 0))
    }
}

impl<'de> Deserialize<'de> for Failures {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut failures = Self::default();
        for (name, count) in BTreeMap::<String, u64>::deserialize(deserializer)? {
            let kind = Failure::parse(&name)
                .ok_or_else(|| D::Error::custom(format!("there is no failure {name:?}")))?;
            failures.0[kind as usize] = count;
        }
        Ok(failures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_written_by_kind_and_read_again() {
        let mut failures = Failures::default();
        assert_eq!(serde_json::to_string(&failures).expect("JSON"), "{}");
        for kind in [Failure::Empty, Failure::Refusal, Failure::Empty] {
            failures.count(kind);
        }
        let written = serde_json::to_string(&failures).expect("JSON");
        assert_eq!(written, r#"{"refusal":1,"empty":2}"#);
        assert_eq!(serde_json::from_str::<Failures>(&written).expect("read"), failures);
        assert_eq!((failures.total(), failures.words().as_str()), (3, "2 empty, 1 refused"));
        let error = serde_json::from_str::<Failures>(r#"{"boredom":1}"#).expect_err("unknown");
        assert!(error.to_string().contains("boredom"), "{error}");
        for kind in Failure::ALL {
            assert_eq!(serde_json::to_value(kind).expect("JSON"), kind.name());
        }
    }

    #[test]
    fn a_client_says_only_what_the_text_does_not_show() {
        let of = Failure::of;
        assert_eq!(of(None, Fault::NoMarker), Failure::NoMarker);
        assert_eq!(of(Some(Failure::Refusal), Fault::NoMarker), Failure::Refusal);
        assert_eq!(of(Some(Failure::Truncated), Fault::Empty), Failure::Truncated);
        assert_eq!(of(Some(Failure::Empty), Fault::UnknownAction), Failure::UnknownAction);
    }
}
