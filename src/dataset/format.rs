//! The shapes of the three kinds of files: an index of runs, the states of a run, and what its agents
//! did.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// The name of the index.
pub const META: &str = "meta_log.json";

/// The name of the file with the states of a run.
#[must_use]
pub fn game_file(run_id: &str) -> String {
    format!("game_log_{run_id}.json")
}

/// The name of the file with what the agents of a run did.
#[must_use]
pub fn agent_file(run_id: &str) -> String {
    format!("agent_log_{run_id}.json")
}

/// Characters of a run's id.
pub const RUN_ID_CHARS_MAX: usize = 128;

/// Whether a text may be a part of a file's name: letters, digits, `-`, `_`, spaces and parentheses, of
/// which the toolkit makes its ids (a time and the name of a thread).
#[must_use]
pub fn is_run_id(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | ' ' | '(' | ')');
    (1..=RUN_ID_CHARS_MAX).contains(&text.len()) && text.chars().all(plain) && text.trim() == text
}

/// The settings of a run: a value of the index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Who plays: a name, or a list with the name of each agent's model.
    pub model: Value,
    /// The task. Logs of the toolkit's first versions call it `level`.
    #[serde(alias = "level")]
    pub task: String,
    /// How many agents play.
    pub num_agents: u32,
    /// After how many rounds the run ends at the latest.
    pub max_round: u32,
    /// Columns of the map.
    pub width: u32,
    /// Rows of the map.
    pub height: u32,
    /// The seed of the layout.
    pub seed: u64,
    /// Rows and columns of an agent's window.
    pub view_size: u32,
    /// Further fields. An export has `rules`, `control`, `memory`, `noise`, `max_delay`, `status`, and
    /// `run` where there is one.
    #[serde(flatten)]
    pub rest: Map<String, Value>,
}

/// A state of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GameRow {
    /// When it was logged: seconds since 1970.
    pub timestamp: Option<f64>,
    /// The task.
    #[serde(alias = "level")]
    pub task: String,
    /// How many rounds were resolved; 0 is the layout.
    pub round: u32,
    /// Rows of cells of one character.
    pub grid: Vec<Vec<String>>,
    /// All agents, also those that have left the map.
    pub agents: Vec<AgentAt>,
    /// The score.
    pub score: f64,
    /// What was said in the round that led here.
    pub messages: Vec<Said>,
}

/// Where an agent is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AgentAt {
    /// Its name.
    pub id: String,
    /// Its column.
    pub x: i32,
    /// Its row.
    pub y: i32,
}

/// A message as it was sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Said {
    /// In which round.
    pub round: u32,
    /// By whom.
    pub agent_name: String,
    /// The text.
    pub message: String,
}

/// What an agent did in a round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentRow {
    /// When: seconds since 1970.
    pub timestamp: Option<f64>,
    /// The task.
    #[serde(alias = "level")]
    pub task: String,
    /// The round that was decided; its state is the one with the same number.
    pub round: u32,
    /// The agent's name.
    pub agent_id: String,
    /// What the agent saw: rows of cells, its own number in its own.
    pub view: Option<Vec<Vec<String>>>,
    /// The text for the language model.
    pub prompt: Option<String>,
    /// What the language model answered.
    pub response: Option<String>,
    /// What the agent did.
    pub action: Option<String>,
    /// What the agent said.
    pub message: Option<String>,
    /// How long the language model took, in seconds.
    pub api_call_time: Option<f64>,
    /// Whether the action did what its name says.
    pub action_success: Option<bool>,
    /// Tokens of all the agent's answers so far.
    pub total_llm_tokens: Option<u64>,
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
