//! Tokens of each kind and costs, as providers report them; budgets of money.

use serde_json::{Value, json};
use swarmbench_client::llm::{Api, Price, Stop};
use swarmbench_protocol::act::Usage;

use crate::llm::endpoint::{Endpoint, Reply, completion};
use crate::llm::time::{Leaps, TIME_OUT};
use crate::llm::{Bench, ask, question};

/// The usage of an act that is made of an answer with this one.
async fn usage_of(api: Api, usage: &Value, price: Option<Price>) -> (Usage, u64) {
    let body = match api {
        Api::OpenAi => completion(&json!({ "content": "ACTION: UP" }), "stop"),
        Api::Responses => json!({
            "status": "completed",
            "output": [{ "type": "message", "content": [{ "type": "output_text", "text": "ACTION: UP" }] }],
        }),
        Api::Anthropic => {
            json!({ "content": [{ "type": "text", "text": "ACTION: UP" }], "stop_reason": "end_turn" })
        }
    };
    let mut body = body;
    body["usage"] = usage.clone();
    let endpoint = Endpoint::replies(vec![Reply::json(200, &body)]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.api = api;
    bench.settings.sampling.max_tokens = Some(100);
    bench.settings.price = price;
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    (Usage { latency_ms: None, ..answer.usage }, model.spent().odd_costs)
}

/// Prompt, cached, written into a cache, answer, reasoning, cost.
fn of(usage: &Usage) -> [Option<u64>; 6] {
    [
        usage.prompt_tokens,
        usage.cached_tokens,
        usage.cache_write_tokens,
        usage.completion_tokens,
        usage.reasoning_tokens,
        usage.cost_nano_usd,
    ]
}

#[tokio::test]
async fn the_usages_of_providers_are_read() {
    let shapes = [
        // OpenAI: https://platform.openai.com/docs/guides/prompt-caching
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 2006, "completion_tokens": 300, "total_tokens": 2306,
                "prompt_tokens_details": { "cached_tokens": 1920, "audio_tokens": 0 },
                "completion_tokens_details": { "reasoning_tokens": 192, "audio_tokens": 0,
                    "accepted_prediction_tokens": 0, "rejected_prediction_tokens": 0 },
            }),
            [Some(2006), Some(1920), None, Some(300), Some(192), None],
        ),
        (
            Api::Responses,
            json!({
                "input_tokens": 75, "input_tokens_details": { "cached_tokens": 0 }, "output_tokens": 1186,
                "output_tokens_details": { "reasoning_tokens": 1024 }, "total_tokens": 1261,
            }),
            [Some(75), Some(0), None, Some(1186), Some(1024), None],
        ),
        (
            Api::Anthropic,
            json!({
                "input_tokens": 21, "cache_creation_input_tokens": 188_086, "cache_read_input_tokens": 7,
                "output_tokens": 393, "service_tier": "standard",
            }),
            [Some(188_114), Some(7), Some(188_086), Some(393), None, None],
        ),
        // DeepSeek
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 1042, "completion_tokens": 87, "total_tokens": 1129,
                "prompt_cache_hit_tokens": 960, "prompt_cache_miss_tokens": 82,
                "completion_tokens_details": { "reasoning_tokens": 40 },
            }),
            [Some(1042), Some(960), None, Some(87), Some(40), None],
        ),
        // OpenRouter, with a key of the user's own at the provider
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 194, "completion_tokens": 2, "total_tokens": 196, "cost": 0.000_95, "is_byok": true,
                "cost_details": { "upstream_inference_cost": 0.019 },
                "prompt_tokens_details": { "cached_tokens": 0, "cache_write_tokens": 100, "audio_tokens": 0 },
                "completion_tokens_details": { "reasoning_tokens": 0 },
            }),
            [Some(194), Some(0), Some(100), Some(2), Some(0), Some(19_950_000)],
        ),
        // Gemini's compatible endpoint: thinking is in the total alone.
        (
            Api::OpenAi,
            json!({ "prompt_tokens": 8, "completion_tokens": 10, "total_tokens": 518 }),
            [Some(8), None, None, Some(510), Some(500), None],
        ),
        // xAI
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 32, "completion_tokens": 9, "total_tokens": 135, "cost_in_usd_ticks": 429_500,
                "completion_tokens_details": { "reasoning_tokens": 94 },
            }),
            [Some(32), None, None, Some(103), Some(94), Some(42_950)],
        ),
        // Perplexity
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 5, "completion_tokens": 9, "total_tokens": 14,
                "cost": { "input_tokens_cost": 0.000_01, "output_tokens_cost": 0.000_02, "total_cost": 0.005_03 },
            }),
            [Some(5), None, None, Some(9), None, Some(5_030_000)],
        ),
        // vLLM
        (
            Api::OpenAi,
            json!({ "prompt_tokens": 5, "completion_tokens": 9, "total_tokens": 14, "prompt_tokens_details": null }),
            [Some(5), None, None, Some(9), None, None],
        ),
        // Parts that are more than the whole.
        (
            Api::OpenAi,
            json!({
                "prompt_tokens": 100, "completion_tokens": 10,
                "prompt_tokens_details": { "cached_tokens": 60, "cache_write_tokens": 41 },
                "completion_tokens_details": { "reasoning_tokens": 11 },
            }),
            [Some(100), Some(60), None, Some(10), None, None],
        ),
        (Api::OpenAi, json!("many"), [None; 6]),
        (Api::OpenAi, json!({ "prompt_tokens": -1, "total_tokens": 1e30 }), [None; 6]),
    ];
    for (api, usage, expected) in shapes {
        let (read, lies) = usage_of(api, &usage, None).await;
        assert_eq!((of(&read), lies), (expected, 0), "{usage}");
    }
}

