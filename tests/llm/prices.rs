//! Prices of each kind of token, lists of them, and budgets.

use serde_json::{Value, json};
use swarmbench_client::llm::price::{NANO, Step};
use swarmbench_client::llm::{Budget, Price, PriceList};
use swarmbench_protocol::act::Usage;
use tempfile::NamedTempFile;

fn read(text: &str) -> Result<PriceList, String> {
    let file = NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("it is written");
    PriceList::read(file.path())
}

#[test]
fn each_kind_of_token_has_its_price() {
    let price = Price {
        cached: Some(0.5),
        cache_write: Some(2.5),
        reasoning: Some(8.0),
        ..Price::flat(2.0, 10.0)
    };
    let usage = Usage {
        prompt_tokens: Some(1000),
        completion_tokens: Some(100),
        cached_tokens: Some(600),
        cache_write_tokens: Some(100),
        reasoning_tokens: Some(40),
        ..Usage::default()
    };
    // 300 × 2 + 600 × 0.5 + 100 × 2.5 + 60 × 10 + 40 × 8, in millionths.
    assert_eq!(price.of_usage(&usage), Some(2_070_000));
    assert_eq!(Price::flat(2.0, 10.0).of_usage(&usage), Some(3_000_000));
    assert_eq!(price.of_usage(&Usage::default()), None);
    assert_eq!(price.of_usage(&Usage { prompt_tokens: None, ..usage }), None);
    assert_eq!(price.of_usage(&Usage { completion_tokens: None, ..usage }), None);
    assert_eq!(price.at_most(1000, 100), 3_500_000);
}

#[test]
fn budgets_are_tokens_or_dollars() {
    for (text, budget) in [
        ("2000000", Budget::Tokens(2_000_000)),
        ("5usd", Budget::NanoUsd(5 * NANO)),
        ("0.25 USD", Budget::NanoUsd(NANO / 4)),
    ] {
        assert_eq!(text.parse(), Ok(budget));
    }
    for wrong in
        ["0", "-1", "5eur", "0usd", "-5usd", "nanusd", "infusd", "1e9usd", "", "usd", "1.5", "$3"]
    {
        let said = wrong.parse::<Budget>().expect_err(wrong);
        assert!(said.contains("5usd"), "{said}");
    }
}

const LITELLM: &str = r#"{
    "sample_spec": { "max_output_tokens": "a number", "litellm_provider": "one of", "mode": "chat" },
    "gpt-4o": { "litellm_provider": "openai", "input_cost_per_token": 2.5e-06, "output_cost_per_token": 1e-05,
        "cache_read_input_token_cost": 1.25e-06, "max_output_tokens": 16384 },
    "azure/gpt-4o": { "litellm_provider": "azure", "input_cost_per_token": 2.75e-06, "output_cost_per_token": 1.1e-05 },
    "openrouter/openai/gpt-4o": { "litellm_provider": "openrouter", "input_cost_per_token": 3e-06,
        "output_cost_per_token": 1.2e-05 },
    "broken": { "litellm_provider": "x", "input_cost_per_token": -1, "output_cost_per_token": 0 },
    "text": { "litellm_provider": "x", "input_cost_per_token": "1", "output_cost_per_token": 0 }
}"#;

const MODELS_DEV: &str = r#"{
    "openai": { "id": "openai", "models": { "gpt-4o": { "cost": { "input": 2.5, "output": 10, "cache_read": 1.25 },
        "limit": { "context": 128000, "output": 16384 } } } },
    "cheap": { "api": "https://llm.example/v1", "models": { "gpt-4o": { "cost": { "input": 1, "output": 2 } }, "free": {} } }
}"#;

fn input(list: &str, model: &str, address: Option<&str>) -> Result<Option<f64>, String> {
    let list = read(list).expect("a list");
    list.of(model, address).map(|price| price.map(|price| price.input))
}

#[test]
fn both_lists_are_read() {
    for list in [LITELLM, MODELS_DEV] {
        let list = read(list).expect("a list");
        let price =
            list.of("gpt-4o", Some("https://api.openai.com/v1/")).expect("one").expect("a price");
        let max = Some(16_384);
        assert_eq!(
            price,
            Price { cached: Some(1.25), answer_tokens_max: max, ..Price::flat(2.5, 10.0) }
        );
    }
}

/// Prices of long prompts are higher; those of caches by time are another matter.
#[test]
fn long_prompts_have_their_price() {
    let litellm = r#"{ "m": { "litellm_provider": "p", "input_cost_per_token": 1e-06, "output_cost_per_token": 1e-05,
        "input_cost_per_token_above_200k_tokens": 2e-06, "output_cost_per_token_above_200k_tokens": 1.5e-05,
        "cache_creation_input_token_cost": 1e-06, "cache_creation_input_token_cost_above_1hr": 6e-06 } }"#;
    let models_dev = r#"{ "p": { "models": { "m": { "cost": { "input": 1, "output": 10, "cache_write": 1,
        "context_over_200k": { "input": 2, "output": 15 } } } } } }"#;
    for list in [litellm, models_dev] {
        let price = read(list).expect("a list").of("m", None).expect("one").expect("a price");
        assert_eq!(price.step, Some(Step { below: 200_000, ratio: 2.0 }));
        assert_eq!(price.at_most(200_000, 0), NANO / 5);
        assert_eq!(price.at_most(300_000, 0), NANO * 6 / 10);
        let tokens = |prompt| Usage {
            prompt_tokens: Some(prompt),
            completion_tokens: Some(0),
            ..Usage::default()
        };
        assert_eq!(price.of_usage(&tokens(200_000)), Some(NANO / 5));
        assert_eq!(price.of_usage(&tokens(300_000)), Some(NANO * 6 / 10));
    }
}

