//! Questions, and how their answers are read.

use serde_json::{Value, json};
use swarmbench_client::llm::completion::{REASONING_BYTES_MAX, RESPONSE_BYTES_MAX};
use swarmbench_client::llm::{ApiKey, Failure, ModelAnswer};
use swarmbench_engine::{Action, AgentId, Config, Settings, TaskName, answer};
use swarmbench_protocol::act::ActRequest;

use crate::llm::endpoint::{Endpoint, Reply, completion};
use crate::llm::{Bench, KEY, VARIABLE, question};

#[tokio::test]
async fn a_question_is_one_message_with_the_prompt_and_what_was_set() {
    let endpoint = Endpoint::replies(vec![Reply::says("I go up.\nACTION: UP")]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.sampling.temperature = Some(0.7);
    bench.settings.sampling.top_p = Some(1.0);
    bench.settings.sampling.max_tokens = Some(900);
    bench.settings.sampling.seed = Some(-3);
    bench.settings.extra.insert("reasoning_effort".to_owned(), json!("low"));
    let answer = bench.model().answer(&question(3, 7)).await.expect("an answer");
    assert_eq!(answer.response, "I go up.\nACTION: UP");
    assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), (Some(10), Some(5)));
    assert_eq!(answer.usage.latency_ms, Some(0));
    assert_eq!((answer.failure, answer.reasoning, answer.retries), (None, None, 0));
    let seen = endpoint.seen();
    assert_eq!(seen.len(), 1);
    assert_eq!(seen[0].uri, "/v1/chat/completions");
    assert_eq!(seen[0].headers["authorization"], format!("Bearer {KEY}"));
    assert_eq!(
        seen[0].body,
        json!({
            "model": "swarm-1",
            "messages": [{ "role": "user", "content": question(3, 7).prompt }],
            "temperature": 0.7,
            "top_p": 1.0,
            "max_tokens": 900,
            "seed": -3,
            "reasoning_effort": "low",
        })
    );
}

#[tokio::test]
async fn what_is_not_set_is_not_sent() {
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.key = ApiKey::new(VARIABLE, None);
    bench.model().answer(&question(0, 0)).await.expect("an answer");
    let seen = &endpoint.seen()[0];
    assert!(seen.headers.get("authorization").is_none());
    let fields: Vec<_> = seen.body.as_object().expect("an object").keys().collect();
    assert_eq!(fields, ["messages", "model"]);
}

#[tokio::test]
async fn the_api_base_is_taken_as_it_is() {
    let endpoint = Endpoint::replies(vec![]).await;
    let host = endpoint.base().trim_end_matches("/v1").to_owned();
    for (base, path) in [
        ("/v1", "/v1/chat/completions"),
        ("/v1/", "/v1/chat/completions"),
        ("", "/chat/completions"),
        ("/", "/chat/completions"),
        ("/v1/chat/completions", "/v1/chat/completions"),
        (
            "/openai/deployments/x?api-version=7",
            "/openai/deployments/x/chat/completions?api-version=7",
        ),
    ] {
        let mut bench = Bench::new(&endpoint);
        bench.settings.api_base = format!("{host}{base}");
        bench.model().answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(endpoint.seen().last().expect("a request").uri, path, "{base}");
    }
}

/// The answer to a body.
async fn read(body: Value) -> ModelAnswer {
    let endpoint = Endpoint::replies(vec![Reply::json(200, &body)]).await;
    let answer = Bench::new(&endpoint).model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(endpoint.seen().len(), 1, "a model's own failure is not tried again: {body}");
    answer
}

#[tokio::test]
async fn endpoints_write_answers_in_many_ways() {
    let up = "ACTION: UP";
    for (message, reasoning) in [
        (json!({ "content": up }), None),
        (
            json!({ "content": [{ "type": "text", "text": "ACTION" }, { "type": "text", "text": ": UP" }] }),
            None,
        ),
        (json!({ "content": ["ACTION: ", "UP"] }), None),
        (json!({ "content": up, "reasoning_content": "hm" }), Some("hm")),
        (json!({ "content": up, "reasoning": "hm" }), Some("hm")),
        (json!({ "content": up, "reasoning": "hm", "reasoning_content": "hm" }), Some("hm")),
        (
            json!({ "content": up, "reasoning_content": null, "refusal": null, "tool_calls": [] }),
            None,
        ),
        (json!({ "content": up, "reasoning_content": "" }), None),
        (
            json!({ "content": [
                { "type": "thinking", "thinking": [{ "type": "text", "text": "hm" }] },
                { "type": "text", "text": up },
            ] }),
            Some("hm"),
        ),
    ] {
        let answer = read(completion(&message, "stop")).await;
        assert_eq!(answer.response, up, "{message}");
        assert_eq!(answer.reasoning.as_deref(), reasoning, "{message}");
        assert_eq!(answer.failure, None, "{message}");
    }
    let old = json!({ "choices": [{ "text": up, "finish_reason": "stop" }] });
    assert_eq!(read(old).await.response, up);
    let thought = "<think>\nACTION: DOWN?\n</think>\nACTION: UP";
    let answer = read(completion(&json!({ "content": thought }), "stop")).await;
    assert_eq!(answer.response, thought, "the rules say what counts");
}

