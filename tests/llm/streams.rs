//! Answers that come in pieces, by all interfaces: only a whole one counts.

use std::time::Duration;

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, Failure, Stop};

use crate::llm::endpoint::{Endpoint, Reply};
use crate::llm::responses::response_stream;
use crate::llm::time::{Leaps, TIME_OUT};
use crate::llm::{Bench, ask, question, stop_of};

const APIS: [Api; 3] = [Api::OpenAi, Api::Responses, Api::Anthropic];

/// The events of an answer of 10 and 5 tokens.
fn events(api: Api, text: &str, finish: &str) -> Vec<Value> {
    let (first, second) = text.split_at(text.len() / 2);
    match api {
        Api::OpenAi => {
            let choice = |delta: Value, finish: Value| json!({ "choices": [{ "index": 0, "delta": delta, "finish_reason": finish }], "usage": null });
            vec![
                choice(json!({ "role": "assistant", "content": "" }), Value::Null),
                choice(json!({ "reasoning_content": "hm" }), Value::Null),
                choice(json!({ "content": first }), Value::Null),
                choice(json!({ "content": second }), Value::Null),
                choice(json!({}), json!(finish)),
                json!({ "choices": [], "usage": { "prompt_tokens": 10, "completion_tokens": 5 } }),
                json!("[DONE]"),
            ]
        }
        Api::Responses => response_stream(text, finish),
        Api::Anthropic => {
            let reason = match finish {
                "length" => "max_tokens",
                _ => "end_turn",
            };
            let start = json!({ "content": [], "stop_reason": null, "usage": { "input_tokens": 10, "output_tokens": 1 } });
            let delta = |index: u32, delta: Value| json!({ "type": "content_block_delta", "index": index, "delta": delta });
            let stop = |index: u32| json!({ "type": "content_block_stop", "index": index });
            vec![
                json!({ "type": "message_start", "message": start }),
                json!({ "type": "content_block_start", "index": 0, "content_block": { "type": "thinking", "thinking": "" } }),
                json!({ "type": "ping" }),
                delta(0, json!({ "type": "thinking_delta", "thinking": "hm" })),
                delta(0, json!({ "type": "signature_delta", "signature": "x" })),
                stop(0),
                json!({ "type": "content_block_start", "index": 1, "content_block": { "type": "text", "text": "" } }),
                delta(1, json!({ "type": "text_delta", "text": first })),
                delta(1, json!({ "type": "text_delta", "text": second })),
                stop(1),
                json!({ "type": "message_delta", "delta": { "stop_reason": reason }, "usage": { "output_tokens": 5 } }),
                json!({ "type": "message_stop" }),
            ]
        }
    }
}

fn stream(api: Api) -> Reply {
    Reply::events(&events(api, "ACTION: UP", "stop"))
}

fn bench(api: Api, endpoint: &Endpoint, clock: Leaps) -> Bench {
    let mut bench = Bench::with(endpoint, clock, 4, None);
    bench.settings.api = api;
    bench.settings.streams = true;
    bench.settings.sampling.max_tokens = Some(64);
    bench
}

#[tokio::test]
async fn a_stream_is_asked_for_and_becomes_an_answer_with_the_time_of_its_first_token() {
    for api in APIS {
        let first = if api == Api::Responses { "response.output_text.delta" } else { "hm" };
        let reply = move || stream(api).pausing_before(first);
        let endpoint = Endpoint::start(move |_, _| reply()).await;
        let bench = bench(api, &endpoint, Leaps::standing());
        let model = bench.model();
        let asked = ask(&model, question(0, 0));
        endpoint.has_seen(1).await;
        bench.clock.pass(Duration::from_millis(700));
        endpoint.release();
        let answer = asked.await.expect("no panic").expect("an answer");
        assert_eq!((answer.response.as_str(), answer.failure), ("ACTION: UP", None), "{api:?}");
        assert_eq!(answer.reasoning.as_deref(), Some("hm"));
        assert_eq!(
            (answer.usage.prompt_tokens, answer.usage.completion_tokens),
            (Some(10), Some(5))
        );
        assert_eq!((answer.usage.latency_ms, answer.usage.first_token_ms), (Some(700), Some(700)));
        let sent = &endpoint.seen()[0].body;
        assert_eq!(sent["stream"], true);
        let counts = json!({ "include_usage": true });
        assert_eq!(sent["stream_options"], if api == Api::OpenAi { counts } else { Value::Null });
    }
}