/// A step in any shape raises what a request may cost, also for kinds without a price of their own; a text is no price.
#[test]
fn steps_of_every_shape_count() {
    let step = |cost: Value| {
        let list = json!({ "a": { "models": { "m": { "cost": cost } } } }).to_string();
        read(&list).expect("a list").of("m", None).map(|price| price.and_then(|price| price.step))
    };
    let doubled = Ok(Some(Step { below: 272_000, ratio: 2.0 }));
    let tiers =
        json!([{ "input": 2, "output": 4, "tier": { "type": "context", "size": 272_000 } }]);
    assert_eq!(step(json!({ "input": 1, "output": 4, "tiers": tiers })), doubled);
    let over = json!({ "cache_write": 2 });
    assert_eq!(step(json!({ "input": 1, "output": 4, "context_over_272k": over })), doubled);
    for above in [json!("2e-5"), json!(-1)] {
        let said =
            step(json!({ "input": 1, "output": 1, "context_over_200k": { "input": above } }));
        assert!(said.is_err_and(|said| said.contains("for long prompts is")));
    }
    let free = step(json!({ "input": 1, "context_over_200k": { "output": 3 } }));
    assert!(free.is_err_and(|said| said.contains("its prices are from 0")));
}

/// A prompt has at most as many tokens as bytes, so it may be below a step to lower prices.
#[test]
fn a_step_to_lower_prices_lowers_no_highest_cost_and_one_that_is_no_price_is_refused() {
    let listed = |base: f64, above: f64| {
        let text = json!({ "m": { "input_cost_per_token": base, "output_cost_per_token": 0,
            "input_cost_per_token_above_200k_tokens": above } });
        read(&text.to_string()).expect("a list").of("m", None)
    };
    let lower = listed(1e-6, 1e-9).expect("one").expect("a price");
    assert_eq!(lower.at_most(300_000, 0), NANO * 3 / 10);
    let usage =
        Usage { prompt_tokens: Some(300_000), completion_tokens: Some(0), ..Usage::default() };
    assert_eq!(lower.of_usage(&usage), Some(300_000));
    assert_eq!(listed(0.0, 0.0), Ok(Some(Price::flat(0.0, 0.0))));
    for (base, above) in [(1e-6, -1e-9), (0.0, 1e-6)] {
        let said = listed(base, above).expect_err("no price");
        let is_named = ["its prices are from 0", "for long prompts is -"]
            .iter()
            .any(|words| said.contains(words));
        assert!(said.contains("the entry m: ") && is_named, "{said}");
    }
}

#[test]
fn the_address_chooses_among_providers() {
    assert_eq!(
        input(LITELLM, "gpt-4o", Some("https://x.openai.azure.com/openai/v1")),
        Ok(Some(2.5))
    );
    assert_eq!(
        input(LITELLM, "openai/gpt-4o", Some("https://openrouter.ai/api/v1")),
        Ok(Some(3.0))
    );
    assert_eq!(input(LITELLM, "gpt-4o", Some("http://127.0.0.1:1/v1")), Ok(Some(2.5)));
    assert_eq!(input(MODELS_DEV, "gpt-4o", Some("https://llm.example/v1")), Ok(Some(1.0)));
    assert_eq!(input(MODELS_DEV, "openai/gpt-4o", None), Ok(Some(2.5)));
    assert_eq!(input(MODELS_DEV, "gpt-5", None), Ok(None));
    let said = input(MODELS_DEV, "gpt-4o", None).expect_err("two prices");
    assert!(said.contains("cheap/gpt-4o, openai/gpt-4o"), "{said}");
}

#[test]
fn a_list_may_begin_with_a_byte_order_mark_and_names_nothing_twice() {
    assert_eq!(read(&format!("\u{feff}{LITELLM}")), read(LITELLM));
    let entry = r#""m": { "input_cost_per_token": 1e-6 }"#;
    let said = read(&format!("{{ {entry}, {entry} }}")).expect_err("two entries");
    assert!(said.contains(r#""m" is there twice"#), "{said}");
}

#[test]
fn what_is_no_price_is_an_error_that_names_it() {
    for (model, wrong) in [("broken", "from 0 to"), ("text", "the price of input is \"1\"")] {
        let said = input(LITELLM, model, None).expect_err(model);
        assert!(said.contains(model) && said.contains(wrong), "{said}");
    }
    for text in ["", "[]", "{}", r#"{"a": 1}"#, r#"{"a": {"b": 1}}"#, &"[".repeat(100_000)] {
        let said = read(text).expect_err("no list");
        assert!(said.contains("models.dev"), "{said}");
    }
}
