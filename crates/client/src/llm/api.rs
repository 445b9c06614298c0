//! Interfaces of endpoints. They differ in path, headers and fields of a request, and in the shape of an answer.

use std::borrow::Cow;

use reqwest::header::{AUTHORIZATION, HeaderName};
use serde::Deserialize;
use serde_json::{Map, Value, json};

/// The interface that an endpoint has for conversations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Api {
    /// Chat completions, as of OpenAI.
    #[default]
    #[value(name = "openai")]
    OpenAi,
    /// Anthropic's messages.
    Anthropic,
}

impl Api {
    /// Path after the address of the endpoint.
    pub(super) const fn path(self) -> &'static str {
        match self {
            Self::OpenAi => "/chat/completions",
            Self::Anthropic => "/messages",
        }
    }

    /// Name of a successful answer.
    pub(super) const fn answer(self) -> &'static str {
        match self {
            Self::OpenAi => "chat completion",
            Self::Anthropic => "message",
        }
    }

    /// Header for the key, and the prefix of its value.
    pub(super) const fn key_header(self) -> (HeaderName, &'static str) {
        match self {
            Self::OpenAi => (AUTHORIZATION, "Bearer "),
            Self::Anthropic => (HeaderName::from_static("x-api-key"), ""),
        }
    }

    /// Version header of each request, if the interface has one.
    pub(super) const fn version_header(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::OpenAi => None,
            Self::Anthropic => Some(("anthropic-version", "2023-06-01")),
        }
    }

    /// Fields of a request with the texts of a question.
    pub(super) fn fields(self, system: Option<&str>, user: &str) -> Map<String, Value> {
        let mut messages = vec![json!({ "role": "user", "content": user })];
        let mut fields = Map::new();
        match (self, system) {
            (_, None) => {}
            (Self::OpenAi, Some(text)) => {
                messages.insert(0, json!({ "role": "system", "content": text }));
            }
            (Self::Anthropic, Some(text)) => {
                fields.insert("system".to_owned(), json!(text));
            }
        }
        fields.insert("messages".to_owned(), json!(messages));
        fields
    }

    /// Converts the body of an answer to a chat completion; `None` for other bodies.
    pub(super) fn completion(self, body: &Value) -> Option<Cow<'_, Value>> {
        match self {
            Self::OpenAi => Some(Cow::Borrowed(body)),
            Self::Anthropic => completion_of_message(body).map(Cow::Owned),
        }
    }
}

/// Converts an Anthropic message to a chat completion.
fn completion_of_message(message: &Value) -> Option<Value> {
    let content = message.get("content")?.as_array()?;
    let calls: Vec<Value> = (content.iter())
        .filter(|part| part["type"].as_str().is_some_and(|kind| kind.ends_with("tool_use")))
        .map(|call| {
            let arguments = call["input"].to_string();
            json!({ "type": "function", "function": { "name": call["name"], "arguments": arguments } })
        })
        .collect();
    let mut answer = json!({ "role": "assistant", "content": content });
    if !calls.is_empty() {
        answer["tool_calls"] = json!(calls);
    }
    let finish_reason = match message["stop_reason"].as_str() {
        Some("end_turn" | "stop_sequence" | "pause_turn") => Some("stop"),
        Some("max_tokens" | "model_context_window_exceeded") => Some("length"),
        Some("tool_use") => Some("tool_calls"),
        other => other,
    };
    let usage = &message["usage"];
    // Tokens read from a cache or written into it are counted separately.
    let read = ["input_tokens", "cache_creation_input_tokens", "cache_read_input_tokens"];
    let counts: Vec<u64> = read.iter().filter_map(|name| usage[*name].as_u64()).collect();
    let read =
        (!counts.is_empty()).then(|| counts.iter().fold(0, |sum: u64, n| sum.saturating_add(*n)));
    Some(json!({
        "choices": [{ "message": answer, "finish_reason": finish_reason }],
        "usage": { "prompt_tokens": read, "completion_tokens": usage["output_tokens"] },
    }))
}
