//! The interface `responses`, at an endpoint that is made from the Open Responses document: it takes only what the document
//! allows, and all that it says is as the document has it.

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, Cassette, Failure, ModelAnswer};

use crate::llm::endpoint::{Endpoint, Reply, Seen};
use crate::llm::schema::{check, filled};
use crate::llm::{Bench, KEY, question};

fn usage() -> Value {
    filled("Usage", &json!({ "input_tokens": 10, "output_tokens": 5, "total_tokens": 15 }))
}

pub(crate) fn message(text: &str) -> Value {
    let part = filled("OutputText", &json!({ "text": text }));
    filled("Message", &json!({ "id": "msg_1", "content": [part] }))
}

/// A response of 10 and 5 tokens with these items.
pub(crate) fn response(output: &Value, with: &Value) -> Value {
    let mut fields =
        json!({ "id": "resp_1", "model": "swarm-1", "output": output, "usage": usage() });
    fields.as_object_mut().expect("an object").extend(with.as_object().expect("fields").clone());
    filled("ResponseResource", &fields)
}

/// The events of a streamed response with a summary, `hm`, and this text.
pub(crate) fn response_stream(text: &str, finish: &str) -> Vec<Value> {
    let reasoning = json!({
        "type": "reasoning", "id": "rs_1", "summary": [{ "type": "summary_text", "text": "hm" }],
    });
    let items = json!([reasoning, message(text)]);
    let (end, with) = match finish {
        "length" => (
            "response.incomplete",
            json!({ "status": "incomplete", "incomplete_details": { "reason": "max_output_tokens" } }),
        ),
        _ => ("response.completed", json!({})),
    };
    let empty = response(&json!([]), &json!({ "status": "in_progress", "usage": null }));
    let mut events = vec![
        json!({ "type": "response.created", "response": empty }),
        json!({ "type": "response.in_progress", "response": empty }),
        json!({ "type": "response.output_item.done", "output_index": 0, "item": reasoning }),
    ];
    for delta in [&text[..2], &text[2..]] {
        events.push(json!({
            "type": "response.output_text.delta", "item_id": "msg_1", "output_index": 1, "content_index": 0,
            "delta": delta,
        }));
    }
    events
        .push(json!({ "type": "response.output_item.done", "output_index": 1, "item": items[1] }));
    events.push(json!({ "type": end, "response": response(&items, &with) }));
    for (number, event) in events.iter_mut().enumerate() {
        event["sequence_number"] = json!(number);
        check("Event", event);
    }
    events
}

/// An endpoint that refuses what the document does not allow, and answers with a response.
async fn endpoint(response: Value) -> Endpoint {
    check("ResponseResource", &response);
    Endpoint::start(move |_, Seen { uri, headers, body }| {
        assert_eq!(uri.path(), "/v1/responses");
        assert_eq!(headers["authorization"], format!("Bearer {KEY}"));
        check("CreateResponseBody", body);
        Reply::json(200, &response)
    })
    .await
}

fn bench(endpoint: &Endpoint) -> Bench {
    let mut bench = Bench::new(endpoint);
    bench.settings.api = Api::Responses;
    bench
}

async fn read(output: Value, with: Value) -> ModelAnswer {
    let endpoint = endpoint(response(&output, &with)).await;
    let answer = bench(&endpoint).model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(endpoint.seen().len(), 1);
    answer
}

