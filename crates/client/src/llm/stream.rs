//! Reader of a stream of events: it puts the pieces of an answer together into the body that a whole answer would have.
//!
//! A stream is whole only with its end: `[DONE]` after the reason to stop, `response.completed` or `response.incomplete`,
//! `message_stop`. What breaks, stalls or ends before that is no answer. Responses number their events, so repeated ones are
//! left out; chat completions and messages do not, so a stream is broken where it can be seen that one came twice.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use serde_json::{Map, Value, json};
use sse_core::{MessageEvent, SseDecoder, SseEvent};

use super::api::Api;
use super::completion::{Parts, parse, reasoning_of};

/// Maximum bytes of one event. The last event of a response has the whole response.
pub(super) const EVENT_BYTES_MAX: NonZeroUsize = NonZeroUsize::new(2 * 1024 * 1024).expect("not 0");

/// Maximum bytes that are read of a stream. An event takes some hundred bytes and brings one token.
pub(super) const STREAM_BYTES_MAX: usize = 64 * 1024 * 1024;

/// Maximum bytes that are kept of a stream: texts, and the items of a response.
const KEPT_BYTES_MAX: usize = 8 * 1024 * 1024;

/// Maximum parts of an answer: the blocks of a message, the items of a response.
const PARTS_MAX: usize = 1024;

/// Name of the last event of chat completions.
const DONE: &str = "[DONE]";

/// Reason why a stream brings no answer.
#[derive(Debug, PartialEq)]
pub(super) enum Fault {
    /// It cannot be put together, or is not whole: a predicate for people.
    Broken(String),
    /// The endpoint reports an error: the body with it.
    Error(Value),
}

fn broken(what: &str) -> Fault {
    Fault::Broken(what.to_owned())
}

/// Reader; see the module.
pub(super) struct Reader {
    decoder: SseDecoder,
    answer: Answer,
    meter: Meter,
    is_over: bool,
}

/// Measures of what has come.
#[derive(Default)]
struct Meter {
    /// Bytes that are kept, of texts and items.
    kept: usize,
    /// True once a token has come, of the answer or of its reasoning.
    has_token: bool,
}

impl Meter {
    /// Counts a piece of a text.
    const fn text(&mut self, bytes: usize) {
        self.kept += bytes;
        self.has_token |= bytes > 0;
    }
}

/// Pieces of an answer.
enum Answer {
    Chat(Chat),
    Response(Response),
    Message(Message),
}

#[derive(Default)]
struct Chat {
    parts: Parts,
    calls_tool: bool,
    finish_reason: Option<String>,
    usage: Value,
    /// Data of the event with the reason to stop.
    last: String,
}

#[derive(Default)]
struct Response {
    /// Finished items by their places.
    items: BTreeMap<usize, Value>,
    /// Number of the latest event.
    number: Option<i64>,
    /// The response, once it has ended.
    ended: Option<Value>,
}

#[derive(Default)]
struct Message {
    /// Fields of the message, once it has begun.
    head: Option<Map<String, Value>>,
    /// Blocks, their texts, and true for those that have ended.
    blocks: Vec<(Value, String, bool)>,
}

impl Reader {
    pub(super) fn new(api: Api) -> Self {
        let answer = match api {
            Api::OpenAi => Answer::Chat(Chat::default()),
            Api::Responses => Answer::Response(Response::default()),
            Api::Anthropic => Answer::Message(Message::default()),
        };
        let decoder = SseDecoder::with_limit(EVENT_BYTES_MAX);
        Self { decoder, answer, meter: Meter::default(), is_over: false }
    }

    /// True if a body without the type of a stream begins like one.
    pub(super) fn is_stream(body: &[u8]) -> bool {
        ["data:", "event:", ": "].iter().any(|field| body.starts_with(field.as_bytes()))
    }

    /// Reads the next bytes. Returns true once the stream has had its end event; bytes after it are not read.
    pub(super) fn read(&mut self, mut bytes: &[u8]) -> Result<bool, Fault> {
        while !self.is_over
            && let Some(event) = self.decoder.next(&mut bytes)
        {
            let too_long =
                |_| Fault::Broken(format!("had an event of more than {EVENT_BYTES_MAX} bytes"));
            if let SseEvent::Message(event) = event.map_err(too_long)? {
                self.is_over = self.event(&event)?;
            }
        }
        Ok(self.is_over)
    }

    /// True once a token has come, of the answer or of its reasoning.
    pub(super) const fn has_token(&self) -> bool {
        self.meter.has_token
    }

