//! Requests may write the names of tasks, rule sets and controls in upper or lower case. They are read as they are written
//! everywhere else; other texts stay as they are, for the check that refuses them.

use serde::{Deserialize, Deserializer};
use swarmbench_engine::{Control, RuleSet, TaskName};

/// Reads the name of a task, for `deserialize_with`.
///
/// # Errors
/// As for a text.
pub fn task<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, TaskName::canonical)
}

/// Reads names of tasks, as [`task`].
///
/// # Errors
/// As for a list of texts.
pub fn tasks<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<String>>, D::Error> {
    let names = Option::<Vec<String>>::deserialize(deserializer)?;
    Ok(names.map(|names| names.into_iter().map(TaskName::canonical).collect()))
}

/// Reads the name of a rule set, as [`task`].
///
/// # Errors
/// As for a text.
pub fn rules<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, RuleSet::canonical)
}

/// Reads the name of a control, as [`task`].
///
/// # Errors
/// As for a text.
pub fn control<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, Control::canonical)
}

fn named<'de, D: Deserializer<'de>>(
    deserializer: D,
    canonical: fn(String) -> String,
) -> Result<Option<String>, D::Error> {
    Option::<String>::deserialize(deserializer).map(|name| name.map(canonical))
}