#[tokio::test]
async fn a_question_has_the_fields_of_the_document() {
    let endpoint = endpoint(response(&json!([message("ACTION: UP")]), &json!({}))).await;
    let mut bench = bench(&endpoint);
    let sampling = &mut bench.settings.sampling;
    (sampling.temperature, sampling.top_p) = (Some(0.5), Some(0.9));
    sampling.max_completion_tokens = Some(4096);
    (sampling.effort, sampling.reasoning_summary) =
        (Some("low".to_owned()), Some("auto".to_owned()));
    bench.settings.extra.insert("service_tier".to_owned(), json!("flex"));
    let mut asked = question(3, 7);
    asked.system = Some("You are one of several agents.".to_owned());
    let answer = bench.model().answer(&asked).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.failure), ("ACTION: UP", None));
    assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), (Some(10), Some(5)));
    assert_eq!(bench.allowance.spent(), 15);
    let expected = json!({
        "model": "swarm-1", "instructions": "You are one of several agents.",
        "input": [{ "type": "message", "role": "user", "content": asked.prompt }],
        "temperature": 0.5, "top_p": 0.9, "max_output_tokens": 4096,
        "reasoning": { "effort": "low", "summary": "auto" }, "store": false, "service_tier": "flex",
    });
    assert_eq!(endpoint.seen()[0].body, expected);
    // The endpoint does look.
    let unknown = json!({ "model": "m", "max_tokens": 5 });
    assert!(std::panic::catch_unwind(|| check("CreateResponseBody", &unknown)).is_err());
}

#[tokio::test]
async fn items_become_an_answer() {
    let summary = json!([{ "type": "summary_text", "text": "First." }, { "type": "summary_text", "text": "Then." }]);
    let reasoning = |more: Value| {
        let mut item = json!({ "type": "reasoning", "id": "rs_1", "summary": summary });
        item.as_object_mut().expect("an object").extend(more.as_object().expect("fields").clone());
        item
    };
    let text = json!([{ "type": "reasoning_text", "text": "All of it." }]);
    let refused = json!([{ "type": "refusal", "refusal": "I won't.\nACTION: UP" }]);
    let refusal = filled("Message", &json!({ "content": refused }));
    let mut aside = message("I could go UP.\nACTION: UP");
    aside["phase"] = json!("commentary");
    let call = filled("FunctionCall", &json!({ "name": "go" }));
    let cut = |reason: &str| json!({ "status": "incomplete", "incomplete_details": { "reason": reason } });
    for (output, with, response, failure, thoughts) in [
        (
            json!([reasoning(json!({})), message("ACTION: UP")]),
            json!({}),
            "ACTION: UP",
            None,
            Some("First.\n\nThen."),
        ),
        (
            json!([reasoning(json!({ "content": text })), message("ACTION: UP")]),
            json!({}),
            "ACTION: UP",
            None,
            Some("All of it."),
        ),
        (
            json!([message("I look."), message("ACTION: UP")]),
            json!({}),
            "I look.\nACTION: UP",
            None,
            None,
        ),
        (
            json!([aside, message("ACTION: DOWN")]),
            json!({}),
            "ACTION: DOWN",
            None,
            Some("I could go UP.\nACTION: UP"),
        ),
        (
            json!([refusal]),
            json!({}),
            "",
            Some(Failure::Refusal),
            Some("[refusal] I won't.\nACTION: UP"),
        ),
        (
            json!([message("I thi")]),
            cut("max_output_tokens"),
            "I thi",
            Some(Failure::Truncated),
            None,
        ),
        (
            json!([reasoning(json!({}))]),
            cut("max_output_tokens"),
            "",
            Some(Failure::Truncated),
            Some("First.\n\nThen."),
        ),
        (json!([]), cut("content_filter"), "", Some(Failure::ContentFilter), None),
        (json!([call]), json!({}), "", Some(Failure::ToolCall), None),
        (
            json!([reasoning(json!({}))]),
            json!({}),
            "",
            Some(Failure::ReasoningOnly),
            Some("First.\n\nThen."),
        ),
        (json!([]), json!({}), "", Some(Failure::Empty), None),
    ] {
        let answer = read(output.clone(), with).await;
        assert_eq!((answer.response.as_str(), answer.failure), (response, failure), "{output}");
        assert_eq!(answer.reasoning.as_deref(), thoughts, "{output}");
        assert_eq!(answer.items, Vec::<Value>::new(), "nobody asked for them");
    }
}