    /// Body of the whole answer, after the end event or the end of the bytes.
    pub(super) fn body(self) -> Result<Value, Fault> {
        let is_over = self.is_over;
        match self.answer {
            Answer::Chat(chat) => chat.body(is_over),
            Answer::Response(response) => response.body(),
            Answer::Message(message) if is_over => Ok(message.body()),
            Answer::Message(_) => Err(broken("ended before message_stop")),
        }
    }

    fn event(&mut self, MessageEvent { data, event, .. }: &MessageEvent) -> Result<bool, Fault> {
        let is_chat = matches!(self.answer, Answer::Chat(_));
        if data.trim() == DONE {
            // Others than chat completions have an end event of their own before this.
            return if is_chat { Ok(true) } else { Err(broken("ended without its last event")) };
        }
        let value = parse(data.as_bytes()).filter(Value::is_object);
        let value = value.ok_or_else(|| broken("had an event that is no JSON object"))?;
        let is_error = value["type"] == "error" || event == "error";
        if is_error || !value["error"].is_null() || !value["choices"][0]["error"].is_null() {
            return Err(Fault::Error(value));
        }
        let meter = &mut self.meter;
        let is_over = match &mut self.answer {
            Answer::Chat(chat) => chat.add(&value, data, meter)?,
            Answer::Response(response) => response.add(value, data.len(), meter)?,
            Answer::Message(message) => message.add(&value, data.len(), meter)?,
        };
        if meter.kept > KEPT_BYTES_MAX {
            return Err(Fault::Broken(format!("had more than {KEPT_BYTES_MAX} bytes of text")));
        }
        Ok(is_over)
    }
}

impl Chat {
    /// Adds a chunk. Returns true for the end of the stream, as for the other interfaces.
    fn add(&mut self, chunk: &Value, data: &str, meter: &mut Meter) -> Result<bool, Fault> {
        if chunk["usage"].is_object() {
            // Usage is of the whole answer so far.
            self.usage = chunk["usage"].clone();
        }
        // Only one choice is asked for.
        let choices = chunk["choices"].as_array().into_iter().flatten();
        let Some(choice) =
            choices.into_iter().find(|choice| choice["index"].as_u64().unwrap_or(0) == 0)
        else {
            return Ok(false);
        };
        let delta = if choice["delta"].is_null() { &choice["message"] } else { &choice["delta"] };
        let before = self.parts.bytes();
        self.parts.read(&delta["content"]);
        self.parts.read(&choice["text"]);
        self.parts.thoughts.push_str(reasoning_of(delta));
        self.parts.refusal.push_str(delta["refusal"].as_str().unwrap_or_default());
        let more = self.parts.bytes() - before;
        if self.finish_reason.is_some() && (more > 0 || self.last == data) {
            return Err(broken("went on after its end, so its events are repeated"));
        }
        let calls = delta["tool_calls"].as_array();
        self.calls_tool |= calls.is_some_and(|calls| !calls.is_empty());
        self.calls_tool |= delta["function_call"].is_object();
        if let Some(reason) = choice["finish_reason"].as_str().filter(|reason| !reason.is_empty()) {
            self.finish_reason = Some(reason.to_owned());
            data.clone_into(&mut self.last);
        }
        meter.text(more);
        Ok(false)
    }

    fn body(self, is_over: bool) -> Result<Value, Fault> {
        let Self { parts, calls_tool, finish_reason, usage, .. } = self;
        let Some(finish_reason) = finish_reason else {
            return Err(broken("ended before a reason to stop"));
        };
        // Some endpoints close the connection instead: nothing is missing if the usage has come, too.
        if !is_over && usage.is_null() {
            return Err(broken("ended before [DONE]"));
        }
        let Parts { text, thoughts, refusal } = parts;
        let mut message = json!({ "content": text, "reasoning": thoughts, "refusal": refusal });
        if calls_tool {
            message["tool_calls"] = json!([{}]);
        }
        Ok(json!({
            "choices": [{ "message": message, "finish_reason": finish_reason }],
            "usage": usage,
        }))
    }
}