#[tokio::test]
async fn half_a_stream_is_never_an_answer() {
    for api in APIS {
        let whole: usize = {
            let all = events(api, "ACTION: UP", "stop");
            // Cut before its last event.
            all[..all.len() - 2].iter().map(|event| event.to_string().len()).sum()
        };
        let broken = vec![
            stream(api).breaking(),
            stream(api).cut(whole / 2),
            stream(api).cut(whole),
            Reply::events(&[]),
            Reply::text(200, "data: {\n\n").header("content-type", "text/event-stream"),
        ];
        let count = broken.len();
        let endpoint = Endpoint::start({
            let mut broken = broken.into_iter().map(Some).collect::<Vec<_>>();
            broken.insert(0, Some(stream(api)));
            let broken = std::sync::Mutex::new(broken);
            move |number, _| {
                let mut broken = broken.lock().expect("a lock");
                broken.get_mut(number).and_then(Option::take).unwrap_or_else(|| stream(api))
            }
        })
        .await;
        let model = bench(api, &endpoint, Leaps::leaping()).model();
        model.answer(&question(0, 0)).await.expect("a first answer");
        let answer = model.answer(&question(0, 1)).await.expect("an answer");
        assert_eq!(answer.response, "ACTION: UP");
        assert_eq!(answer.retries as usize, count, "{api:?}");
        assert_eq!(endpoint.seen().len(), count + 2);
    }
}

#[tokio::test]
async fn a_stream_that_stalls_is_asked_for_again_and_says_so() {
    for api in APIS {
        let endpoint = Endpoint::replies(vec![stream(api).stalling(), stream(api)]).await;
        let bench = bench(api, &endpoint, Leaps::leaping());
        let model = bench.model();
        let asked = ask(&model, question(0, 0));
        endpoint.has_seen(1).await;
        bench.clock.pass(TIME_OUT);
        let answer = asked.await.expect("no panic").expect("an answer");
        assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 1));
        assert_eq!(model.spent().troubles.time_outs, 1);
    }
}

/// A part of the timeout is enough between pieces; before the first token a model may think.
#[tokio::test]
async fn a_stream_that_stalls_after_its_first_token_is_given_up_early() {
    for (api, last) in [
        (Api::OpenAi, "[DONE]"),
        (Api::Responses, "event: response.completed"),
        (Api::Anthropic, "event: message_stop"),
    ] {
        let endpoint = Endpoint::replies(vec![stream(api).pausing_before(last)]).await;
        let mut bench = bench(api, &endpoint, Leaps::leaping());
        bench.settings.retries = 0;
        let model = bench.model();
        let asked = ask(&model, question(0, 0));
        bench.clock.has_waited(2).await;
        bench.clock.pass(TIME_OUT / 4);
        let stop = asked.await.expect("no panic").expect_err("it stalls").to_string();
        assert!(stop.contains("a stream that stalled: nothing for 2500 s after"), "{stop}");
        assert_eq!(model.spent().troubles.time_outs, 1);
        let endpoint = Endpoint::replies(vec![stream(api).pausing_before(match api {
            Api::Responses => "response.output_text.delta",
            _ => "hm",
        })])
        .await;
        bench.settings.api_base = endpoint.base().to_owned();
        let model = bench.model();
        let asked = ask(&model, question(0, 0));
        endpoint.has_seen(1).await;
        bench.clock.pass(TIME_OUT * 3 / 4);
        endpoint.release();
        let answer = asked.await.expect("no panic").expect("an answer");
        assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 0));
    }
}

#[tokio::test]
async fn ends_of_streams_are_those_of_whole_answers() {
    for api in APIS {
        let reply = Reply::events(&events(api, "I thi", "length"));
        let endpoint = Endpoint::replies(vec![reply]).await;
        let answer = bench(api, &endpoint, Leaps::leaping()).model().answer(&question(0, 0)).await;
        let answer = answer.expect("an answer");
        assert_eq!((answer.response.as_str(), answer.failure), ("I thi", Some(Failure::Truncated)));
    }
}