#[tokio::test]
async fn a_reported_cost_wins_unless_it_cannot_be_one() {
    let price = Some(Price::flat(2.0, 10.0));
    let of = |cost: Value| json!({ "prompt_tokens": 60, "completion_tokens": 100, "cost": cost });
    // The price allows 0.0012 dollars for a prompt of some bytes and 100 tokens; more is told.
    for (cost, expected, odd) in
        [(json!(0.001_15), 1_150_000, 0), (json!(0), 0, 0), (json!(0.5), 500_000_000, 1)]
    {
        let (usage, lies) = usage_of(Api::OpenAi, &of(cost), price).await;
        assert_eq!((usage.cost_nano_usd, lies), (Some(expected), odd));
    }
    for lie in [
        json!(-0.1),
        json!("0.1"),
        json!("NaN"),
        json!(1000.1),
        json!(1e300),
        json!([1]),
        json!(true),
    ] {
        let (usage, lies) = usage_of(Api::OpenAi, &of(lie), price).await;
        assert_eq!((usage.cost_nano_usd, lies), (Some(1_120_000), 1));
    }
    let (usage, lies) = usage_of(Api::OpenAi, &of(json!(-1)), None).await;
    assert_eq!((usage.cost_nano_usd, lies), (None, 1));
}

/// A bench whose answers cost 0.02 dollars, and whose requests may cost up to 0.11.
fn bench(endpoint: &Endpoint, clock: Leaps, budget_usd: f64) -> Bench {
    let mut bench = Bench::with(endpoint, clock, 4, None);
    bench.allowance = bench
        .allowance
        .with_money(swarmbench_client::llm::price::to_nano(budget_usd).expect("money"));
    bench.settings.price = Some(Price::flat(1000.0, 2000.0));
    bench.settings.sampling.max_tokens = Some(5);
    bench
}

