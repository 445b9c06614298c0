//! Scores of one rule set on a board of the other.
//!
//! `docs/evaluate/boards.md` has the rule. In Flocking a pair of agent and target cell costs half as much under `paper`
//! as under `reference` (`docs/rules.md`), so scores of one are converted to the scale of the other. A conversion does not
//! make the games the same: under `reference` the prey of Pursuit moves by other rules, and Flocking always has the same
//! layout. These tasks are marked.

use swarmbench_engine::TaskName;

/// The rule set of games that were played with the public toolkit, and do not say so.
pub const OF_TOOLKIT: &str = "reference";

/// By what a score of a task under the rules `from` is multiplied to be at the scale of the rules `to`; `None` if it is the
/// same scale.
#[must_use]
pub fn factor(task: TaskName, from: &str, to: &str) -> Option<f64> {
    match (task, from, to) {
        (TaskName::Flocking, "reference", "paper") => Some(0.5),
        (TaskName::Flocking, "paper", "reference") => Some(2.0),
        _ => None,
    }
}

/// Whether games of a task differ between two rule sets in more than the scale of their scores.
#[must_use]
pub fn differs(task: TaskName, from: &str, to: &str) -> bool {
    from != to && matches!(task, TaskName::Pursuit | TaskName::Flocking)
}
