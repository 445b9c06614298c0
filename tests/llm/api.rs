//! Other headers, other interfaces, and endpoints that answer in a way that is not read.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, ApiKey, Failure, Headers, Sampling};

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

fn header(name: &str, text: &str) -> Result<Headers, String> {
    let lookup = |name: &str| match name {
        "MY_KEY" => Some(" k1 \n".to_owned()),
        "BROKEN" => Some("two\nlines".to_owned()),
        "EMPTY" => Some(String::new()),
        _ => None,
    };
    Headers::parse(&BTreeMap::from([(name.to_owned(), text.to_owned())]), lookup)
}

#[tokio::test]
async fn variables_in_headers_are_filled_in_and_never_shown() {
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    for (name, text, value, is_secret) in [
        ("Api-Key", "$MY_KEY", "k1", true),
        ("Api-Key", "Bearer ${MY_KEY}!", "Bearer k1!", true),
        ("Api-Key", "$MY_KEY$$", "k1$", true),
        ("x-title", "a $$5 swarm", "a $5 swarm", false),
    ] {
        let headers = header(name, text).expect(text);
        assert_eq!(headers.has_secret(), is_secret);
        assert!(!format!("{headers:?}").contains("k1"));
        bench.settings.headers = headers;
        bench.model().answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(endpoint.seen().last().expect("a request").headers[name], value);
    }
}

#[test]
fn a_header_that_cannot_work_says_what_to_do() {
    for (name, text, words) in [
        ("api key", "$MY_KEY", "no name of a header"),
        ("api-key", "k1", "say 'api-key: $MY_KEY'"),
        ("Authorization", "Bearer k1", "environment variable"),
        ("x-title", "$NONE", "`export NONE=…`"),
        ("x-title", "$EMPTY", "empty or not set"),
        ("x-title", "5 $", "$$ for a dollar sign"),
        ("x-title", "${MY_KEY", "${NAME}"),
        ("x-title", "ä", "not ASCII"),
        ("api-key", "$BROKEN", "a line break"),
        ("Content-Type", "text/plain", "leave it out"),
    ] {
        let error = header(name, text).expect_err(text);
        assert!(error.contains(words) && !error.contains("two"), "{name} {text}: {error}");
    }
}

/// What was sent beside the prompt, with these settings.
async fn sent(api: Api, change: impl FnOnce(&mut Sampling)) -> Value {
    let endpoint = Endpoint::start(|_, _| Reply::error(401, "no")).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.api = api;
    bench.settings.sampling.max_tokens = Some(4096);
    change(&mut bench.settings.sampling);
    stop_of(&bench.model()).await;
    let mut body = endpoint.seen()[0].body.clone();
    let fields = body.as_object_mut().expect("an object");
    fields.retain(|name, _| !["model", "messages", "input"].contains(&name.as_str()));
    body
}

#[tokio::test]
async fn limits_and_reasoning_are_asked_for_in_the_words_of_each_interface() {
    fn limits(sampling: &mut Sampling) {
        *sampling =
            Sampling { max_tokens: None, max_completion_tokens: Some(4096), ..sampling.clone() };
        sampling.effort = Some("low".to_owned());
    }
    assert_eq!(
        sent(Api::OpenAi, limits).await,
        json!({ "max_completion_tokens": 4096, "reasoning_effort": "low" })
    );
    assert_eq!(
        sent(Api::Anthropic, |sampling| {
            limits(sampling);
            sampling.thinking_budget = Some(2048);
        })
        .await,
        json!({
            "max_tokens": 4096, "output_config": { "effort": "low" },
            "thinking": { "type": "enabled", "budget_tokens": 2048 },
        })
    );
    assert_eq!(
        sent(Api::Responses, |sampling| {
            limits(sampling);
            sampling.reasoning_summary = Some("auto".to_owned());
        })
        .await,
        json!({
            "max_output_tokens": 4096, "reasoning": { "effort": "low", "summary": "auto" }, "store": false,
        })
    );
    let plain = json!({ "max_output_tokens": 4096, "store": false });
    assert_eq!(sent(Api::Responses, |_| {}).await, plain);
}

