//! Parser of the bodies of endpoints: an answer, or an error.
//!
//! Endpoints that call themselves compatible differ widely, so the parser is lenient: a content may be a text, a list of parts
//! or missing; errors come in half a dozen shapes, some with status 200.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::usage::Reported;
use swarmbench_protocol::act::Usage;
pub use swarmbench_protocol::failure::Failure;

/// Maximum bytes of a response in JSON; longer ones are cut. With [`REASONING_BYTES_MAX`] an act stays far below its limit, and
/// a journal has room for such acts in all rounds of an episode of usual size: 12 agents, 100 rounds.
pub const RESPONSE_BYTES_MAX: usize = 32 * 1024;

/// Maximum bytes of reasoning in JSON; longer ones are cut.
pub const REASONING_BYTES_MAX: usize = 16 * 1024;

/// Maximum quoted characters of an endpoint's text.
const SAID_CHARS_MAX: usize = 300;

/// Answer of a model to a question.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelAnswer {
    /// Text of the answer, for the `response` of an act; empty without one. It is the model's own text, `<think>` included: the
    /// rules define which part counts. A response longer than [`RESPONSE_BYTES_MAX`] loses its beginning, as the last marker
    /// counts.
    pub response: String,
    /// Tokens that the endpoint reported, and the duration of the successful request.
    #[serde(default)]
    pub usage: Usage,
    /// Reasoning, if the endpoint separates it, and the text of a refusal. Longer ones lose their end after
    /// [`REASONING_BYTES_MAX`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reasoning: Option<String>,
    /// Reason why the model gave no answer, or a cut one. The act is sent all the same: the server decides whether it counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Items of the answer that a later request can carry, encrypted reasoning among them: only of the interface `responses`, and
    /// only if they were asked for ([`Settings::carries_reasoning`](super::Settings::carries_reasoning)). They take at most
    /// [`ITEMS_BYTES_MAX`](super::responses::ITEMS_BYTES_MAX).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub items: Vec<Value>,
    /// Retries before this answer.
    #[serde(skip)]
    pub retries: u32,
}

/// Answer, and its tokens if the endpoint reports them.
#[derive(Debug)]
pub(super) struct Completion {
    pub(super) answer: ModelAnswer,
    pub(super) tokens: Option<u64>,
    /// True if the endpoint reports a cost that cannot be one. It is ignored.
    pub(super) has_false_cost: bool,
}

impl Completion {
    /// True if the endpoint rejected the question without an answer.
    pub(super) fn is_rejected(&self) -> bool {
        self.answer.failure == Some(Failure::Rejected)
    }
}

/// Parses JSON. A model that stops in the middle of a character leaves half of it, which many endpoints pass on as invalid
/// JSON. The rest is parsed all the same, as a retry would give the same text.
pub(super) fn parse(body: &[u8]) -> Option<Value> {
    let body = body.strip_prefix(b"\xef\xbb\xbf").unwrap_or(body);
    let mended = || serde_json::from_str(&whole_characters(&String::from_utf8_lossy(body)));
    serde_json::from_slice(body).or_else(|_| mended()).ok()
}

/// Replaces escaped unpaired surrogates in a JSON text with U+FFFD.
fn whole_characters(json: &str) -> String {
    let unit = |escape: &str| {
        let digits = escape.strip_prefix("\\u")?.get(..4)?;
        u16::from_str_radix(digits, 16).ok()
    };
    let mut whole = String::with_capacity(json.len());
    let mut rest = json;
    while let Some(at) = rest.find('\\') {
        let (before, escape) = rest.split_at(at);
        whole.push_str(before);
        let (replacement, taken) = match (unit(escape), escape.get(6..).and_then(unit)) {
            (Some(0xD800..=0xDBFF), Some(0xDC00..=0xDFFF)) => (&escape[..12], 12),
            (Some(0xD800..=0xDFFF), _) => ("\u{FFFD}", 6),
            // The next character belongs to the escape, and may be another backslash.
            _ => {
                let taken = 1 + escape.chars().nth(1).map_or(0, char::len_utf8);
                (&escape[..taken], taken)
            }
        };
        whole.push_str(replacement);
        rest = &escape[taken..];
    }
    whole.push_str(rest);
    whole
}

