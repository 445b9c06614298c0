//! Errors that no retry mends stop at once, with a sentence that helps.

use serde_json::json;
use swarmbench_client::llm::{ApiKey, Failure, Stop};

use crate::llm::endpoint::{Endpoint, Reply};
use crate::llm::time::Leaps;
use crate::llm::{Bench, KEY, VARIABLE, ask, key, question, stop_of};

/// Stop of a model that is refused, without a second request.
async fn refused(reply: Reply, change: impl FnOnce(&mut Bench)) -> Stop {
    let endpoint = Endpoint::replies(vec![reply]).await;
    let mut bench = Bench::new(&endpoint);
    change(&mut bench);
    let model = bench.model();
    let stop = stop_of(&model).await;
    assert_eq!(stop_of(&model).await, stop, "it says the same to all");
    assert_eq!(endpoint.seen().len(), 1, "it is not asked again: {stop}");
    assert_eq!(bench.clock.pauses(), []);
    stop
}

fn assert_says(stop: &Stop, words: &[&str]) {
    let text = stop.to_string();
    for word in words {
        assert!(text.contains(word), "{word:?} is missing in {text}");
    }
    assert!(!text.contains(KEY) && !format!("{stop:?}").contains(KEY), "{text}");
    assert!(!text.contains('\n'), "{text}");
}

#[tokio::test]
async fn a_wrong_key_says_where_it_came_from() {
    let reply = || Reply::error(401, "Incorrect API key provided");
    let stop = refused(reply(), |_| {}).await;
    assert!(matches!(stop, Stop::WrongKey { .. }));
    assert_says(
        &stop,
        &["refuses the key in SWARM_TEST_KEY", "--api-key-env", "Incorrect API key"],
    );
    let stop = refused(reply(), |bench| bench.settings.key = ApiKey::new(VARIABLE, None)).await;
    assert_says(&stop, &["SWARM_TEST_KEY is not set", "/v1/chat/completions asks for a good key"]);
    let empty = ApiKey::new(VARIABLE, Some(" \n".to_owned()));
    let stop = refused(reply(), |bench| bench.settings.key = empty).await;
    assert_says(&stop, &["SWARM_TEST_KEY is empty"]);
    let stop = refused(Reply::text(401, ""), |_| {}).await;
    assert_says(&stop, &["It gave no reason"]);
}

#[tokio::test]
async fn the_key_is_in_no_error_even_if_the_endpoint_shows_it() {
    // Also where the quotation is cut.
    for before in [0, 1].into_iter().chain((250..310).step_by(7)) {
        let text = format!("{} {KEY} is no good, {KEY}!", "x".repeat(before));
        let reply = if before % 2 == 0 { Reply::error(401, &text) } else { Reply::text(401, text) };
        let stop = refused(reply, |_| {}).await;
        assert_says(&stop, &[]);
        assert!(!stop.to_string().contains(&KEY[..8]), "no part of it either: {stop}");
    }
}

#[tokio::test]
async fn white_space_around_a_key_is_no_part_of_it() {
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.key = ApiKey::new(VARIABLE, Some(format!(" {KEY}\n")));
    bench.model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(endpoint.seen()[0].headers["authorization"], format!("Bearer {KEY}"));
}

/// A reply, the stop that it causes, and the words that help.
type Case = (Reply, fn(&Stop) -> bool, &'static [&'static str]);

/// A mistake in the settings.
type Change = Box<dyn Fn(&mut Bench)>;

#[tokio::test]
async fn other_refusals_say_what_to_do() {
    let model_not_found =
        json!({ "error": { "message": "no such model", "code": "model_not_found" } });
    let cases: Vec<Case> = vec![
        (
            Reply::error(403, "not in your region"),
            |stop| matches!(stop, Stop::Forbidden { .. }),
            &["403", VARIABLE, "swarm-1", "not in your region"],
        ),
        (
            Reply::error(402, "Insufficient credits"),
            |stop| matches!(stop, Stop::NoCredit { .. }),
            &["add credit", "Insufficient credits", "run the same command again"],
        ),
        (
            Reply::json(
                429,
                &json!({ "error": {
                "message": "You exceeded your current quota", "type": "insufficient_quota", "code": null,
            } }),
            ),
            |stop| matches!(stop, Stop::NoCredit { status: 429, .. }),
            &["add credit", "You exceeded your current quota"],
        ),
        (
            Reply::json(404, &model_not_found),
            |stop| matches!(stop, Stop::NotFound { .. }),
            &["swarm-1", "/v1/models lists the models", "no such model"],
        ),
        (
            Reply::text(404, "Not Found"),
            |stop| matches!(stop, Stop::NotFound { .. }),
            &["/v1/chat/completions was not found (404)", "whether the api base is right"],
        ),
        (
            Reply::json(405, &json!({ "detail": "Method Not Allowed" })),
            |stop| matches!(stop, Stop::NotFound { .. }),
            &["405", "Method Not Allowed"],
        ),
        (
            Reply::json(200, &json!({ "error": { "message": "key?", "code": 401 } })),
            |stop| matches!(stop, Stop::WrongKey { .. }),
            &["key?"],
        ),
    ];
    for (reply, is_it, words) in cases {
        let stop = refused(reply, |_| {}).await;
        assert!(is_it(&stop), "{stop:?}");
        assert_says(&stop, words);
    }
}

