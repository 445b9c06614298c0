//! System messages of models: the first message of each request.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swarmbench_engine::TaskName;

/// Bytes of a system message, all tasks together: it is stored in the `agent_meta` of a run, which has 16 KiB.
pub const SYSTEM_BYTES_MAX: usize = 8 * 1024;

/// A system message for all tasks, or one for each.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "`system` is a text, or a table with a text for each task")]
pub enum SystemMessage {
    /// A text for all tasks.
    Text(String),
    /// Texts by task; other tasks have none.
    ByTask(BTreeMap<String, String>),
}

impl SystemMessage {
    /// The texts.
    pub fn texts_mut(&mut self) -> Vec<&mut String> {
        match self {
            Self::Text(text) => vec![text],
            Self::ByTask(texts) => texts.values_mut().collect(),
        }
    }

    /// The text for a task.
    #[must_use]
    pub fn of(&self, task: &str) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            Self::ByTask(texts) => texts
                .iter()
                .find_map(|(name, text)| name.eq_ignore_ascii_case(task).then_some(text.as_str())),
        }
    }

    /// The part for these tasks; `None` if they have no text.
    pub(super) fn of_tasks(&self, tasks: &[TaskName]) -> Option<Self> {
        let Self::ByTask(_) = self else { return Some(self.clone()) };
        let text =
            |task: &TaskName| Some((task.name().to_owned(), self.of(task.name())?.to_owned()));
        let texts: BTreeMap<String, String> = tasks.iter().filter_map(text).collect();
        let first = texts.values().next()?.clone();
        let is_one = texts.len() == tasks.len() && texts.values().all(|text| *text == first);
        Some(if is_one { Self::Text(first) } else { Self::ByTask(texts) })
    }

    /// The JSON that is stored in `agent_meta`.
    #[must_use]
    pub fn json(&self) -> Value {
        json!(self)
    }

    /// Faults of the message, for people.
    pub(super) fn problems(&self) -> Vec<String> {
        let mut found = Vec::new();
        let (names, texts): (Vec<&str>, Vec<&str>) = match self {
            Self::Text(text) => (Vec::new(), vec![text]),
            Self::ByTask(texts) => (
                texts.keys().map(String::as_str).collect(),
                texts.values().map(String::as_str).collect(),
            ),
        };
        for name in names {
            if !TaskName::ALL.into_iter().any(|task| task.name().eq_ignore_ascii_case(name)) {
                let known = TaskName::ALL.map(TaskName::name).join(", ");
                found.push(format!("system: there is no task {name:?}; the tasks are {known}"));
            }
        }
        if texts.iter().any(|text| text.trim().is_empty()) {
            found
                .push("system: a text is empty; leave it out where there is to be none".to_owned());
        }
        let bytes: usize = texts.iter().map(|text| text.len()).sum();
        if bytes > SYSTEM_BYTES_MAX {
            found.push(format!("system: must have at most {SYSTEM_BYTES_MAX} bytes, has {bytes}"));
        }
        found
    }
}