/// Parses the body of a successful answer; `None` if it is no chat completion.
pub(super) fn read(body: &Value) -> Option<Completion> {
    let choices = body.get("choices")?.as_array()?;
    let choice = choices.first().unwrap_or(&Value::Null);
    let message = &choice["message"];
    let mut parts = Parts::default();
    parts.read(&message["content"]);
    // Some endpoints still have the old completions interface.
    parts.read(&choice["text"]);
    let Parts { text, mut thoughts, mut refusal } = parts;
    if thoughts.is_empty() {
        reasoning_of(message).clone_into(&mut thoughts);
    }
    if let Some(said) = message["refusal"].as_str() {
        refusal.push_str(said);
    }
    let is_blank = spoken(&text).is_empty();
    let thinks = !thoughts.trim().is_empty() || !text.trim().is_empty();
    let finish = choice["finish_reason"].as_str().unwrap_or_default();
    let failure = match finish {
        "content_filter" => Some(Failure::ContentFilter),
        "refusal" => Some(Failure::Refusal),
        _ if is_blank && !refusal.trim().is_empty() => Some(Failure::Refusal),
        "length" => Some(Failure::Truncated),
        _ if is_blank && calls_tool(message, finish) => Some(Failure::ToolCall),
        _ if is_blank && thinks => Some(Failure::ReasoningOnly),
        _ if is_blank => Some(Failure::Empty),
        _ => None,
    };
    // A refusal goes into the reasoning, which is never parsed for an action: a refusal is no answer, whatever it contains.
    if !refusal.trim().is_empty() {
        let between = if thoughts.is_empty() { "" } else { "\n" };
        thoughts = format!("{thoughts}{between}[refusal] {refusal}");
    }
    let Reported { usage, tokens, has_false_cost } = super::usage::reported(&body["usage"]);
    let reasoning = Some(thoughts).filter(|thoughts| !thoughts.trim().is_empty());
    let answer =
        ModelAnswer { response: text, usage, reasoning, failure, ..ModelAnswer::default() };
    Some(Completion { answer, tokens, has_false_cost })
}

/// Reasoning of a message, or of a piece of one, in a field of its own. Some endpoints send it in two.
pub(super) fn reasoning_of(message: &Value) -> &str {
    let fields = ["reasoning_content", "reasoning", "thinking"];
    let said = fields.iter().filter_map(|field| message[*field].as_str());
    said.into_iter().find(|said| !said.is_empty()).unwrap_or_default()
}

/// Text outside of `<think>…</think>`, where some endpoints leave the reasoning.
fn spoken(text: &str) -> &str {
    let text = text.trim();
    let Some(thoughts) = text.strip_prefix("<think>") else { return text };
    thoughts.rsplit_once("</think>").map_or("", |(_, said)| said.trim())
}

/// True if the model called a tool, in the current form or the old one.
fn calls_tool(message: &Value, finish: &str) -> bool {
    ["tool_calls", "function_call"].contains(&finish)
        || message["tool_calls"].as_array().is_some_and(|calls| !calls.is_empty())
        || message["function_call"].is_object()
}

/// Parts of a content.
#[derive(Default)]
pub(super) struct Parts {
    pub(super) text: String,
    pub(super) thoughts: String,
    pub(super) refusal: String,
}

impl Parts {
    /// Bytes of all texts.
    pub(super) const fn bytes(&self) -> usize {
        self.text.len() + self.thoughts.len() + self.refusal.len()
    }

    pub(super) fn read(&mut self, content: &Value) {
        match content {
            Value::String(text) => self.text.push_str(text),
            Value::Array(parts) => parts.iter().for_each(|part| self.part(part)),
            _ => {}
        }
    }

    fn part(&mut self, part: &Value) {
        let (field, into) = match part["type"].as_str() {
            Some("thinking" | "reasoning") => {
                let field = if part["thinking"].is_null() { "text" } else { "thinking" };
                (field, &mut self.thoughts)
            }
            Some("refusal") => ("refusal", &mut self.refusal),
            _ => ("text", &mut self.text),
        };
        match part.get(field).unwrap_or(part) {
            Value::String(text) => into.push_str(text),
            Value::Array(inner) => {
                into.extend(inner.iter().filter_map(|part| part["text"].as_str()));
            }
            _ => {}
        }
    }
}

/// Refusal by an endpoint.
#[derive(Debug, Default)]
pub(super) struct Refusal {
    /// Unchanged text, from which the key must be removed before it is shown.
    pub(super) said: String,
    /// Values of `code`, `type` and `status`, for programs.
    pub(super) names: Vec<String>,
    /// Status in the body, which may differ from that of the response.
    pub(super) status: Option<u16>,
    /// True if a content filter refused the question.
    pub(super) is_filtered: bool,
    /// True if the body has an `error`, as those of models' endpoints do; pages of gateways have none.
    pub(super) has_error: bool,
}