impl Response {
    /// Adds an event with its length in bytes.
    fn add(&mut self, mut event: Value, bytes: usize, meter: &mut Meter) -> Result<bool, Fault> {
        if let Some(number) = event["sequence_number"].as_i64() {
            if self.number.is_some_and(|latest| number <= latest) {
                return Ok(false);
            }
            self.number = Some(number);
        }
        let kind = event["type"].as_str().unwrap_or_default().to_owned();
        match kind.as_str() {
            "response.output_item.done" => {
                let place =
                    event["output_index"].as_u64().and_then(|place| usize::try_from(place).ok());
                let place = place.filter(|place| *place < PARTS_MAX);
                let place = place.ok_or_else(|| broken("had an item without a place"))?;
                self.items.insert(place, event["item"].take());
                meter.kept += bytes;
            }
            "response.completed" | "response.incomplete" => {
                self.ended = Some(event["response"].take());
                return Ok(true);
            }
            "response.failed" => return Err(Fault::Error(event["response"].take())),
            "response.cancelled" => return Err(broken("was cancelled by the endpoint")),
            kind if kind.rsplit('.').next() == Some("delta") => {
                // The items have these texts again.
                meter.has_token |= event["delta"].as_str().is_some_and(|text| !text.is_empty());
            }
            _ => {}
        }
        Ok(false)
    }

    fn body(self) -> Result<Value, Fault> {
        let Some(mut response) = self.ended.filter(Value::is_object) else {
            return Err(broken("ended before response.completed"));
        };
        // Some endpoints send the items only one by one.
        if response["output"].as_array().is_none_or(Vec::is_empty) {
            response["output"] = self.items.into_values().collect();
        }
        Ok(response)
    }
}

impl Message {
    /// Adds an event with its length in bytes.
    fn add(&mut self, event: &Value, bytes: usize, meter: &mut Meter) -> Result<bool, Fault> {
        let kind = event["type"].as_str().unwrap_or_default();
        let repeated = || broken("has events that contradict each other or are repeated");
        if !["message_start", "ping"].contains(&kind) && self.head.is_none() {
            return Err(broken("did not begin with message_start"));
        }
        let place = || event["index"].as_u64().and_then(|place| usize::try_from(place).ok());
        match kind {
            "message_start" => {
                let head = event["message"].as_object().cloned().unwrap_or_default();
                if self.head.replace(head).is_some() {
                    return Err(repeated());
                }
                meter.kept += bytes;
            }
            "content_block_start" => {
                let is_next = place() == Some(self.blocks.len()) && self.blocks.len() < PARTS_MAX;
                if !is_next || self.blocks.last().is_some_and(|(.., is_over)| !is_over) {
                    return Err(repeated());
                }
                let block = event["content_block"].clone();
                let begun = ["text", "thinking"].into_iter().find_map(|name| block[name].as_str());
                let begun = begun.unwrap_or_default().to_owned();
                meter.has_token |= !begun.is_empty();
                meter.kept += bytes;
                self.blocks.push((block, begun, false));
            }
            "content_block_delta" => {
                let open = place().and_then(|place| self.blocks.get_mut(place));
                let (_, text, _) = open.filter(|(.., is_over)| !is_over).ok_or_else(repeated)?;
                let delta = &event["delta"];
                let more = ["text", "thinking"].into_iter().find_map(|name| delta[name].as_str());
                text.push_str(more.unwrap_or_default());
                meter.text(more.map_or(0, str::len));
            }
            "content_block_stop" => {
                let open = place().and_then(|place| self.blocks.get_mut(place));
                let (.., is_over) = open.filter(|(.., is_over)| !is_over).ok_or_else(repeated)?;
                *is_over = true;
            }
            "message_delta" => {
                let head = self.head.get_or_insert_default();
                if head.get("stop_reason").is_some_and(|reason| !reason.is_null()) {
                    return Err(repeated());
                }
                let more = event["delta"].as_object().cloned().unwrap_or_default();
                head.extend(more);
                // Counts are of the whole answer so far; those that are left out stay.
                if let (Some(counts), Some(usage)) = (
                    event["usage"].as_object(),
                    head.entry("usage").or_insert(json!({})).as_object_mut(),
                ) {
                    usage.extend(counts.clone());
                }
                meter.kept += bytes;
            }
            "message_stop" => {
                let reason = self.head.as_ref().and_then(|head| head.get("stop_reason"));
                let is_whole = self.blocks.iter().all(|(.., is_over)| *is_over);
                let is_whole = is_whole && reason.is_some_and(Value::is_string);
                return if is_whole { Ok(true) } else { Err(repeated()) };
            }
            _ => {}
        }
        Ok(false)
    }

    fn body(self) -> Value {
        let filled = self.blocks.into_iter().map(|(mut block, text, _)| {
            let field = if block["type"] == "thinking" { "thinking" } else { "text" };
            if block.is_object() {
                block[field] = json!(text);
            }
            block
        });
        let mut head = self.head.unwrap_or_default();
        head.insert("content".to_owned(), filled.collect());
        Value::Object(head)
    }
}