/// An endpoint that takes no question: it is asked one, and a probe, and then never again.
#[tokio::test]
async fn what_no_question_is_taken_for_says_what_to_change() {
    let cases: [(u16, serde_json::Value, &[&str]); 5] = [
        (
            400,
            json!({ "error": { "message": "Unsupported parameter: 'max_tokens'. Use 'max_completion_tokens' instead." } }),
            &["leave --max-tokens out and say --max-completion-tokens", "Unsupported parameter"],
        ),
        (
            400,
            json!({ "error": { "message": "'temperature' does not support 0.5 with this model." } }),
            &["say another --temperature, or leave it out", "does not support 0.5"],
        ),
        (
            400,
            json!([{ "error": { "code": 400, "message": "no", "status": "INVALID" } }]),
            &["(400). It said: no"],
        ),
        (422, json!({ "detail": [{ "loc": ["body"], "msg": "extra" }] }), &["422", "extra"]),
        (
            400,
            json!({ "error": "prompt is longer than the context" }),
            &["the prompt is too long", "longer than the context"],
        ),
    ];
    for (status, body, words) in cases {
        let endpoint = Endpoint::start(move |_, _| Reply::json(status, &body)).await;
        let bench = Bench::new(&endpoint);
        let model = bench.model();
        let stop = stop_of(&model).await;
        assert!(
            matches!(stop, Stop::BadRequest { status: said, .. } if said == status),
            "{stop:?}"
        );
        assert_says(&stop, words);
        assert_eq!(stop_of(&model).await, stop, "it says the same to all");
        assert_eq!(endpoint.seen().len(), 2, "the question and a probe");
        assert_eq!(bench.clock.pauses(), []);
    }
}

/// A prompt that is longer than the context is rejected for ever, and must not block a run.
#[tokio::test]
async fn one_question_that_is_rejected_twice_costs_the_model_its_move() {
    for status in [400, 413, 422] {
        let is_poison = |prompt: &str| prompt == question(0, 1).prompt;
        let endpoint = Endpoint::start(move |_, seen| {
            if is_poison(seen.prompt()) {
                Reply::error(status, "too long")
            } else {
                Reply::says("ACTION: UP")
            }
        })
        .await;
        let model = Bench::new(&endpoint).model();
        for (asked, requests) in [(question(0, 1), 3), (question(0, 2), 4), (question(0, 1), 7)] {
            let answer = model.answer(&asked).await.expect("an answer");
            let is_rejected = is_poison(&asked.prompt);
            assert_eq!(answer.failure, is_rejected.then_some(Failure::Rejected), "{status}");
            let reasoning = is_rejected.then_some("[rejected] too long");
            assert_eq!(answer.reasoning.as_deref(), reasoning);
            assert_eq!(
                endpoint.seen().len(),
                requests,
                "the question, a probe, the question again"
            );
        }
        let spent = model.spent();
        assert_eq!((spent.answers, spent.failures.of(Failure::Rejected)), (3, 2));
        assert_eq!(spent.prompt_tokens, 30, "those of two probes and an answer");
    }
}

/// An answer that is rejected once and then taken counts like any other.
#[tokio::test]
async fn a_question_that_is_taken_the_second_time_loses_nothing() {
    let replies = vec![Reply::error(400, "odd"), Reply::says("OK"), Reply::says("ACTION: UP")];
    let endpoint = Endpoint::replies(replies).await;
    let answer = Bench::new(&endpoint).model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.failure, answer.response.as_str()), (None, "ACTION: UP"));
}

