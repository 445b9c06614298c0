//! Messages, reduced to the parts that the tools need. The library parses a message into trees of values, which take up
//! to eighty times as much memory: unused parts are removed before, and the rest is kept as it was written.

use bytes::Bytes;
use http::header::CONTENT_TYPE;
use http::{HeaderValue, Response, StatusCode};
use rmcp::model::ClientJsonRpcMessage;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use serde_json::json;
use serde_json::value::RawValue;
use swarmbench_protocol::carried::count_values;

use crate::MCP_VALUES_MAX;

/// The codes of JSON-RPC for bodies that are not JSON, and for JSON that is not a request.
const PARSE_ERROR: i32 = -32700;
const INVALID_REQUEST: i32 = -32600;

/// Maximum size in bytes of each part of a request that describes the client; a larger part is removed.
const ABOUT_CLIENT_BYTES_MAX: usize = 4096;

/// Maximum size in bytes of the id of a request, which is kept until the answer.
const ID_BYTES_MAX: usize = 200;

#[serde_with::skip_serializing_none]
#[derive(Deserialize, Serialize)]
struct Message<'a> {
    #[serde(borrow)]
    jsonrpc: Option<&'a RawValue>,
    id: Option<&'a RawValue>,
    method: Option<&'a RawValue>,
    params: Option<Params<'a>>,
    result: Option<&'a RawValue>,
    error: Option<&'a RawValue>,
}

#[serde_with::skip_serializing_none]
#[derive(Deserialize, Serialize)]
struct Params<'a> {
    #[serde(borrow)]
    name: Option<&'a RawValue>,
    arguments: Option<&'a RawValue>,
    uri: Option<&'a RawValue>,
    cursor: Option<&'a RawValue>,
    #[serde(rename = "protocolVersion")]
    version: Option<&'a RawValue>,
    capabilities: Option<&'a RawValue>,
    #[serde(rename = "clientInfo")]
    client: Option<&'a RawValue>,
    #[serde(rename = "requestId")]
    request: Option<&'a RawValue>,
    #[serde(rename = "_meta")]
    meta: Option<Meta<'a>>,
}

/// The description of the client, which each request carries because there are no sessions.
#[serde_with::skip_serializing_none]
#[derive(Deserialize, Serialize)]
struct Meta<'a> {
    #[serde(borrow, rename = "io.modelcontextprotocol/protocolVersion")]
    version: Option<&'a RawValue>,
    #[serde(rename = "io.modelcontextprotocol/clientInfo")]
    client: Option<&'a RawValue>,
    #[serde(rename = "io.modelcontextprotocol/clientCapabilities")]
    capabilities: Option<&'a RawValue>,
}

/// Reduces a message to the parts that are needed, with at most [`MCP_VALUES_MAX`] values.
///
/// # Errors
/// The response to a body that is not a message, or that has too many values or a long id.
pub fn essential(body: &[u8]) -> Result<Bytes, Box<Response<Bytes>>> {
    let is_none = |error: serde_json::Error| {
        if serde_json::from_slice::<IgnoredAny>(body).is_ok() {
            refused(INVALID_REQUEST, &format!("the body is no message of MCP: {error}"))
        } else {
            refused(PARSE_ERROR, &format!("the body is not JSON: {error}"))
        }
    };
    let mut message: Message<'_> = serde_json::from_slice(body).map_err(is_none)?;
    if message.id.is_some_and(|id| id.get().len() > ID_BYTES_MAX) {
        let problem = format!("the id has more than {ID_BYTES_MAX} bytes");
        return Err(refused(INVALID_REQUEST, &problem));
    }
    if let Some(meta) = message.params.as_mut().and_then(|params| params.meta.as_mut()) {
        let short = |part: &mut Option<&RawValue>| {
            *part = part.filter(|part| part.get().len() <= ABOUT_CLIENT_BYTES_MAX);
        };
        [&mut meta.version, &mut meta.client, &mut meta.capabilities].into_iter().for_each(short);
    }
    let message = serde_json::to_vec(&message).map_err(is_none)?;
    let values = count_values(&message);
    if values > MCP_VALUES_MAX {
        let problem =
            format!("the message has {values} values, more than {MCP_VALUES_MAX} (mcp_values_max)");
        return Err(refused(INVALID_REQUEST, &problem));
    }
    serde_json::from_slice::<ClientJsonRpcMessage>(&message).map_err(is_none)?;
    Ok(message.into())
}

fn refused(code: i32, message: &str) -> Box<Response<Bytes>> {
    let body =
        json!({ "jsonrpc": "2.0", "id": null, "error": { "code": code, "message": message } });
    let mut response = Response::new(Bytes::from(body.to_string()));
    *response.status_mut() = StatusCode::BAD_REQUEST;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("application/json"));
    Box::new(response)
}

#[cfg(test)]
mod tests {
    use allocation_counter::measure;

    use super::*;

    #[test]
    fn what_nobody_reads_is_left_out_and_takes_no_memory() {
        let much = format!("[{}]", vec![r#"{"":0}"#; 18_000].join(","));
        let look = |more: &str| {
            format!(
                r#"{{"jsonrpc":"2.0","id":1,"method":"tools/call","params":{{"name":"look"{more}}}}}"#
            )
        };
        let client = "io.modelcontextprotocol/clientInfo";
        for (sent, left) in [
            (format!(r#","_meta":{{"x":{much},"progressToken":1}}"#), r#","_meta":{}"#),
            (format!(r#","task":{much},"_meta":{{"{client}":{much}}}"#), r#","_meta":{}"#),
            (
                format!(r#","_meta":{{"{client}":{{"name":"a"}}}}"#),
                r#","_meta":{"io.modelcontextprotocol/clientInfo":{"name":"a"}}"#,
            ),
        ] {
            let sent = look(&sent);
            let mut read = None;
            let counted = measure(|| read = essential(sent.as_bytes()).ok());
            assert_eq!(read.as_deref(), Some(look(left).as_bytes()));
            assert!(counted.bytes_max < 16 * 1024, "{counted:?} for {} bytes", sent.len());
        }
        let id = |bytes: usize| {
            look("").replace("\"id\":1", &format!("\"id\":\"{}\"", "x".repeat(bytes - 2)))
        };
        assert!(essential(id(ID_BYTES_MAX).as_bytes()).is_ok());
        assert!(essential(id(ID_BYTES_MAX + 1).as_bytes()).is_err());
        let sent = look(&format!(r#","arguments":{much}"#));
        let counted = measure(|| assert!(essential(sent.as_bytes()).is_err()));
        assert!(counted.bytes_max < 3 * sent.len() as u64, "{counted:?} for {} bytes", sent.len());
    }
}
