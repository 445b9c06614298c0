//! Tokens and costs that endpoints report, in their many shapes.

use serde_json::{Value, json};

use super::price::{NANO, to_nano};
use swarmbench_protocol::act::Usage;

/// Maximum plausible token count; larger ones are ignored.
const TOKENS_MAX: u64 = 1 << 40;

/// Maximum plausible cost of an answer in billionths of a US dollar: 1,000 dollars. Larger ones are ignored.
const COST_NANO_USD_MAX: u64 = 1000 * NANO;

/// Places of the tokens read from a cache: chat completions, responses, `DeepSeek`, Moonshot.
const CACHED: [&str; 4] = [
    "/prompt_tokens_details/cached_tokens",
    "/input_tokens_details/cached_tokens",
    "/prompt_cache_hit_tokens",
    "/cached_tokens",
];

/// Places of the tokens written into a cache: chat completions of routers, responses.
const CACHE_WRITES: [&str; 2] =
    ["/prompt_tokens_details/cache_write_tokens", "/input_tokens_details/cache_write_tokens"];

/// Places of the tokens of reasoning: chat completions, responses, some gateways.
const REASONING: [&str; 3] = [
    "/completion_tokens_details/reasoning_tokens",
    "/output_tokens_details/reasoning_tokens",
    "/reasoning_tokens",
];

/// What an endpoint reports about an answer.
pub(super) struct Reported {
    pub(super) usage: Usage,
    /// Tokens that count towards a budget.
    pub(super) tokens: Option<u64>,
    /// True if a cost cannot be one, and is ignored.
    pub(super) has_false_cost: bool,
}

/// Parses the usage of a completion.
pub(super) fn reported(usage: &Value) -> Reported {
    let sane = |value: &Value| value.as_u64().filter(|tokens| *tokens <= TOKENS_MAX);
    let number = |places: &[&str]| places.iter().find_map(|place| sane(usage.pointer(place)?));
    let prompt_tokens = number(&["/prompt_tokens", "/input_tokens"]);
    let mut completion_tokens = number(&["/completion_tokens", "/output_tokens"]);
    let mut reasoning_tokens = number(&REASONING);
    let sum = prompt_tokens.unwrap_or(0) + completion_tokens.unwrap_or(0);
    let total = sane(&usage["total_tokens"]).unwrap_or(0).max(sum);
    // Gemini and Grok count reasoning only in the total.
    if let (Some(read), Some(said)) = (prompt_tokens, completion_tokens)
        && total > sum
    {
        completion_tokens = Some(total - read);
        reasoning_tokens = reasoning_tokens.or(Some(total - read - said));
    }
    // A part that is more than the whole is a mistake.
    let part = |part: Option<u64>, whole: Option<u64>| part.filter(|part| Some(*part) <= whole);
    let cached_tokens = part(number(&CACHED), prompt_tokens);
    let rest = prompt_tokens.map(|all| all - cached_tokens.unwrap_or(0));
    let cost = cost(usage);
    let cost_nano_usd = cost.and_then(to_nano).filter(|nano| *nano <= COST_NANO_USD_MAX);
    let usage = Usage {
        prompt_tokens,
        completion_tokens,
        cached_tokens,
        cache_write_tokens: part(number(&CACHE_WRITES), rest),
        reasoning_tokens: part(reasoning_tokens, completion_tokens),
        cost_nano_usd,
        ..Usage::default()
    };
    let has_false_cost = cost.is_some() && cost_nano_usd.is_none();
    Reported { usage, tokens: Some(total).filter(|total| *total > 0), has_false_cost }
}

/// The cost that an endpoint reports, in US dollars; no number if it is none.
fn cost(usage: &Value) -> Option<f64> {
    // Grok counts ten-billionths; Perplexity has an object; routers have a number.
    let (said, scale) = match (&usage["cost_in_usd_ticks"], &usage["cost"]["total_cost"]) {
        (Value::Null, Value::Null) => (&usage["cost"], 1.0),
        (Value::Null, total) => (total, 1.0),
        (ticks, _) => (ticks, 1e-10),
    };
    if said.is_null() {
        return None;
    }
    let said = said.as_f64().filter(|usd| *usd >= 0.0).unwrap_or(f64::NAN);
    // With a key of the user's own, a router reports its fee and what the provider charges apart.
    let upstream = usage["cost_details"]["upstream_inference_cost"].as_f64();
    let upstream = upstream.filter(|_| usage["is_byok"] == true);
    Some(said * scale + upstream.unwrap_or(0.0))
}

/// Converts the usage of an Anthropic message to that of a chat completion. It counts tokens read from a cache or written into it
/// apart.
pub(super) fn of_message(usage: &Value) -> Value {
    let count = |name: &str| usage[name].as_u64();
    let (cached, written) =
        (count("cache_read_input_tokens"), count("cache_creation_input_tokens"));
    let counts = [count("input_tokens"), written, cached];
    let read = counts.into_iter().flatten().reduce(u64::saturating_add);
    json!({
        "prompt_tokens": read,
        "completion_tokens": usage["output_tokens"],
        "prompt_tokens_details": { "cached_tokens": cached, "cache_write_tokens": written },
        "completion_tokens_details": {
            "reasoning_tokens": usage["output_tokens_details"]["thinking_tokens"],
        },
        "cost": usage["cost"],
    })
}