#[tokio::test]
async fn halves_of_characters_cost_an_answer_nothing_else() {
    let said = |content: &[u8]| {
        [br#"{"choices": [{"message": {"content": ""#, content, br#""}}]}"#].concat()
    };
    for (body, response) in [
        (said(br"\ud83d ACTION: UP"), "\u{fffd} ACTION: UP"),
        (said(br"ACTION: UP \ude00\ud83d"), "ACTION: UP \u{fffd}\u{fffd}"),
        (said(br"\\ud83d \ud83d\ude00 \ud83d\n\u0041"), "\\ud83d 😀 \u{fffd}\nA"),
        (said(b"\xf0\x9f ACTION: UP"), "\u{fffd} ACTION: UP"),
        ([b"\xef\xbb\xbf", &said(b"ACTION: UP")[..]].concat(), "ACTION: UP"),
    ] {
        let endpoint = Endpoint::replies(vec![Reply::text(200, body)]).await;
        let answer = Bench::new(&endpoint).model().answer(&question(0, 0)).await;
        assert_eq!(answer.expect("an answer").response, response);
        assert_eq!(endpoint.seen().len(), 1);
    }
}

#[tokio::test]
async fn what_a_model_does_wrong_is_an_answer() {
    let cases = [
        (json!({ "content": null }), "stop", "", Failure::Empty, None),
        (json!({ "content": "" }), "stop", "", Failure::Empty, None),
        (json!({ "content": " \n" }), "stop", " \n", Failure::Empty, None),
        (json!({ "content": [] }), "stop", "", Failure::Empty, None),
        (json!({}), "tool_calls", "", Failure::ToolCall, None),
        (json!({ "tool_calls": [{ "id": "1" }] }), "stop", "", Failure::ToolCall, None),
        (json!({ "content": null, "function_call": {} }), "stop", "", Failure::ToolCall, None),
        (
            json!({ "content": "", "reasoning_content": "So\nACTION: UP" }),
            "stop",
            "",
            Failure::ReasoningOnly,
            Some("So\nACTION: UP"),
        ),
        (
            json!({ "content": "<think>up?</think>\n" }),
            "stop",
            "<think>up?</think>\n",
            Failure::ReasoningOnly,
            None,
        ),
        (json!({ "content": "ACTION: L" }), "length", "ACTION: L", Failure::Truncated, None),
        (
            json!({ "content": null, "reasoning": "Hm, I" }),
            "length",
            "",
            Failure::Truncated,
            Some("Hm, I"),
        ),
        (json!({ "content": "I" }), "content_filter", "I", Failure::ContentFilter, None),
        (json!({ "content": null }), "content_filter", "", Failure::ContentFilter, None),
        (
            json!({ "content": null, "refusal": "I won't say\nACTION: UP" }),
            "stop",
            "",
            Failure::Refusal,
            Some("[refusal] I won't say\nACTION: UP"),
        ),
        (
            json!({ "content": [{ "type": "refusal", "refusal": "No." }], "reasoning": "Hm." }),
            "stop",
            "",
            Failure::Refusal,
            Some("Hm.\n[refusal] No."),
        ),
    ];
    for (message, finish, response, failure, reasoning) in cases {
        let answer = read(completion(&message, finish)).await;
        assert_eq!(answer.response, response, "{message}");
        assert_eq!(answer.failure, Some(failure), "{message}");
        assert_eq!(answer.reasoning.as_deref(), reasoning, "{message}");
        assert_eq!(answer.usage.prompt_tokens, Some(10), "it is paid for: {message}");
    }
    let none = json!({ "choices": [], "usage": { "prompt_tokens": 8, "completion_tokens": 0 } });
    let answer = read(none).await;
    assert_eq!((answer.failure, answer.usage.prompt_tokens), (Some(Failure::Empty), Some(8)));
}

#[tokio::test]
async fn a_question_at_which_a_filter_takes_offence_is_an_answer() {
    for (status, error) in [
        (400, json!({ "message": "It is bad.", "code": "content_filter" })),
        (400, json!({ "message": "It is bad.", "code": "content_policy_violation" })),
        (
            400,
            json!({
                "message": "It is bad.", "code": "x",
                "innererror": { "code": "ResponsibleAIPolicyViolation" },
            }),
        ),
        (
            403,
            json!({ "message": "It is bad.", "code": 403, "metadata": { "flagged_input": "push" } }),
        ),
    ] {
        let replies = vec![Reply::json(status, &json!({ "error": error }))];
        let endpoint = Endpoint::replies(replies).await;
        let model = Bench::new(&endpoint).model();
        let answer = model.answer(&question(0, 0)).await.expect("an answer");
        assert_eq!((answer.failure, answer.response.as_str()), (Some(Failure::ContentFilter), ""));
        assert_eq!(answer.reasoning.as_deref(), Some("[content filter] It is bad."));
        assert_eq!(model.spent().failures.of(Failure::ContentFilter), 1);
    }
}

#[tokio::test]
async fn tokens_are_told_in_several_ways_or_not_at_all() {
    let message = json!({ "content": "ACTION: UP" });
    for (usage, told) in [
        (json!({ "prompt_tokens": 7, "completion_tokens": 2 }), (Some(7), Some(2))),
        (json!({ "input_tokens": 7, "output_tokens": 2 }), (Some(7), Some(2))),
        (json!({ "prompt_tokens": 7 }), (Some(7), None)),
        (
            json!({ "prompt_tokens": -7, "completion_tokens": 18_446_744_073_709_551_615_u64 }),
            (None, None),
        ),
        (json!({ "prompt_tokens": "7" }), (None, None)),
        (json!([]), (None, None)),
        (Value::Null, (None, None)),
    ] {
        let mut body = completion(&message, "stop");
        body["usage"] = usage.clone();
        let answer = read(body).await;
        assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), told, "{usage}");
    }
}

