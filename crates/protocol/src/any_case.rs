//! Names of tasks, rule sets and controls in requests, which may be in upper or lower case. Known names are read in their
//! canonical form; other texts are kept for the check that refuses them.

use serde::{Deserialize, Deserializer};
use swarmbench_engine::{Control, RuleSet, TaskName};

/// Reads the name of a task, for `deserialize_with`.
///
/// # Errors
/// Same errors as for a string.
pub fn task<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, TaskName::canonical)
}

/// Reads names of tasks, as [`task`].
///
/// # Errors
/// Same errors as for a list of strings.
pub fn tasks<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<String>>, D::Error> {
    let names = Option::<Vec<String>>::deserialize(deserializer)?;
    Ok(names.map(|names| names.into_iter().map(TaskName::canonical).collect()))
}

/// Reads the name of a rule set, as [`task`].
///
/// # Errors
/// Same errors as for a string.
pub fn rules<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, RuleSet::canonical)
}

/// Reads the name of a control, as [`task`].
///
/// # Errors
/// Same errors as for a string.
pub fn control<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    named(deserializer, Control::canonical)
}

fn named<'de, D: Deserializer<'de>>(
    deserializer: D,
    canonical: fn(String) -> String,
) -> Result<Option<String>, D::Error> {
    Option::<String>::deserialize(deserializer).map(|name| name.map(canonical))
}