#[tokio::test]
async fn a_budget_of_money_is_never_passed_by_what_is_in_flight() {
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: UP").held_until(1)).await;
    let bench = bench(&endpoint, Leaps::leaping(), 0.3);
    let model = bench.model();
    let asked: Vec<_> = (0..20).map(|agent| ask(&model, question(agent, 0))).collect();
    endpoint.has_seen(2).await;
    // Two more are allowed at once, but what they may cost is not left.
    tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    assert_eq!(endpoint.seen().len(), 2);
    endpoint.release();
    let (mut answers, mut stops) = (0, 0);
    for asked in asked {
        match asked.await.expect("no panic") {
            Ok(answer) => {
                assert_eq!(answer.usage.cost_nano_usd, Some(20_000_000));
                answers += 1;
            }
            Err(stop @ Stop::MoneySpent { spent, budget, next }) => {
                assert!(spent <= budget && spent + next > budget, "{stop}");
                assert!(stop.to_string().contains("of 0.3000 US dollars"), "{stop}");
                stops += 1;
            }
            Err(stop) => panic!("{stop}"),
        }
    }
    // Ten answers cost 0.20; another might pass the budget.
    assert_eq!((answers, stops, endpoint.seen().len()), (10, 10, 10));
}

#[tokio::test]
async fn a_request_whose_answer_was_not_read_counts_as_what_it_may_cost() {
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: UP").stalling()).await;
    let bench = bench(&endpoint, Leaps::leaping(), 0.3);
    let model = bench.model();
    let asked = ask(&model, question(0, 0));
    for tries in 1..=2 {
        endpoint.has_seen(tries).await;
        bench.clock.pass(TIME_OUT);
    }
    let stop = asked.await.expect("no panic").expect_err("the budget is spent");
    let Stop::MoneySpent { spent, budget, .. } = stop else { panic!("{stop}") };
    assert!(spent > 200_000_000 && spent <= budget, "{spent}");
    assert_eq!(endpoint.seen().len(), 2);
}

/// The spent part of a budget that is over.
fn spent_of(stop: &Stop) -> u64 {
    let Stop::MoneySpent { spent, .. } = stop else { panic!("{stop}") };
    *spent
}

/// What was begun may be charged; what was refused is not.
#[tokio::test]
async fn a_request_that_fails_after_a_success_status_counts_as_what_it_may_cost() {
    let token = json!({ "choices": [{ "delta": { "content": "ACTION" } }] });
    let within = |code: u16| json!({ "error": { "message": "no", "code": code } });
    let charged: [Reply; 5] = [
        Reply::events(&[token.clone(), token.clone()]).breaking(),
        Reply::events(&[token.clone(), within(502)]),
        Reply::events(&[token.clone(), within(429)]),
        Reply::json(200, &within(400)),
        Reply::json(200, &within(401)),
    ];
    for reply in charged {
        let endpoint = Endpoint::replies(vec![reply]).await;
        // Enough for one request.
        let bench = bench(&endpoint, Leaps::leaping(), 0.15);
        let mut stop = bench.model().answer(&question(0, 0)).await.expect_err("it is spent");
        if matches!(stop, Stop::WrongKey { .. }) {
            stop = bench.model().answer(&question(0, 0)).await.expect_err("it is spent");
        }
        assert!(spent_of(&stop) > 100_000_000, "{stop}");
        assert_eq!(endpoint.seen().len(), 1);
    }
    for status in [429, 500, 503] {
        let endpoint = Endpoint::replies(vec![Reply::error(status, "no")]).await;
        let bench = bench(&endpoint, Leaps::leaping(), 0.15);
        bench.model().answer(&question(0, 0)).await.expect("an answer");
        let mut wrong = bench.settings.clone();
        wrong.api_base = "http://127.0.0.1:1/v1".to_owned();
        let nobody = swarmbench_client::llm::Model::new(wrong, &bench.allowance, None);
        let stop = nobody.expect("good settings").answer(&question(0, 0)).await;
        assert!(matches!(stop, Err(Stop::Unreachable { tries: 3, .. })), "{stop:?}");
    }
}

