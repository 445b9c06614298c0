//! Other headers, other interfaces, and endpoints that answer in a way that is not read.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, ApiKey, Failure, Headers, Stop};

use crate::llm::endpoint::{Endpoint, Reply};
use crate::llm::{Bench, KEY, VARIABLE, question, stop_of};

/// A message of Anthropic.
fn message(content: &Value, stop_reason: &str) -> Reply {
    let usage = json!({
        "input_tokens": 10, "cache_creation_input_tokens": 3, "cache_read_input_tokens": 4, "output_tokens": 5,
    });
    let body = json!({
        "id": "msg_1", "type": "message", "role": "assistant", "model": "swarm-1", "content": content,
        "stop_reason": stop_reason, "stop_sequence": null, "usage": usage,
    });
    Reply::json(200, &body)
}

fn text(text: &str) -> Value {
    json!([{ "type": "text", "text": text }])
}

/// A bench that asks in Anthropic's way.
fn anthropic(endpoint: &Endpoint) -> Bench {
    let mut bench = Bench::new(endpoint);
    bench.settings.api = Api::Anthropic;
    bench.settings.sampling.max_tokens = Some(64);
    bench
}

#[tokio::test]
async fn messages_of_anthropic_are_asked_for_as_they_have_to_be() {
    let endpoint = Endpoint::replies(vec![message(&text("ACTION: UP"), "end_turn")]).await;
    let mut bench = anthropic(&endpoint);
    bench.settings.sampling.temperature = Some(0.5);
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.failure), ("ACTION: UP", None));
    assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), (Some(17), Some(5)));
    assert_eq!(bench.allowance.spent(), 22);
    let seen = &endpoint.seen()[0];
    assert_eq!(seen.uri.path(), "/v1/messages");
    assert_eq!(seen.headers["x-api-key"], KEY);
    assert_eq!(seen.headers["anthropic-version"], "2023-06-01");
    assert!(!seen.headers.contains_key("authorization"));
    let expected = json!({
        "model": "swarm-1", "max_tokens": 64, "temperature": 0.5,
        "messages": [{ "role": "user", "content": question(0, 0).prompt }],
    });
    assert_eq!(seen.body, expected);
}

#[tokio::test]
async fn the_ends_of_messages_are_those_of_chats() {
    let thinking = json!([
        { "type": "thinking", "thinking": "Hm.", "signature": "x" },
        { "type": "redacted_thinking", "data": "y" },
        { "type": "text", "text": "ACTION: " },
        { "type": "text", "text": "UP" },
    ]);
    for (reply, response, failure, reasoning) in [
        (message(&thinking, "end_turn"), "ACTION: UP", None, Some("Hm.")),
        (message(&text("ACTION: UP"), "stop_sequence"), "ACTION: UP", None, None),
        (message(&text("I thi"), "max_tokens"), "I thi", Some(Failure::Truncated), None),
        (message(&text("No."), "refusal"), "No.", Some(Failure::Refusal), None),
        (message(&json!([]), "end_turn"), "", Some(Failure::Empty), None),
    ] {
        let endpoint = Endpoint::replies(vec![reply]).await;
        let answer = anthropic(&endpoint).model().answer(&question(0, 0)).await.expect("an answer");
        assert_eq!((answer.response.as_str(), answer.failure), (response, failure));
        assert_eq!(answer.reasoning.as_deref(), reasoning);
        assert_eq!(endpoint.seen().len(), 1);
    }
}

