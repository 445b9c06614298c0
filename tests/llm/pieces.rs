//! Streams are put together however their bytes are cut, and broken ones are told apart.

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, ModelAnswer, Stop};

use crate::llm::endpoint::{Endpoint, Reply};
use crate::llm::{Bench, question};

/// A stream of unnamed events.
fn stream(events: &[&str]) -> String {
    events.iter().flat_map(|event| ["data: ", event, "\n\n"]).collect()
}

/// The answer of a stream that arrives in pieces of `step` bytes, or the reason why it is none.
async fn read(api: Api, text: &str, step: usize) -> Result<ModelAnswer, String> {
    let reply = Reply::text(200, text.to_owned()).header("content-type", "text/event-stream");
    let endpoint = Endpoint::replies(vec![reply.in_pieces(step)]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.api = api;
    bench.settings.streams = true;
    bench.settings.sampling.max_tokens = Some(64);
    bench.settings.retries = 0;
    match bench.model().answer(&question(0, 0)).await {
        Ok(answer) => Ok(answer),
        Err(Stop::Unreachable { tries: 1, last, .. }) => Err(last),
        Err(stop) => panic!("{stop}"),
    }
}

/// Asserts that a stream has the answer `ACTION: UP` of 10 and 5 tokens, after this reasoning.
async fn check_whole(api: Api, text: &str, step: usize, reasoning: Option<&str>) {
    let answer = read(api, text, step).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.failure), ("ACTION: UP", None), "{step}");
    assert_eq!(answer.reasoning.as_deref(), reasoning);
    let tokens = (answer.usage.prompt_tokens, answer.usage.completion_tokens);
    assert_eq!(tokens, (Some(10), Some(5)));
}

/// Asserts that a stream is broken for a reason with these words, however it is cut.
async fn check_broken(api: Api, text: &str, words: &str) {
    for step in [1, 7, 4096] {
        let said = read(api, text, step).await.expect_err(words);
        assert!(said.starts_with("a stream that ") && said.contains(words), "{words}: {said}");
    }
}

const CHAT: [&str; 6] = [
    r#"{"choices":[{"index":0,"delta":{"role":"assistant","content":""}}]}"#,
    r#"{"choices":[{"delta":{"reasoning":"hm","reasoning_content":"hm"}}],"usage":null}"#,
    r#"{"choices":[{"index":1,"delta":{"content":"no"}},{"index":0,"delta":{"content":"ACTION"}}]}"#,
    r#"{"choices":[{"index":0,"delta":{"content":": UP"},"finish_reason":"stop"}]}"#,
    r#"{"choices":[],"usage":{"prompt_tokens":10,"completion_tokens":5}}"#,
    "[DONE]",
];

#[tokio::test]
async fn chunks_of_a_chat_become_its_completion() {
    for step in [1, 3, 7, 10, 100_000] {
        check_whole(Api::OpenAi, &stream(&CHAT), step, Some("hm")).await;
    }
    // Comments, other line ends, a byte order mark, and an end without [DONE] once nothing is missing.
    let other = stream(&CHAT[..5]).replace('\n', "\r\n");
    check_whole(Api::OpenAi, &format!("\u{feff}: wait\r\n\r\n{other}"), 5, Some("hm")).await;
}

#[tokio::test]
async fn a_chat_without_its_end_is_no_answer() {
    check_broken(Api::OpenAi, "", "before a reason to stop").await;
    for end in 0..3 {
        check_broken(Api::OpenAi, &stream(&CHAT[..end]), "before a reason to stop").await;
        let closed = [&CHAT[..end], &["[DONE]"]].concat();
        check_broken(Api::OpenAi, &stream(&closed), "before a reason to stop").await;
    }
    check_broken(Api::OpenAi, &stream(&CHAT[..4]), "before [DONE]").await;
    let twice: Vec<&str> = CHAT.iter().flat_map(|event| [*event, *event]).collect();
    check_broken(Api::OpenAi, &stream(&twice), "are repeated").await;
    check_broken(Api::OpenAi, &stream(&["nonsense"]), "no JSON object").await;
    let error = json!({ "error": { "message": "upstream", "code": 502 } });
    let told = stream(&[CHAT[0], &error.to_string()]);
    let said = read(Api::OpenAi, &told, 9).await.expect_err("an error");
    assert_eq!(said, "502, upstream");
}