#[tokio::test]
async fn a_response_that_failed_or_goes_on_is_asked_for_again() {
    let failed = |code: &str| {
        let error = json!({ "code": code, "message": "no" });
        response(&json!([]), &json!({ "status": "failed", "error": error, "usage": null }))
    };
    let going_on = response(&json!([]), &json!({ "status": "in_progress", "usage": null }));
    let good = response(&json!([message("ACTION: UP")]), &json!({}));
    let replies = [failed("rate_limit_exceeded"), failed("server_error"), going_on, good];
    let endpoint =
        Endpoint::replies(replies.iter().map(|body| Reply::json(200, body)).collect()).await;
    let model = bench(&endpoint).model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 3));
    let troubles = model.spent().troubles;
    assert_eq!((troubles.load, troubles.server, troubles.unreadable), (1, 1, 1));
}

/// The next request carries what the model has thought, and the endpoint has to keep nothing.
#[tokio::test]
async fn encrypted_reasoning_is_carried_where_it_is_asked_for() {
    let mut reasoning =
        json!({ "type": "reasoning", "id": "rs_1", "summary": [], "encrypted_content": "gAAAA" });
    let output = json!([reasoning, message("ACTION: UP")]);
    let endpoint = endpoint(response(&output, &json!({}))).await;
    let mut bench = bench(&endpoint);
    bench.settings.carries_reasoning = true;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let model = bench.model_on(Some(&Cassette::record(&path).expect("a cassette")));
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    reasoning.as_object_mut().expect("an object").remove("id");
    let said = json!({ "type": "message", "role": "assistant", "content": [{ "type": "output_text", "text": "ACTION: UP" }] });
    assert_eq!(answer.items, [reasoning, said]);
    let mut next = question(0, 1);
    let before = json!({ "type": "message", "role": "user", "content": question(0, 0).prompt });
    next.items = [before].into_iter().chain(answer.items.clone()).collect();
    let second = model.answer(&next).await.expect("an answer");
    let seen = endpoint.seen();
    assert_eq!(seen[0].body["include"], json!(["reasoning.encrypted_content"]));
    let input = seen[1].body["input"].as_array().expect("a list");
    assert_eq!(input[..3], next.items);
    assert_eq!(input[3]["content"], next.prompt);
    // A cassette tells questions with other items apart, and has the items of answers.
    drop(model);
    let replay = bench.model_on(Some(&Cassette::replay(&path).expect("a cassette")));
    assert_eq!(replay.answer(&next).await.expect("it was recorded"), second);
    next.items.pop();
    replay.answer(&next).await.expect_err("it was not recorded");
    // More than what can be carried is not carried in part.
    let long = json!([{ "type": "reasoning", "id": "rs_1", "summary": [], "encrypted_content": "x".repeat(300_000) }]);
    let endpoint = self::endpoint(response(&long, &json!({}))).await;
    bench.settings.api_base = endpoint.base().to_owned();
    let answer = bench.model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(answer.items, Vec::<Value>::new());
}

/// What a later request would carry is on cassettes, too.
#[tokio::test]
async fn items_that_show_the_key_are_not_carried() {
    for (text, encrypted) in [(KEY, "gAAAA"), ("ACTION: UP", KEY)] {
        let reasoning = json!({ "type": "reasoning", "id": "rs_1", "summary": [], "encrypted_content": encrypted });
        let output = json!([reasoning, message(&format!("{text}, I say"))]);
        let endpoint = endpoint(response(&output, &json!({}))).await;
        let mut bench = bench(&endpoint);
        bench.settings.carries_reasoning = true;
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cassette.jsonl");
        let model = bench.model_on(Some(&Cassette::record(&path).expect("a cassette")));
        let answer = model.answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(answer.items, Vec::<Value>::new());
        assert!(!std::fs::read_to_string(&path).expect("a file").contains(KEY));
    }
}

#[tokio::test]
async fn an_endpoint_keeps_a_response_only_where_the_user_says_so() {
    for store in [true, false] {
        let endpoint = endpoint(response(&json!([message("ACTION: UP")]), &json!({}))).await;
        let mut bench = bench(&endpoint);
        bench.settings.extra.insert("store".to_owned(), json!(store));
        bench.model().answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(endpoint.seen()[0].body["store"], store);
    }
}
