//! Arguments of tools, read strictly: an error names all problems at once.

use std::time::Duration;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use swarmbench_protocol::act::ActRequest;

use crate::{MCP_ACT_WAIT_S_DEFAULT, MCP_WAIT_S_MAX};

/// Maximum number of characters of a wrong value in an error.
const SHOWN_CHARS_MAX: usize = 40;

/// Maximum number of unknown arguments in an error.
const UNKNOWN_MAX: usize = 10;

/// Takes arguments by their names, and collects problems.
struct Reader {
    arguments: Map<String, Value>,
    known: Vec<&'static str>,
    problems: Vec<String>,
}

/// Reads the arguments of `look`: its wait.
pub(crate) fn look(arguments: Map<String, Value>) -> Result<Duration, String> {
    let mut reader = Reader::new(arguments);
    let wait = reader.wait(0);
    reader.finish(wait)
}

/// Reads the arguments of `act`: the act, and the wait for the next round.
pub(crate) fn act(arguments: Map<String, Value>) -> Result<(ActRequest, Duration), String> {
    let mut reader = Reader::new(arguments);
    let round = reader.take("round", "a whole number, the round that `look` showed");
    let request = ActRequest {
        action: reader.take("action", "a text"),
        message: reader.take("message", "a text"),
        // Models write an empty text for an argument that they leave out.
        to: reader.take("to", "a text").filter(|to: &String| !to.is_empty()),
        round: round.unwrap_or_default(),
        ..ActRequest::default()
    };
    reader.need("round", round.is_some());
    reader.need("action", request.action.is_some());
    let wait = reader.wait(MCP_ACT_WAIT_S_DEFAULT);
    reader.finish((request, wait))
}

impl Reader {
    const fn new(arguments: Map<String, Value>) -> Self {
        Self { arguments, known: Vec::new(), problems: Vec::new() }
    }

    /// Takes the value of an argument, unless another one was expected; null counts as left out.
    fn take<T: DeserializeOwned>(&mut self, name: &'static str, expected: &str) -> Option<T> {
        self.known.push(name);
        let value = self.arguments.remove(name).filter(|value| !value.is_null())?;
        let taken = T::deserialize(&value).ok();
        if taken.is_none() {
            let shown: String = value.to_string().chars().take(SHOWN_CHARS_MAX).collect();
            self.problems.push(format!("{name} must be {expected}, is {shown}"));
        }
        taken
    }

    /// Records a missing argument, unless it was given and refused.
    fn need(&mut self, name: &str, is_taken: bool) {
        let start = format!("{name} ");
        if !is_taken && !self.problems.iter().any(|problem| problem.starts_with(&start)) {
            self.problems.push(format!("{name} is missing"));
        }
    }

    fn wait(&mut self, usual: u32) -> Duration {
        let expected = format!("from 0 to {MCP_WAIT_S_MAX} seconds (mcp_wait_s_max)");
        let seconds = self.take("wait_s", &expected).unwrap_or_else(|| f64::from(usual));
        if !(0.0..=f64::from(MCP_WAIT_S_MAX)).contains(&seconds) {
            self.problems.push(format!("wait_s must be {expected}, is {seconds:?}"));
            return Duration::ZERO;
        }
        Duration::from_secs_f64(seconds)
    }

    fn finish<T>(mut self, read: T) -> Result<T, String> {
        for name in self.arguments.keys().take(UNKNOWN_MAX) {
            let shown: String = name.chars().take(SHOWN_CHARS_MAX).collect();
            let known = self.known.join(", ");
            self.problems.push(format!("{shown} is unknown; the arguments are {known}"));
        }
        if self.problems.is_empty() { Ok(read) } else { Err(self.problems.join("; ")) }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn object(value: Value) -> Map<String, Value> {
        let Value::Object(object) = value else { panic!("an object") };
        object
    }

    #[test]
    fn good_arguments_are_taken() {
        let (request, wait) = act(object(json!({
            "round": 3, "action": "UP", "message": "hi", "to": "Agent_2", "wait_s": 1.5
        })))
        .expect("good");
        assert_eq!((request.round, request.action.as_deref()), (3, Some("UP")));
        assert_eq!(
            (request.message.as_deref(), request.to.as_deref()),
            (Some("hi"), Some("Agent_2"))
        );
        assert_eq!(wait, Duration::from_millis(1500));
        let (request, wait) =
            act(object(json!({ "round": 0, "action": "STAY", "to": "", "message": null })))
                .expect("good");
        assert_eq!((request.message, request.to), (None, None));
        assert_eq!(wait, Duration::from_secs(MCP_ACT_WAIT_S_DEFAULT.into()));
        assert_eq!(look(Map::new()), Ok(Duration::ZERO));
        assert_eq!(look(object(json!({ "wait_s": 45 }))), Ok(Duration::from_secs(45)));
    }

    #[test]
    fn an_error_names_all_that_is_wrong() {
        for (arguments, expected) in [
            (json!({}), "round is missing; action is missing"),
            (
                json!({ "round": "3", "action": "UP" }),
                "round must be a whole number, the round that `look` showed, is \"3\"",
            ),
            (json!({ "round": -1, "action": "UP" }), "is -1"),
            (json!({ "round": 1.5, "action": "UP" }), "is 1.5"),
            (json!({ "round": 1, "action": 7 }), "action must be a text, is 7"),
            (
                json!({ "round": 1, "action": "UP", "wait_s": 46 }),
                "wait_s must be from 0 to 45 seconds (mcp_wait_s_max), is 46",
            ),
            (json!({ "round": 1, "action": "UP", "wait_s": "long" }), "is \"long\""),
            (
                json!({ "round": 1, "action": "UP", "response": "x" }),
                "response is unknown; the arguments are round, action, message, to, wait_s",
            ),
        ] {
            let said = act(object(arguments)).expect_err("it is wrong");
            assert!(said.contains(expected), "{said}");
        }
        let said = act(object(json!({ "round": 1, "action": 7 }))).expect_err("it is wrong");
        assert!(!said.contains("missing"), "{said}");
        let said = look(object(json!({ "round": 1, "wait_s": -1 }))).expect_err("it is wrong");
        assert!(
            said.contains("is -1") && said.contains("round is unknown; the arguments are wait_s"),
            "{said}"
        );
    }
}
