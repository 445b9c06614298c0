//! Interfaces of endpoints. They differ in path, headers and fields of a request, and in the shape of an answer.

use std::borrow::Cow;

use clap::ValueEnum;
use reqwest::header::{AUTHORIZATION, HeaderName};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::settings::Sampling;

/// The interface that an endpoint has for conversations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Api {
    /// Chat completions, as of OpenAI.
    #[default]
    #[value(name = "openai")]
    OpenAi,
    /// OpenAI's responses, as in the Open Responses document.
    Responses,
    /// Anthropic's messages.
    Anthropic,
}

impl Api {
    /// Name of the interface on the command line and in files.
    pub(super) fn name(self) -> String {
        let value = self.to_possible_value().expect("each interface can be named");
        value.get_name().to_owned()
    }

    /// Path after the address of the endpoint.
    pub(super) const fn path(self) -> &'static str {
        match self {
            Self::OpenAi => "/chat/completions",
            Self::Responses => "/responses",
            Self::Anthropic => "/messages",
        }
    }

    /// Name of a successful answer.
    pub(super) const fn answer(self) -> &'static str {
        match self {
            Self::OpenAi => "chat completion",
            Self::Responses => "response",
            Self::Anthropic => "message",
        }
    }

    /// Header for the key, and the prefix of its value.
    pub(super) const fn key_header(self) -> (HeaderName, &'static str) {
        match self {
            Self::OpenAi | Self::Responses => (AUTHORIZATION, "Bearer "),
            Self::Anthropic => (HeaderName::from_static("x-api-key"), ""),
        }
    }

    /// Version header of each request, if the interface has one.
    pub(super) const fn version_header(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::OpenAi | Self::Responses => None,
            Self::Anthropic => Some(("anthropic-version", "2023-06-01")),
        }
    }

    /// Fields of all requests with these sampling parameters.
    ///
    /// # Errors
    /// A parameter that the interface does not have, or that contradicts another one, and what to do.
    pub(crate) fn sampling(self, sampling: &Sampling) -> Result<Map<String, Value>, String> {
        let Sampling { temperature, top_p, max_tokens, max_completion_tokens, seed, .. } = sampling;
        let Sampling { effort, thinking_budget, reasoning_summary, .. } = sampling;
        if max_tokens.is_some() && max_completion_tokens.is_some() {
            return Err(
                "max_tokens and max_completion_tokens are one limit: give one of them".to_owned()
            );
        }
        let limit = max_tokens.or(*max_completion_tokens);
        if thinking_budget.is_some() && self != Self::Anthropic {
            return Err(format!(
                "a thinking budget is an option of api anthropic: with {} name an effort, or the field of the endpoint \
                 with --extra",
                self.name()
            ));
        }
        if let (Some(budget), Some(limit)) = (thinking_budget, limit)
            && *budget >= limit
        {
            return Err(format!(
                "the thinking budget of {budget} tokens must be less than the {limit} of the whole answer"
            ));
        }
        if reasoning_summary.is_some() && self != Self::Responses {
            return Err(format!(
                "summaries of the reasoning are an option of api responses, and {} has none: leave them out",
                self.name()
            ));
        }
        let mut fields = Map::new();
        let mut set = |name: &str, value: Option<Value>| {
            fields.extend(value.map(|value| (name.to_owned(), value)));
        };
        set("temperature", temperature.map(|value| json!(value)));
        set("top_p", top_p.map(|value| json!(value)));
        set("seed", seed.map(|value| json!(value)));
        match self {
            Self::OpenAi => {
                set("max_tokens", max_tokens.map(|tokens| json!(tokens)));
                let tokens = max_completion_tokens.map(|tokens| json!(tokens));
                set("max_completion_tokens", tokens);
                set("reasoning_effort", effort.as_ref().map(|effort| json!(effort)));
            }
            Self::Responses => {
                set("max_output_tokens", limit.map(|tokens| json!(tokens)));
                let parts = [("effort", effort), ("summary", reasoning_summary)];
                let parts: Map<_, _> = (parts.into_iter())
                    .filter_map(|(name, value)| Some((name.to_owned(), json!(value.as_ref()?))))
                    .collect();
                set("reasoning", (!parts.is_empty()).then(|| json!(parts)));
            }
            Self::Anthropic => {
                set("max_tokens", limit.map(|tokens| json!(tokens)));
                set("output_config", effort.as_ref().map(|effort| json!({ "effort": effort })));
                let thinking = |budget| json!({ "type": "enabled", "budget_tokens": budget });
                set("thinking", thinking_budget.map(thinking));
            }
        }
        Ok(fields)
    }

    /// Fields of a request for a stream. `counts_tokens` asks for the usage, which chat completions else leave out.
    pub(super) fn stream(self, counts_tokens: bool) -> Map<String, Value> {
        let mut fields = Map::from_iter([("stream".to_owned(), json!(true))]);
        if self == Self::OpenAi && counts_tokens {
            fields.insert("stream_options".to_owned(), json!({ "include_usage": true }));
        }
        fields
    }

    /// Field of a request for an answer that follows a JSON schema.
    pub(super) fn schema(self, schema: &Value) -> (String, Value) {
        let (name, value) = match self {
            Self::OpenAi => {
                let named = json!({ "name": "act", "strict": true, "schema": schema });
                ("response_format", json!({ "type": "json_schema", "json_schema": named }))
            }
            Self::Responses => {
                let format = json!({ "type": "json_schema", "name": "act", "strict": true, "schema": schema });
                ("text", json!({ "format": format }))
            }
            Self::Anthropic => {
                let format = json!({ "type": "json_schema", "schema": schema });
                ("output_config", json!({ "format": format }))
            }
        };
        (name.to_owned(), value)
    }

    /// Fields of a request with the texts of a question. `items` come before the prompt: messages, and for responses also items
    /// of earlier answers.
    pub(super) fn fields(
        self,
        system: Option<&str>,
        user: &str,
        items: &[Value],
    ) -> Map<String, Value> {
        let mut messages = items.to_vec();
        messages.push(json!({ "role": "user", "content": user }));
        let mut fields = Map::new();
        match (self, system) {
            (_, None) => {}
            (Self::OpenAi, Some(text)) => {
                messages.insert(0, json!({ "role": "system", "content": text }));
            }
            (Self::Responses, Some(text)) => {
                fields.insert("instructions".to_owned(), json!(text));
            }
            (Self::Anthropic, Some(text)) => {
                fields.insert("system".to_owned(), json!(text));
            }
        }
        if self == Self::Responses {
            for message in messages.iter_mut().filter(|item| item.get("type").is_none()) {
                message["type"] = json!("message");
            }
            fields.insert("input".to_owned(), json!(messages));
        } else {
            fields.insert("messages".to_owned(), json!(messages));
        }
        fields
    }

    /// Converts the body of an answer to a chat completion; `None` for other bodies.
    pub(super) fn completion(self, body: &Value) -> Option<Cow<'_, Value>> {
        match self {
            Self::OpenAi => Some(Cow::Borrowed(body)),
            Self::Responses => super::responses::completion(body).map(Cow::Owned),
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
    Some(json!({
        "choices": [{ "message": answer, "finish_reason": finish_reason }],
        "usage": super::usage::of_message(&message["usage"]),
    }))
}
