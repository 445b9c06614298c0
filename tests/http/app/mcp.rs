//! The Model Context Protocol, as its clients speak it.

use serde_json::{Value, json};

use super::{Call, HttpAnswer, TestApp};

/// A request as it is written.
pub(crate) fn request(method: &str, params: &Value) -> Value {
    json!({ "jsonrpc": "2.0", "id": 1, "method": method, "params": params })
}

/// A call of a tool as it is written.
pub(crate) fn tool_call(tool: &str, arguments: &Value) -> Value {
    request("tools/call", &json!({ "name": tool, "arguments": arguments }))
}

/// The result of a request, which is no error of the protocol.
pub(crate) fn result(answer: &HttpAnswer) -> Value {
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "application/json");
    assert_eq!(answer.header("mcp-session-id"), "", "there are no sessions");
    let answer = answer.json();
    assert!(answer["result"].is_object(), "{answer}");
    answer["result"].clone()
}

/// The texts that a model reads.
pub(crate) fn read(result: &Value) -> Vec<String> {
    let blocks = result["content"].as_array().expect("blocks");
    blocks.iter().map(|block| block["text"].as_str().expect("a text").to_owned()).collect()
}

/// The text of an error of a tool.
pub(crate) fn tool_error(result: &Value) -> String {
    assert_eq!(result["isError"], true, "{result}");
    let mut texts = read(result);
    assert_eq!(texts.len(), 1, "{texts:?}");
    texts.remove(0)
}

/// The observation in a structured result of `look`, without what MCP adds.
pub(crate) fn observed(result: &Value) -> Value {
    assert_eq!(result["isError"], false, "{result}");
    let mut seen = result["structuredContent"].clone();
    let next = seen.as_object_mut().expect("an object").remove("next");
    assert_eq!(next.as_ref().and_then(Value::as_str), read(result).last().map(String::as_str));
    seen
}

impl TestApp {
    /// A request of the protocol, without a token.
    pub(crate) fn mcp(&self, body: &Value) -> Call {
        self.post("/mcp").json(body)
    }

    /// The result of a tool, called with a token.
    pub(crate) async fn tool(&self, token: &str, tool: &str, arguments: Value) -> Value {
        result(&self.mcp(&tool_call(tool, &arguments)).token(token).send().await)
    }
}