#[tokio::test]
async fn errors_of_anthropic_are_told_apart() {
    let error = |status, kind: &str, message: &str| {
        let error = json!({ "type": kind, "message": message });
        Reply::json(status, &json!({ "type": "error", "error": error }))
    };
    let overloaded = error(529, "overloaded_error", "Overloaded");
    let good = || message(&text("ACTION: UP"), "end_turn");
    let endpoint = Endpoint::replies(vec![overloaded, Reply::says("a chat"), good()]).await;
    let bench = anthropic(&endpoint);
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 2));
    let troubles = model.spent().troubles;
    assert_eq!((troubles.load, troubles.unreadable), (1, 1));
    for (status, kind, said, words) in [
        (401, "authentication_error", "invalid x-api-key", "asks for a good key (401)"),
        (404, "not_found_error", "model: swarm-1", "/v1/models lists the models"),
        (400, "invalid_request_error", "Your credit balance is too low", "no credit left"),
        (400, "invalid_request_error", "temperature: too large", "another --temperature"),
    ] {
        let endpoint = Endpoint::start(move |_, _| error(status, kind, said)).await;
        let stop = stop_of(&anthropic(&endpoint).model()).await.to_string();
        assert!(stop.contains(words), "{stop}");
    }
    let mut bench = anthropic(&endpoint);
    bench.settings.sampling.max_tokens = None;
    let stop = bench.try_model().expect_err("a limit is needed").to_string();
    assert!(stop.contains("--max-tokens 4096"), "{stop}");
}

#[tokio::test]
async fn headers_are_sent_and_their_secrets_are_shown_nowhere() {
    const SECRET: &str = "azure-0123456789abcdef";
    let endpoint = Endpoint::start(|number, seen| {
        let shown = seen.headers["api-key"].to_str().expect("a text").to_owned();
        match number {
            0 => Reply::error(500, &shown),
            1 => Reply::says(&format!("{shown} ACTION: UP")),
            _ => Reply::error(401, &shown),
        }
    })
    .await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.key = ApiKey::new(VARIABLE, None);
    let headers = [("api-key", "$AZURE"), ("x-title", "swarms")];
    let headers: BTreeMap<_, _> =
        headers.into_iter().map(|(name, value)| (name.to_owned(), value.to_owned())).collect();
    let lookup = |name: &str| (name == "AZURE").then(|| SECRET.to_owned());
    bench.settings.headers = Headers::parse(&headers, lookup).expect("good headers");
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(answer.response, "[key] ACTION: UP");
    let seen = &endpoint.seen()[0];
    assert_eq!(
        (&seen.headers["api-key"], &seen.headers["x-title"]),
        (&SECRET.parse().expect("a header"), &"swarms".parse().expect("a header"))
    );
    assert!(!seen.headers.contains_key("authorization"));
    let stop = stop_of(&model).await;
    let text = format!("{stop} {stop:?} {:?} {:?}", bench.settings, model.trouble());
    assert!(text.contains("refuses the key in AZURE") && text.contains("[key]"), "{text}");
    assert!(!text.contains(SECRET), "{text}");
    // A secret in the body would be on cassettes.
    bench.settings.extra.insert("user".to_owned(), json!(SECRET));
    let stop = bench.try_model().expect_err("it would be recorded").to_string();
    assert!(stop.contains("AZURE") && !stop.contains(SECRET), "{stop}");
}

#[tokio::test]
async fn an_endpoint_that_only_streams_is_named_after_one_question() {
    let event = "data: {\"choices\":[{\"delta\":{\"content\":\"ACTION: UP\"}}]}\n\n";
    let stream = |kind: &str| Reply::text(200, event).header("content-type", kind);
    for (reply, said) in [
        (stream("text/event-stream; charset=utf-8"), ""),
        (stream("text/event-stream").stalling(), ""),
        (stream("text/plain"), ""),
        (Reply::error(400, "This model only supports stream=true"), "It said: This model only"),
        (Reply::error(422, "Stream must be set to True"), "It said: Stream must"),
    ] {
        let endpoint = Endpoint::replies(vec![reply]).await;
        let stop = stop_of(&Bench::new(&endpoint).model()).await;
        assert!(matches!(stop, Stop::OnlyStreams { .. }), "{stop:?}");
        let text = stop.to_string();
        assert!(text.contains("stream of events only") && text.contains(said), "{text}");
        assert_eq!(endpoint.seen().len(), 1);
    }
    // A further field of the user's is another matter.
    let words = "stream_options is only allowed when stream is true";
    let endpoint = Endpoint::start(move |_, _| Reply::error(400, words)).await;
    let stop = stop_of(&Bench::new(&endpoint).model()).await;
    assert!(matches!(stop, Stop::BadRequest { .. }), "{stop:?}");
}