#[tokio::test]
async fn a_connection_that_breaks_without_a_status_counts_too() {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let base = format!("http://{}/v1", listener.local_addr().expect("an address"));
    let server = tokio::spawn(async move {
        let (mut connection, _) = listener.accept().await.expect("a connection");
        let mut some = [0; 16];
        tokio::io::AsyncReadExt::read_exact(&mut connection, &mut some).await.expect("a request");
    });
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = bench(&endpoint, Leaps::leaping(), 0.15);
    bench.settings.api_base = base;
    let stop = bench.model().answer(&question(0, 0)).await.expect_err("it is spent");
    assert!(spent_of(&stop) > 100_000_000, "{stop}");
    server.await.expect("it came");
}

/// A budget believes no cost that is lower than the price, and what passes the highest cost of a request is told.
#[tokio::test]
async fn no_reported_cost_makes_a_budget_endless() {
    // Without the tokens of both, and with a prompt of none, a request counts as what it may cost.
    for (usage, each) in [
        (json!({ "prompt_tokens": 10, "completion_tokens": 5, "cost": 0 }), Some(20_000_000)),
        (json!({ "prompt_tokens": 0, "completion_tokens": 0 }), None),
        (json!({ "completion_tokens": 5 }), None),
        (json!({ "prompt_tokens": 10 }), None),
    ] {
        let mut body = completion(&json!({ "content": "ACTION: UP" }), "stop");
        body["usage"] = usage.clone();
        let endpoint = Endpoint::start(move |_, _| Reply::json(200, &body)).await;
        let model = bench(&endpoint, Leaps::leaping(), 0.3).model();
        let mut stop = None;
        for _ in 0..20 {
            match model.answer(&question(0, 0)).await {
                Ok(answer) => {
                    assert_eq!(answer.usage.cost_nano_usd, usage["cost"].as_u64(), "{usage}");
                }
                Err(spent) => stop = Some(spent),
            }
        }
        let Some(Stop::MoneySpent { spent, next, .. }) = stop else { panic!("{stop:?}") };
        let each = each.unwrap_or(next);
        assert_eq!((spent, model.spent().odd_costs), (each * model.spent().answers, 0), "{usage}");
        assert!(model.spent().answers > 0, "{usage}");
    }
    let mut body = completion(&json!({ "content": "ACTION: UP" }), "stop");
    body["usage"]["cost"] = json!(999);
    let endpoint = Endpoint::replies(vec![Reply::json(200, &body)]).await;
    let model = bench(&endpoint, Leaps::leaping(), 5.0).model();
    model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(model.spent().odd_costs, 1);
    let stop = model.answer(&question(0, 0)).await.expect_err("it is spent");
    assert_eq!((spent_of(&stop), endpoint.seen().len()), (999_000_000_000, 1));
}

/// Neither tokens that no price can tell nor fields beside the prompt make a request cheaper than it may be.
#[tokio::test]
async fn what_has_no_price_and_what_is_beside_the_prompt_count_against_a_budget() {
    let mut body = completion(&json!({ "content": "ACTION: UP" }), "stop");
    body["usage"] = json!({ "prompt_tokens": 1_u64 << 40, "completion_tokens": 5 });
    let endpoint = Endpoint::start(move |_, _| Reply::json(200, &body)).await;
    let model = bench(&endpoint, Leaps::leaping(), 0.3).model();
    for _ in 0..2 {
        model.answer(&question(0, 0)).await.expect("an answer");
    }
    let stop = model.answer(&question(0, 0)).await.expect_err("it is spent");
    assert!(spent_of(&stop) > 200_000_000, "{stop}");
    let mut bench = bench(&endpoint, Leaps::leaping(), 1.0);
    bench.settings.extra.insert("tools".to_owned(), json!(["x".repeat(1000)]));
    let stop = bench.model().answer(&question(0, 0)).await.expect_err("it may cost a dollar");
    assert!(matches!(stop, Stop::MoneySpent { spent: 0, next: 1_000_000_000.., .. }), "{stop}");
    assert_eq!(endpoint.seen().len(), 2);
}