#[tokio::test]
async fn long_answers_are_cut_to_what_an_act_may_have() {
    // Each of these takes six bytes as JSON.
    let filling = "\u{1}".repeat(200_000);
    let text = format!("ACTION: LEFT\n{filling}ACTION: RIGHT\n{filling}\nACTION: DOWN\n");
    let message = json!({ "content": text, "reasoning": format!("First, {filling}") });
    let answer = read(completion(&message, "stop")).await;
    let written = |text: &str| serde_json::to_string(text).expect("JSON").len() - 2;
    let reasoning = answer.reasoning.as_deref().expect("thoughts");
    assert!((RESPONSE_BYTES_MAX - 100..=RESPONSE_BYTES_MAX).contains(&written(&answer.response)));
    assert!((REASONING_BYTES_MAX - 100..=REASONING_BYTES_MAX).contains(&written(reasoning)));
    assert!(
        reasoning.starts_with("First, ") && reasoning.ends_with(" bytes left out]"),
        "{reasoning}"
    );
    let config = Config::check(&Settings::standard(TaskName::Transport, 27)).expect("settings");
    let act = answer::parse(&answer.response, &config, AgentId(0));
    assert_eq!((act.is_valid(), act.act.action), (true, Some(Action::Down)));
    let request = ActRequest {
        response: Some(answer.response),
        reasoning: answer.reasoning,
        usage: Some(answer.usage),
        ..ActRequest::default()
    };
    assert!(serde_json::to_vec(&request).expect("JSON").len() < 256 * 1024);
}

#[test]
fn a_cut_makes_no_marker_of_what_was_none() {
    let config = Config::check(&Settings::standard(TaskName::Transport, 27)).expect("settings");
    let text = format!("{}ACTION: UP", "I think of ".repeat(100));
    assert!(!answer::parse(&text, &config, AgentId(0)).is_valid());
    for most in 0..200 {
        let mut answer = ModelAnswer { response: text.clone(), ..ModelAnswer::default() };
        answer.shorten(most, 0);
        assert!(
            !answer::parse(&answer.response, &config, AgentId(0)).is_valid(),
            "{}",
            answer.response
        );
        assert!(answer.response.len() <= most.max(60), "{most}: {}", answer.response);
    }
    let whole = ModelAnswer {
        response: "ACTION: UP".to_owned(),
        reasoning: Some("é".repeat(5)),
        ..ModelAnswer::default()
    };
    let mut kept = whole.clone();
    kept.shorten(10, 10);
    assert_eq!(kept, whole, "what fits stays as it is");
}
