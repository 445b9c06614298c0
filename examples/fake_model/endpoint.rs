//! The endpoint, for tests too: its answers depend only on the prompt.

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// The routes of the endpoint, `/v1` and all.
pub(crate) fn router() -> Router {
    Router::new()
        .route("/v1/models", get(models))
        .route("/v1/chat/completions", post(complete))
        .fallback(async || {
            refuse(StatusCode::NOT_FOUND, "there are /v1/chat/completions and /v1/models")
        })
}

async fn models() -> Json<Value> {
    Json(
        json!({ "object": "list", "data": [{ "id": "fake", "object": "model", "owned_by": "swarmbench" }] }),
    )
}

async fn complete(Json(request): Json<Value>) -> Response {
    let (Some(model), Some(prompt)) =
        (request["model"].as_str(), request["messages"][0]["content"].as_str())
    else {
        return refuse(StatusCode::BAD_REQUEST, "`model` and one message with a text are needed");
    };
    let answer = decide(prompt);
    let tokens = |text: &str| text.len().div_ceil(4);
    let (asked, said) = (tokens(prompt), tokens(&answer));
    Json(json!({
        "id": "chatcmpl-fake",
        "object": "chat.completion",
        "created": 0,
        "model": model,
        "choices": [{
            "index": 0,
            "message": { "role": "assistant", "content": answer },
            "finish_reason": "stop",
        }],
        "usage": { "prompt_tokens": asked, "completion_tokens": said, "total_tokens": asked + said },
    }))
    .into_response()
}

fn refuse(status: StatusCode, message: &str) -> Response {
    let error = json!({ "error": { "message": message, "type": "invalid_request_error" } });
    (status, Json(error)).into_response()
}

/// An answer to a prompt of the built-in template: lights by the number of the round, which is a clock that all agents
/// share, and anything else by chance that follows from the prompt.
fn decide(prompt: &str) -> String {
    let chance = Sha256::digest(prompt);
    let round = after(prompt, "\nRound: ").and_then(number);
    let light = after(prompt, "\nYour light is ").map(|rest| rest.starts_with("on"));
    let (thought, action) = if let (Some(round), Some(is_on)) = (round, light) {
        let wanted = round.is_multiple_of(2);
        let action = if is_on == wanted { "STAY" } else { "SWITCH" };
        (format!("It is round {round}, and in even rounds all lights come on."), action)
    } else {
        let actions = actions(prompt);
        let drawn = actions.get(usize::from(chance[0]) % actions.len().max(1));
        ("I cannot tell what is best here.".to_owned(), drawn.copied().unwrap_or("STAY"))
    };
    let message = if chance[1] < 64 { format!("\nMSG: I choose {action}") } else { String::new() };
    format!("{thought}\n\nACTION: {action}{message}")
}

/// The names in the list of actions.
fn actions(prompt: &str) -> Vec<&str> {
    let list = after(prompt, "\nActions:\n").unwrap_or_default();
    let names = list.lines().map_while(|line| {
        let (number, rest) = line.split_once(". ")?;
        number.parse::<u32>().ok()?;
        rest.split(':').next()
    });
    names.collect()
}

fn after<'a>(prompt: &'a str, words: &str) -> Option<&'a str> {
    prompt.split_once(words).map(|(_, rest)| rest)
}

fn number(text: &str) -> Option<u32> {
    text.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}
