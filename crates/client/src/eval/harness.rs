//! The harness of a model: what stands between the server's prompts and the model beside a system message.
//!
//! By default there is none, as in the paper: each question is a prompt alone. A harness adds earlier rounds of the seat's own
//! dialogue, notes that the seat keeps, further tries after an invalid answer, or a JSON schema for answers. It is a part of a
//! run's identity, and each act says what it added.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use swarmbench_engine::AnswerReader;
use swarmbench_protocol::act::Harness;
use swarmbench_protocol::observation::Sight;

/// Maximum characters of notes: they are in each prompt, and stored with each act.
pub const SCRATCHPAD_CHARS_MAX: u32 = 4000;

/// A harness. Options that are left out are those of the experiment, and in the end those of the paper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct HarnessPlan {
    /// The number of earlier rounds whose prompts and answers come before each prompt (0).
    #[arg(long, value_name = "ROUNDS")]
    pub history: Option<u32>,
    /// The maximum number of characters of notes that a seat keeps from round to round, and that it alone reads (0: none).
    #[arg(long, value_name = "CHARACTERS")]
    pub scratchpad: Option<u32>,
    /// The number of further tries after an invalid answer, with the reason told to the model (0).
    #[arg(long, value_name = "TIMES")]
    pub retries_on_invalid: Option<u32>,
    /// The shape of answers: markers, or json for an object by a schema (markers).
    #[arg(long, value_name = "SHAPE")]
    pub answer: Option<AnswerShape>,
    /// Carry encrypted reasoning with the rounds of --history, with --api responses (false).
    #[arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL")]
    pub carry_reasoning: Option<bool>,
}

/// The shape of a model's answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum AnswerShape {
    /// Text with markers, which the reader of the games finds.
    Markers,
    /// A JSON object: the games have the reader `json`.
    Json,
}

impl HarnessPlan {
    /// These options, and those of `base` where they are left out.
    #[must_use]
    pub fn over(&self, base: &Self) -> Self {
        Self {
            history: self.history.or(base.history),
            scratchpad: self.scratchpad.or(base.scratchpad),
            retries_on_invalid: self.retries_on_invalid.or(base.retries_on_invalid),
            answer: self.answer.or(base.answer),
            carry_reasoning: self.carry_reasoning.or(base.carry_reasoning),
        }
    }

    /// The reader of games with this shape of answers, in place of the one of the settings; `None` to keep that.
    #[must_use]
    pub fn reader(&self, named: &str) -> Option<String> {
        let is_json = named == AnswerReader::Json.name();
        match self.answer? {
            AnswerShape::Json => Some(AnswerReader::Json.name().to_owned()),
            AnswerShape::Markers => is_json.then(AnswerReader::usual),
        }
    }

    /// Numbers of rounds, of characters and of tries.
    #[must_use]
    pub fn numbers(&self) -> [u32; 3] {
        [self.history, self.scratchpad, self.retries_on_invalid].map(Option::unwrap_or_default)
    }

    /// The harness in an identity and in `agent_meta`, in games with this reader; `None` for the paper's.
    #[must_use]
    pub fn meta(&self, reader: &str) -> Option<Value> {
        let Value::Object(mut all) = json!(self) else { return None };
        all["answer"] = json!((reader == AnswerReader::Json.name()).then_some("json"));
        all.retain(|_, value| ![json!(0), json!(false), Value::Null].contains(value));
        (!all.is_empty()).then_some(Value::Object(all))
    }

    /// Fault of the options, for an interface whose answers have `items` or not.
    pub(super) fn problem(&self, has_items: bool) -> Option<String> {
        let names = ["history", "scratchpad", "retries_on_invalid"];
        let [rounds, tries] = [Harness::ROUNDS_MAX, Harness::TRIES_MAX].map(u32::from);
        let most = [rounds, SCRATCHPAD_CHARS_MAX, tries];
        let mut numbers = names.into_iter().zip(self.numbers()).zip(most);
        if let Some(((name, is), most)) = numbers.find(|((_, is), most)| is > most) {
            return Some(format!("{name} is {is}, and may be 0 to {most}"));
        }
        let is_possible = has_items && self.numbers()[0] > 0;
        (self.carry_reasoning == Some(true) && !is_possible).then(|| {
            "carry_reasoning is an option of api responses, with a history of at least 1 round"
                .to_owned()
        })
    }
}

