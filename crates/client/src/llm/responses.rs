//! Answers of the interface `responses`: items of messages, reasoning and calls.

use serde_json::{Value, json};

/// Maximum bytes in JSON of the items that a later request can carry. Reasoning is encrypted and long; of more nothing is kept,
/// as endpoints refuse a part of it.
pub const ITEMS_BYTES_MAX: usize = 256 * 1024;

/// Converts a response to a chat completion; `None` for other bodies, and for a response that has not ended.
pub(super) fn completion(response: &Value) -> Option<Value> {
    let output = response.get("output")?.as_array()?;
    let reason = response["incomplete_details"]["reason"].as_str();
    let finish_reason = match (response["status"].as_str(), reason) {
        (Some("incomplete"), Some("content_filter")) => "content_filter",
        (Some("incomplete"), _) => "length",
        (Some("completed") | None, _) => "stop",
        (Some(_), _) => return None,
    };
    let mut content = Vec::new();
    for item in output {
        match item["type"].as_str() {
            Some("reasoning") => content.extend(thoughts(item)),
            // What a model says before its final answer is not its answer.
            Some("message") if item["phase"] == "commentary" => {
                let said = text_of(&item["content"]);
                content.extend(said.map(|text| json!({ "type": "reasoning", "text": text })));
            }
            Some("message") => {
                if content.iter().any(|part: &Value| part["type"] == "output_text") {
                    // A marker begins a line of its own.
                    content.push(json!({ "type": "output_text", "text": "\n" }));
                }
                content.extend(item["content"].as_array().into_iter().flatten().cloned());
            }
            _ => {}
        }
    }
    let is_call = |item: &&Value| item["type"].as_str().is_some_and(|kind| kind.ends_with("_call"));
    let calls: Vec<Value> = (output.iter().filter(is_call))
        .map(|call| json!({ "function": { "name": call["name"], "arguments": call["arguments"] } }))
        .collect();
    let mut message = json!({ "role": "assistant", "content": content });
    if !calls.is_empty() {
        message["tool_calls"] = json!(calls);
    }
    Some(json!({
        "choices": [{ "message": message, "finish_reason": finish_reason }],
        "usage": response["usage"],
    }))
}

/// The reasoning of an item, or else its summary.
fn thoughts(item: &Value) -> Option<Value> {
    let text = text_of(&item["content"]).or_else(|| text_of(&item["summary"]))?;
    Some(json!({ "type": "reasoning", "text": text }))
}

/// The texts of parts, a paragraph each; `None` without any.
fn text_of(parts: &Value) -> Option<String> {
    let texts: Vec<&str> =
        parts.as_array()?.iter().filter_map(|part| part["text"].as_str()).collect();
    Some(texts.join("\n\n")).filter(|text| !text.is_empty())
}

/// The items of a response that a later request can carry: messages, and reasoning that is encrypted. They have the form of
/// input: ids are left out, as the endpoint keeps nothing that they could name. Empty if there is no such reasoning, or too
/// much.
pub(super) fn items(response: &Value) -> Vec<Value> {
    let Some(output) = response["output"].as_array() else { return Vec::new() };
    if !output.iter().any(|item| item["encrypted_content"].is_string()) {
        return Vec::new();
    }
    let items: Vec<Value> = output.iter().filter_map(input_item).collect();
    let bytes = serde_json::to_vec(&items).map_or(usize::MAX, |text| text.len());
    if bytes <= ITEMS_BYTES_MAX { items } else { Vec::new() }
}

/// The form of an output item in an input. Only known texts are taken, so that no endpoint decides how deep a cassette nests.
fn input_item(item: &Value) -> Option<Value> {
    let parts = |name: &str, part: fn(&Value) -> Option<Value>| -> Vec<Value> {
        item[name].as_array().into_iter().flatten().filter_map(part).collect()
    };
    match item["type"].as_str()? {
        "reasoning" => {
            let encrypted = item["encrypted_content"].as_str()?;
            let summary = parts("summary", |part| {
                Some(json!({ "type": "summary_text", "text": part["text"].as_str()? }))
            });
            Some(json!({ "type": "reasoning", "summary": summary, "encrypted_content": encrypted }))
        }
        "message" => {
            let content = parts("content", |part| match part["type"].as_str()? {
                kind @ "output_text" => {
                    Some(json!({ "type": kind, "text": part["text"].as_str()? }))
                }
                kind @ "refusal" => {
                    Some(json!({ "type": kind, "refusal": part["refusal"].as_str()? }))
                }
                _ => None,
            });
            let mut message = json!({ "type": "message", "role": "assistant", "content": content });
            if let Some(phase) = item["phase"].as_str() {
                message["phase"] = json!(phase);
            }
            Some(message)
        }
        _ => None,
    }
}