#[tokio::test]
async fn an_address_without_v1_is_pointed_out() {
    let without = |bench: &mut Bench| {
        let base = bench.settings.api_base.trim_end_matches("/v1").to_owned();
        bench.settings.api_base = base;
    };
    let stop = refused(Reply::text(404, "404 page not found"), without).await;
    assert_says(
        &stop,
        &["many endpoints want /v1 at the end", "/v1. Some models", "It said: 404 page not found"],
    );
}

#[tokio::test]
async fn the_key_is_carried_nowhere_else() {
    let other = Endpoint::replies(vec![]).await;
    for status in [301, 302, 303, 307, 308] {
        let to = format!("{}/chat/completions?key={KEY}", other.base());
        let stop = refused(Reply::text(status, "").header("location", to), |_| {}).await;
        assert!(matches!(stop, Stop::Elsewhere { .. }), "{stop:?}");
        assert_says(&stop, &[&format!("sends on to {} ({status})", other.base()), "--api-base"]);
    }
    for to in ["", "http://[", "http://user:secret@127.0.0.1/v1"] {
        let stop = refused(Reply::text(302, "").header("location", to), |_| {}).await;
        assert!(!stop.to_string().contains("secret"), "{stop}");
    }
    let stop = refused(Reply::text(302, ""), |_| {}).await;
    assert_says(&stop, &["an address that cannot be read"]);
    assert_eq!(other.seen().len(), 0);
}

#[tokio::test]
async fn settings_that_cannot_work_are_told_before_anybody_is_asked() {
    let endpoint = Endpoint::replies(vec![]).await;
    let cases: Vec<(&str, Change)> = vec![
        (
            "is no address",
            Box::new(|bench| bench.settings.api_base = "api.openai.com/v1".to_owned()),
        ),
        ("is no address", Box::new(|bench| bench.settings.api_base = "localhost:8080".to_owned())),
        (
            "is no address",
            Box::new(|bench| bench.settings.api_base = "file:///etc/passwd".to_owned()),
        ),
        ("is no address", Box::new(|bench| bench.settings.api_base = String::new())),
        (
            "holds credentials: put the key into SWARM_TEST_KEY",
            Box::new(|bench| bench.settings.api_base = format!("https://me:{KEY}@127.0.0.1/v1")),
        ),
        (
            "the key in SWARM_TEST_KEY has characters that no key has",
            Box::new(|bench| {
                bench.settings.key = ApiKey::new(VARIABLE, Some(format!("{KEY}\n{KEY}")));
            }),
        ),
        (
            "or a letter that is not ASCII",
            Box::new(|bench| {
                bench.settings.key = ApiKey::new(VARIABLE, Some(format!("{KEY}ä")));
            }),
        ),
        (
            "\"messages\"",
            Box::new(|bench| {
                bench.settings.extra.insert("messages".to_owned(), json!([]));
            }),
        ),
        (
            "\"temperature\" of the request's body is given twice: by an option and as a further field",
            Box::new(|bench| {
                bench.settings.sampling.temperature = Some(1.0);
                bench.settings.extra.insert("temperature".to_owned(), json!(0.5));
            }),
        ),
        (
            "holds the key of SWARM_TEST_KEY",
            Box::new(|bench| {
                bench.settings.extra.insert("auth".to_owned(), json!({ "is": [KEY] }));
            }),
        ),
    ];
    for (words, change) in cases {
        let mut bench = Bench::new(&endpoint);
        change(&mut bench);
        let stop = bench.try_model().expect_err(words);
        assert!(matches!(stop, Stop::Settings(_)), "{stop:?}");
        assert_says(&stop, &[words]);
    }
    assert_eq!(endpoint.seen().len(), 0);
    assert_eq!((key().variable(), key().is_there()), (VARIABLE, true));
}

#[tokio::test]
async fn who_pauses_or_waits_is_told_too() {
    // The first is to be asked again in a while, the second is refused for good.
    let endpoint =
        Endpoint::replies(vec![Reply::error(500, "oops"), Reply::error(401, "no").held_until(1)])
            .await;
    let bench = Bench::with(&endpoint, Leaps::standing(), 1, None);
    let model = bench.model();
    let pausing = ask(&model, question(0, 0));
    bench.clock.has_seen(1).await;
    let refused = ask(&model, question(1, 0));
    endpoint.has_seen(2).await;
    let waiting = ask(&model, question(2, 0));
    endpoint.release();
    for asked in [pausing, refused, waiting] {
        let stop = asked.await.expect("no panic").expect_err("it stops");
        assert!(matches!(stop, Stop::WrongKey { .. }), "{stop:?}");
    }
    assert_eq!(endpoint.seen().len(), 2);
    assert_eq!(model.spent().in_flight, 0);
}
