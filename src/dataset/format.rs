//! The three kinds of files of the toolkit: an index of runs, the states of a run, and the acts of a run.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use swarmbench_protocol::failure::Failure;

/// File name of the index.
pub const META: &str = "meta_log.json";

/// File name of a run's states.
pub fn game_file(run_id: &str) -> String {
    format!("game_log_{run_id}.json")
}

/// File name of a run's acts.
pub fn agent_file(run_id: &str) -> String {
    format!("agent_log_{run_id}.json")
}

pub const RUN_ID_CHARS_MAX: usize = 128;

/// Whether a text may be part of a file name: letters, digits, `-`, `_`, spaces and parentheses. The toolkit's ids consist of
/// a time and the name of a thread.
pub fn is_run_id(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | ' ' | '(' | ')');
    (1..=RUN_ID_CHARS_MAX).contains(&text.len()) && text.chars().all(plain) && text.trim() == text
}

/// The settings of a run: a value of the index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// One model name, or a list with the name of each agent's model.
    pub model: Value,
    /// Named `level` in logs of the toolkit's first versions.
    #[serde(alias = "level")]
    pub task: String,
    pub num_agents: u32,
    pub max_round: u32,
    pub width: u32,
    pub height: u32,
    pub seed: u64,
    /// Rows and columns of an agent's window.
    pub view_size: u32,
    /// Further fields. Exports have `rules`, `control`, `memory`, `noise`, `max_delay`, `status`, `run` for games of a run,
    /// and `mixed` and `holders` for games with several holders.
    #[serde(flatten)]
    pub rest: Map<String, Value>,
}

/// A state of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GameRow {
    /// Seconds since 1970.
    pub timestamp: Option<f64>,
    #[serde(alias = "level")]
    pub task: String,
    /// Resolved rounds; 0 is the layout.
    pub round: u32,
    /// Rows of one-character cells.
    pub grid: Vec<Vec<String>>,
    /// All agents, including escaped ones.
    pub agents: Vec<AgentAt>,
    pub score: f64,
    /// Messages of the last resolved round.
    pub messages: Vec<Said>,
}

/// The position of an agent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AgentAt {
    pub id: String,
    /// Column.
    pub x: i32,
    /// Row.
    pub y: i32,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Said {
    pub round: u32,
    pub agent_name: String,
    pub message: String,
}

/// An act of an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentRow {
    /// Seconds since 1970.
    pub timestamp: Option<f64>,
    #[serde(alias = "level")]
    pub task: String,
    /// Round of the act, equal to the number of the state before it.
    pub round: u32,
    pub agent_id: String,
    /// Rows of cells of the agent's window. Its own cell has its own number.
    pub view: Option<Vec<Vec<String>>>,
    pub prompt: Option<String>,
    pub response: Option<String>,
    pub action: Option<String>,
    pub message: Option<String>,
    /// Latency of the language model, in seconds.
    pub api_call_time: Option<f64>,
    /// Whether the action had its effect.
    pub action_success: Option<bool>,
    /// Total tokens of the agent's answers so far.
    pub total_llm_tokens: Option<u64>,
    /// Reason of an invalid answer. This and all following fields are extensions of the toolkit's format.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Model of the seat's holder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Number of the seat's holder; 0 is the creator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<u32>,
    /// The built-in player of a hosted seat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ids_of_the_toolkit_and_of_episodes_are_run_ids_and_paths_are_not() {
        let longest = "r".repeat(RUN_ID_CHARS_MAX);
        for good in [
            "1746000000-ThreadPoolExecutor-0_3",
            "1746000000-Thread-1 (run)",
            "ep_0199f0c2a1d87c3e9b5a4d6f10e2b3c4",
            longest.as_str(),
        ] {
            assert!(is_run_id(good), "{good}");
        }
        let long = format!("{longest}r");
        for bad in [
            "",
            " ",
            "a ",
            "..",
            "../x",
            "a/b",
            "a\\b",
            "a.json",
            "C:x",
            "a\0",
            "a\nb",
            "é",
            "a\u{202e}b",
            long.as_str(),
        ] {
            assert!(!is_run_id(bad), "{bad:?}");
        }
    }

    #[test]
    fn the_names_of_the_first_versions_are_read_too() {
        let row = r#"{"timestamp": 1, "level": "Pursuit", "round": 0, "grid": [["W"]], "agents": [],
                      "score": 0, "messages": [], "more": {"a": 1}}"#;
        let row: GameRow = serde_json::from_str(row).expect("a row");
        assert_eq!((row.task.as_str(), row.timestamp), ("Pursuit", Some(1.0)));
    }
}
