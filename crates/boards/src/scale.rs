//! Conversion of scores of one rule set to a board of the other.
//!
//! The rule is in `docs/evaluate/boards.md`. In Flocking a pair of agent and target cell costs half as much under `paper` as under
//! `reference` (`docs/rules.md`), so scores of one are converted to the scale of the other. Converted games are still different:
//! under `reference` the prey of Pursuit moves by other rules, and Flocking always has the same layout. These tasks are marked.

use swarmbench_engine::TaskName;

/// Rule set of games from the public toolkit, which do not name it.
pub const OF_TOOLKIT: &str = "reference";

/// Factor by which a score of a task under the rules `from` is multiplied to get to the scale of the rules `to`; `None` if the
/// scales are equal.
#[must_use]
pub fn factor(task: TaskName, from: &str, to: &str) -> Option<f64> {
    match (task, from, to) {
        (TaskName::Flocking, "reference", "paper") => Some(0.5),
        (TaskName::Flocking, "paper", "reference") => Some(2.0),
        _ => None,
    }
}

/// True if games of a task differ between two rule sets in more than the scale of their scores.
#[must_use]
pub fn differs(task: TaskName, from: &str, to: &str) -> bool {
    from != to && matches!(task, TaskName::Pursuit | TaskName::Flocking)
}