#[tokio::test]
async fn errors_within_a_stream_count_as_those_of_answers() {
    let anthropic =
        |kind: &str| json!({ "type": "error", "error": { "type": kind, "message": "no" } });
    let failed = |code: &str| json!({ "type": "response.failed", "response": { "error": { "code": code, "message": "no" } } });
    for (api, error, load, server) in [
        (Api::OpenAi, json!({ "error": { "message": "no", "code": 502 } }), 0, 1),
        (Api::OpenAi, json!({ "error": { "message": "no", "type": "rate_limit_error" } }), 1, 0),
        (Api::Anthropic, anthropic("overloaded_error"), 1, 0),
        (Api::Anthropic, anthropic("api_error"), 0, 1),
        (Api::Responses, failed("rate_limit_exceeded"), 1, 0),
        (Api::Responses, failed("server_error"), 0, 1),
        (Api::Responses, json!({ "type": "error", "code": "server_error", "message": "no" }), 0, 1),
        (Api::Responses, json!({ "type": "error", "what": [] }), 0, 1),
    ] {
        let mut half = events(api, "ACTION: UP", "stop");
        half.truncate(3);
        half.push(error.clone());
        let endpoint = Endpoint::replies(vec![Reply::events(&half), stream(api)]).await;
        let model = bench(api, &endpoint, Leaps::leaping()).model();
        let answer = model.answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(answer.response, "ACTION: UP", "{error}");
        let troubles = model.spent().troubles;
        assert_eq!(
            (troubles.load, troubles.server, troubles.total()),
            (load, server, 1),
            "{error}"
        );
    }
    let denied = [anthropic("authentication_error")];
    let endpoint = Endpoint::replies(vec![Reply::events(&denied)]).await;
    let stop = stop_of(&bench(Api::Anthropic, &endpoint, Leaps::leaping()).model()).await;
    assert!(matches!(stop, Stop::WrongKey { .. }), "{stop:?}");
}

/// Nobody has to say that an endpoint only streams.
#[tokio::test]
async fn an_endpoint_that_only_streams_is_read() {
    for api in APIS {
        for refusal in [
            None,
            Some(Reply::error(400, "This model only supports stream=true")),
            Some(Reply::error(422, "Stream must be set to True")),
        ] {
            let asks = usize::from(refusal.is_some());
            let replies: Vec<_> = refusal.into_iter().chain([stream(api), stream(api)]).collect();
            let endpoint = Endpoint::replies(replies).await;
            let mut bench = bench(api, &endpoint, Leaps::leaping());
            bench.settings.streams = false;
            let model = bench.model();
            for round in 0..2 {
                let answer = model.answer(&question(0, round)).await.expect("an answer");
                assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 0));
            }
            let seen = endpoint.seen();
            assert_eq!(seen.len(), 2 + asks);
            assert_eq!(seen[0].body.get("stream"), None);
            let streams = seen.iter().filter(|seen| seen.body["stream"] == true).count();
            assert_eq!(streams, 2 * asks, "it is asked so from the first refusal on");
            assert_eq!(bench.clock.pauses(), []);
        }
    }
    // Also without the type of a stream.
    let endpoint = Endpoint::replies(vec![stream(Api::OpenAi).untyped()]).await;
    let answer = Bench::new(&endpoint).model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(answer.response, "ACTION: UP");
}

#[tokio::test]
async fn an_endpoint_that_counts_no_tokens_of_a_stream_is_not_asked_to() {
    let refusal = Reply::error(400, "Unknown field: stream_options");
    let endpoint = Endpoint::replies(vec![refusal, stream(Api::OpenAi), stream(Api::OpenAi)]).await;
    let model = bench(Api::OpenAi, &endpoint, Leaps::leaping()).model();
    for round in 0..2 {
        model.answer(&question(0, round)).await.expect("an answer");
    }
    let asked: Vec<_> =
        endpoint.seen().iter().map(|seen| seen.body.get("stream_options").is_some()).collect();
    assert_eq!(asked, [true, false, false]);
    // A field of the user's, for a stream that is not asked for, is another matter.
    let words = "stream_options is only allowed when stream is true";
    let endpoint = Endpoint::start(move |_, _| Reply::error(400, words)).await;
    let stop = stop_of(&Bench::new(&endpoint).model()).await;
    assert!(matches!(stop, Stop::BadRequest { .. }), "{stop:?}");
}

/// An endpoint may answer with a whole body all the same.
#[tokio::test]
async fn a_whole_answer_to_the_request_for_a_stream_is_read() {
    let endpoint = Endpoint::replies(vec![Reply::says("ACTION: UP")]).await;
    let model = bench(Api::OpenAi, &endpoint, Leaps::leaping()).model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.response.as_str(), answer.usage.first_token_ms), ("ACTION: UP", None));
}