/// Parses the body of a failed request, which may be anything.
pub(super) fn refusal(body: &[u8]) -> Refusal {
    match serde_json::from_slice::<Value>(body) {
        Ok(value) => error_of(&value)
            .unwrap_or_else(|| Refusal { said: value.to_string(), ..Refusal::default() }),
        Err(_) => {
            Refusal { said: String::from_utf8_lossy(body).into_owned(), ..Refusal::default() }
        }
    }
}

/// Error in a body, if there is one.
pub(super) fn error_of(body: &Value) -> Option<Refusal> {
    let body = body.as_array().and_then(|list| list.first()).unwrap_or(body);
    let error = match &body["error"] {
        // A router reports an error of its upstream inside the choice.
        Value::Null => match &body["choices"][0]["error"] {
            Value::Null if body.get("choices").is_none() => body,
            Value::Null => return None,
            error => error,
        },
        error => error,
    };
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let said = ["message", "detail", "msg"].iter().find_map(|field| text(&error[*field]));
    let said = said.or_else(|| text(error)).or_else(|| text(&body["message"]))?;
    let names: Vec<_> =
        ["code", "type", "status"].iter().filter_map(|name| text(&error[*name])).collect();
    let status = error["code"].as_u64().and_then(|code| u16::try_from(code).ok());
    let status = status.or_else(|| names.iter().find_map(|name| status_of(name)));
    let inner = &error["innererror"]["code"];
    let is_filtered = names
        .iter()
        .any(|name| ["content_filter", "content_policy_violation"].contains(&name.as_str()))
        || inner == "ResponsibleAIPolicyViolation"
        || error["metadata"].get("flagged_input").is_some();
    let has_error = !body["error"].is_null();
    Some(Refusal { said, names, status, is_filtered, has_error })
}

/// Status of an error that has only a name, in a stream or a response that began as a success.
fn status_of(name: &str) -> Option<u16> {
    Some(match name {
        "invalid_request_error" | "invalid_prompt" => 400,
        "authentication_error" => 401,
        "billing_error" => 402,
        "permission_error" => 403,
        "not_found_error" => 404,
        "request_too_large" => 413,
        "rate_limit_error" | "rate_limit_exceeded" | "insufficient_quota" => 429,
        "api_error" | "server_error" | "internal_server_error" => 500,
        "timeout_error" => 504,
        "overloaded_error" => 529,
        _ => return None,
    })
}

/// Quotation of a text: one line of limited length without control characters.
pub(crate) fn one_line(text: &str) -> String {
    let words =
        text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let mut line = String::new();
    for word in words {
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
        if let Some((end, _)) = line.char_indices().nth(SAID_CHARS_MAX) {
            line.truncate(end);
            line.push('…');
            break;
        }
    }
    line
}

impl ModelAnswer {
    pub(super) fn bounded(mut self) -> Self {
        self.shorten(RESPONSE_BYTES_MAX, REASONING_BYTES_MAX);
        self
    }

    /// Cuts the response and the reasoning to a number of bytes in JSON, for a server with lower limits. The response loses its
    /// beginning, as its last marker counts; the reasoning loses its end.
    pub fn shorten(&mut self, response_bytes: usize, reasoning_bytes: usize) {
        if let Some(left_out) = to_leave_out(self.response.chars().rev(), response_bytes) {
            let end = self.response.split_off(left_out);
            // A marker after this note on the same line does not count, as the cut line may have begun with other text.
            self.response = format!("[… {left_out} bytes left out] {end}");
        }
        if let Some(reasoning) = &mut self.reasoning
            && let Some(left_out) = to_leave_out(reasoning.chars(), reasoning_bytes)
        {
            let end = reasoning.len() - left_out;
            reasoning.truncate(end);
            *reasoning = format!("{reasoning} [… {left_out} bytes left out]");
        }
    }
}

/// Bytes of a text beyond a limit; `None` if all fit.
fn to_leave_out(text: impl Iterator<Item = char>, most: usize) -> Option<usize> {
    /// Bytes of the note in place of the cut text.
    const NOTE_BYTES: usize = 48;
    let (mut written, mut left_out) = (0, 0);
    let (mut fits, mut too_long) = (true, false);
    for c in text {
        written += written_bytes(c);
        fits = fits && written + NOTE_BYTES <= most;
        too_long |= written > most;
        if !fits {
            left_out += c.len_utf8();
        }
    }
    too_long.then_some(left_out)
}

/// Bytes of a character in JSON.
const fn written_bytes(c: char) -> usize {
    match c {
        '"' | '\\' | '\n' | '\r' | '\t' | '\u{8}' | '\u{c}' => 2,
        '\0'..='\u{1f}' => 6,
        _ => c.len_utf8(),
    }
}