#[tokio::test]
async fn nothing_is_read_without_bounds() {
    let long = format!("data: {}", "x".repeat(2 * 1024 * 1024 + 1));
    let said = read(Api::OpenAi, &long, 4096).await.expect_err("too long");
    assert!(said.contains("an event of more than 2097152 bytes"), "{said}");
    let piece = json!({ "choices": [{ "delta": { "content": "x".repeat(1 << 20) } }] });
    let many = stream(&[&*piece.to_string(); 9]);
    let said = read(Api::OpenAi, &many, 1 << 20).await.expect_err("too much");
    assert!(said.contains("8388608 bytes of text"), "{said}");
    let item = r#"{"type":"response.output_item.done","output_index":1024,"item":{}}"#;
    check_broken(Api::Responses, &stream(&[item]), "without a place").await;
}

const MESSAGE: [&str; 9] = [
    r#"{"type":"message_start","message":{"id":"m","content":[],"stop_reason":null,"usage":{"input_tokens":10,"output_tokens":1}}}"#,
    r#"{"type":"content_block_start","index":0,"content_block":{"type":"thinking","thinking":""}}"#,
    r#"{"type":"content_block_delta","index":0,"delta":{"type":"thinking_delta","thinking":"hm"}}"#,
    r#"{"type":"content_block_stop","index":0}"#,
    r#"{"type":"content_block_start","index":1,"content_block":{"type":"text","text":""}}"#,
    r#"{"type":"content_block_delta","index":1,"delta":{"type":"text_delta","text":"ACTION: UP"}}"#,
    r#"{"type":"content_block_stop","index":1}"#,
    r#"{"type":"message_delta","delta":{"stop_reason":"end_turn"},"usage":{"output_tokens":5}}"#,
    r#"{"type":"message_stop"}"#,
];

#[tokio::test]
async fn events_of_a_message_become_the_message() {
    for step in [1, 7, 11] {
        check_whole(Api::Anthropic, &stream(&MESSAGE), step, Some("hm")).await;
    }
    for end in 1..MESSAGE.len() {
        check_broken(Api::Anthropic, &stream(&MESSAGE[..end]), "before message_stop").await;
    }
    for (at, again) in [(0, 0), (1, 1), (3, 2), (3, 3), (6, 5), (7, 7)] {
        let events = [&MESSAGE[..=at], &MESSAGE[again..=again], &MESSAGE[at + 1..]].concat();
        check_broken(Api::Anthropic, &stream(&events), "repeated").await;
    }
    check_broken(Api::Anthropic, &stream(&MESSAGE[1..]), "message_start").await;
    let cut = [&MESSAGE[..6], &MESSAGE[7..]].concat();
    check_broken(Api::Anthropic, &stream(&cut), "contradict").await;
}

#[tokio::test]
async fn the_last_event_of_a_response_is_the_response() {
    let item = |text: &str| json!({ "type": "message", "content": [{ "type": "output_text", "text": text }] });
    let done = |output: Value| {
        let usage = json!({ "input_tokens": 10, "output_tokens": 5 });
        let response = json!({ "output": output, "usage": usage });
        json!({ "type": "response.completed", "sequence_number": 3, "response": response })
    };
    let events = [
        json!({ "type": "response.output_text.delta", "sequence_number": 1, "delta": "x" }),
        json!({ "type": "response.output_item.done", "sequence_number": 2, "output_index": 0, "item": item("ACTION: UP") }),
        // Numbers that were there already are repetitions.
        json!({ "type": "response.output_item.done", "sequence_number": 2, "output_index": 1, "item": item("no") }),
    ];
    let text = |last: Value| {
        let all: Vec<String> = events.iter().chain([&last]).map(Value::to_string).collect();
        stream(&all.iter().map(String::as_str).collect::<Vec<_>>())
    };
    for output in [json!([item("ACTION: UP")]), json!([])] {
        for step in [1, 7, 13] {
            check_whole(Api::Responses, &text(done(output.clone())), step, None).await;
        }
    }
    check_broken(Api::Responses, &text(json!({})), "before response.completed").await;
    check_broken(Api::Responses, &stream(&["[DONE]"]), "without its last event").await;
    let failed = json!({ "error": { "code": "server_error", "message": "oops" } });
    let failed = json!({ "type": "response.failed", "sequence_number": 9, "response": failed });
    let error = json!({ "type": "error", "sequence_number": 9, "code": "x", "message": "oops" });
    for (last, expected) in [(failed, "500, oops"), (error, "oops")] {
        let said = read(Api::Responses, &text(last), 13).await.expect_err("an error");
        assert_eq!(said, expected);
    }
}