#[tokio::test]
async fn what_an_interface_does_not_have_is_told_before_anybody_is_asked() {
    type Change = fn(&mut Sampling);
    let endpoint = Endpoint::replies(vec![]).await;
    let cases: [(Api, Change, &str); 5] = [
        (Api::OpenAi, |sampling| sampling.thinking_budget = Some(9), "with openai name an effort"),
        (Api::Responses, |sampling| sampling.thinking_budget = Some(9), "option of api anthropic"),
        (
            Api::OpenAi,
            |sampling| sampling.reasoning_summary = Some("auto".to_owned()),
            "an option of api responses",
        ),
        (
            Api::Anthropic,
            |sampling| sampling.thinking_budget = Some(64),
            "the thinking budget of 64 tokens must be less than the 64 of the whole answer",
        ),
        (Api::OpenAi, |sampling| sampling.max_completion_tokens = Some(9), "are one limit"),
    ];
    for (api, change, words) in cases {
        let mut bench = Bench::new(&endpoint);
        bench.settings.api = api;
        bench.settings.sampling.max_tokens = Some(64);
        change(&mut bench.settings.sampling);
        let stop = bench.try_model().expect_err(words).to_string();
        assert!(stop.contains(words), "{stop}");
    }
    assert_eq!(endpoint.seen().len(), 0);
}

#[tokio::test]
async fn an_address_or_a_model_that_is_not_found_names_the_other_interfaces() {
    for (api, others) in [
        (Api::OpenAi, "try --api responses or --api anthropic"),
        (Api::Responses, "try --api openai or --api anthropic"),
        (Api::Anthropic, "try --api openai or --api responses"),
    ] {
        for words in ["Not Found", "swarm-1 is only supported in v1/responses"] {
            let endpoint = Endpoint::start(move |_, _| Reply::error(404, words)).await;
            let mut bench = Bench::new(&endpoint);
            bench.settings.api = api;
            bench.settings.sampling.max_tokens = Some(64);
            let stop = stop_of(&bench.model()).await.to_string();
            assert!(stop.contains(others), "{stop}");
        }
    }
}

/// An address is good for each interface, whichever it was copied from.
#[tokio::test]
async fn the_path_of_an_interface_takes_the_place_of_another() {
    let endpoint = Endpoint::start(|_, _| Reply::error(401, "no")).await;
    for end in ["", "/chat/completions", "/responses", "/messages/"] {
        let mut bench = Bench::new(&endpoint);
        bench.settings.api = Api::Responses;
        bench.settings.api_base = format!("{}{end}", endpoint.base());
        stop_of(&bench.model()).await;
        assert_eq!(endpoint.seen().last().expect("a request").uri, "/v1/responses");
    }
}

#[tokio::test]
async fn a_short_key_may_be_a_part_of_words() {
    let endpoint = Endpoint::start(|_, _| Reply::error(401, "the key x is exhausted, x")).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.key = ApiKey::new(VARIABLE, Some("x".to_owned()));
    bench.settings.model = "xy-max".to_owned();
    bench.settings.extra.insert("prefix".to_owned(), json!("max"));
    let stop = stop_of(&bench.model()).await.to_string();
    assert!(stop.contains("the key [key] is exhausted, [key]"), "{stop}");
    bench.settings.extra.insert("auth".to_owned(), json!(["x"]));
    let stop = bench.try_model().expect_err("a field is the key").to_string();
    assert!(stop.contains("holds the key of SWARM_TEST_KEY"), "{stop}");
    // A long one is not there by chance.
    bench.settings.key = ApiKey::new(VARIABLE, Some(KEY.to_owned()));
    bench.settings.model = format!("model-{KEY}");
    let stop = bench.try_model().expect_err("the model names the key").to_string();
    assert!(stop.contains("holds the key of SWARM_TEST_KEY"), "{stop}");
}