/// Words of a harness for one question.
pub(super) struct Words<'a> {
    /// Characters of notes.
    pub(super) scratchpad: u32,
    pub(super) is_json: bool,
    /// True if the seat may name the receiver of its message.
    pub(super) commands: bool,
    pub(super) sight: &'a Sight,
}

impl Words<'_> {
    /// Text after the prompt; `None` without one.
    pub(super) fn added(&self, scratchpad: &str) -> Option<String> {
        let mut parts = Vec::new();
        if self.scratchpad > 0 {
            let most = self.scratchpad;
            let now = if scratchpad.is_empty() { "(none yet)" } else { scratchpad };
            let how = if self.is_json {
                "To replace them, give the new ones in \"notes\"; null keeps them."
            } else {
                "To replace them, end your answer with NOTES: and the new ones; without it they stay."
            };
            parts.push(format!(
                "You keep notes from round to round, at most {most} characters, which nobody else reads. Your notes:\n{now}\n{how}"
            ));
        }
        if self.is_json {
            let actions = self.sight.actions.join(", ");
            let mut fields = vec![
                format!("\"action\" is one of {actions}, or null"),
                "\"message\" is your message, or null".to_owned(),
            ];
            if self.commands {
                let to = "\"to\" is the only receiver of the message, such as Agent_1, or null";
                fields.push(to.to_owned());
            }
            parts.push(format!(
                "Instead of lines with markers, answer with one JSON object and nothing else: {}.",
                fields.join("; ")
            ));
        }
        (!parts.is_empty()).then(|| parts.join("\n\n"))
    }

    /// JSON schema of answers, in the part of the language that all endpoints know: all fields are required.
    pub(super) fn schema(&self) -> Option<Value> {
        if !self.is_json {
            return None;
        }
        let text = || json!({ "type": ["string", "null"] });
        let mut actions: Vec<Value> = self.sight.actions.iter().map(|name| json!(name)).collect();
        actions.push(Value::Null);
        let mut fields = Map::new();
        fields.insert("action".to_owned(), json!({ "type": ["string", "null"], "enum": actions }));
        fields.insert("message".to_owned(), text());
        if self.commands {
            fields.insert("to".to_owned(), text());
        }
        if self.scratchpad > 0 {
            fields.insert("notes".to_owned(), text());
        }
        let names: Vec<&String> = fields.keys().collect();
        Some(json!({
            "type": "object", "required": names, "additionalProperties": false, "properties": fields,
        }))
    }

    /// The new notes of an answer, cut to their limit; `None` if it keeps the old ones.
    pub(super) fn notes(&self, answer: &str) -> Option<String> {
        if self.scratchpad == 0 {
            return None;
        }
        let spoken = answer.rsplit_once("</think>").map_or(answer, |(_, spoken)| spoken);
        let new = if self.is_json { field(spoken)? } else { marked(spoken)? };
        let most = usize::try_from(self.scratchpad).unwrap_or(usize::MAX);
        Some(new.trim().chars().take(most).collect())
    }
}

/// The field `notes` of the object that the server reads.
fn field(text: &str) -> Option<String> {
    #[derive(Deserialize)]
    struct Fields {
        notes: Option<String>,
    }
    let json = &text[text.find('{')?..];
    let fields = serde_json::Deserializer::from_str(json).into_iter::<Fields>().next()?;
    fields.ok()?.notes
}

/// The text after the last line that begins with `NOTES:`, up to a line with another marker.
fn marked(text: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let start = lines.iter().rposition(|line| value(line, "NOTES").is_some())?;
    let first = value(lines[start], "NOTES")?;
    let is_other =
        |line: &&&str| ["ACTION", "MSG", "TO"].iter().any(|marker| value(line, marker).is_some());
    let rest = lines[start + 1..].iter().take_while(|line| !is_other(line)).copied();
    Some([first].into_iter().chain(rest).collect::<Vec<_>>().join("\n"))
}

/// The value of a marker at the beginning of a line, whatever Markdown stands around it.
fn value<'a>(line: &'a str, marker: &str) -> Option<&'a str> {
    let is_around = |c: char| c.is_whitespace() || "*_`#->".contains(c);
    let line = line.trim_start_matches(is_around);
    let word = line.get(..marker.len()).filter(|word| word.eq_ignore_ascii_case(marker))?;
    let value = line[word.len()..].trim_start_matches(is_around).strip_prefix(':')?;
    Some(value.trim_start_matches(['*', '_', '`']))
}
