//! Times on the wire.

use std::borrow::Cow;
use std::fmt;
use std::ops::Deref;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Time in RFC 3339 in UTC, always with three digits of milliseconds, so that all times of a column have one form. Any time of
/// RFC 3339 is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(jiff::Timestamp);

impl From<jiff::Timestamp> for Timestamp {
    fn from(at: jiff::Timestamp) -> Self {
        Self(at)
    }
}

impl From<Timestamp> for jiff::Timestamp {
    fn from(at: Timestamp) -> Self {
        at.0
    }
}

impl Deref for Timestamp {
    type Target = jiff::Timestamp;

    fn deref(&self) -> &jiff::Timestamp {
        &self.0
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3}", self.0)
    }
}

impl<'de> Deserialize<'de> for Timestamp {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = Cow::<'de, str>::deserialize(deserializer)?;
        text.parse().map(Self).map_err(|_| {
            let shown: String = text.chars().take(SHOWN_CHARS_MAX).collect();
            D::Error::custom(format!("must be a time such as 2027-03-01T12:00:00Z, is {shown:?}"))
        })
    }
}

/// Characters of a refused text that an error shows.
const SHOWN_CHARS_MAX: usize = 40;

impl Serialize for Timestamp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_always_have_milliseconds() {
        for (text, shown) in [
            ("2026-01-02T03:04:05Z", "2026-01-02T03:04:05.000Z"),
            ("2026-01-02T03:04:05.12Z", "2026-01-02T03:04:05.120Z"),
            ("2026-01-02T05:04:05.1239+02:00", "2026-01-02T03:04:05.123Z"),
        ] {
            let read: Timestamp = serde_json::from_value(text.into()).expect("a time");
            assert_eq!(serde_json::to_value(read).expect("text"), shown);
        }
    }
}
