//! Lists of prices: the files of `LiteLLM` (`model_prices_and_context_window.json`) and of models.dev (`api.json`).

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use reqwest::Url;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::price::{Price, Step};

/// Maximum entries that an error names.
const NAMED_MAX: usize = 4;

/// Prices of many models at many providers.
#[derive(Clone, Debug, PartialEq)]
pub struct PriceList(Vec<Entry>);

/// Price of a model at a provider.
#[derive(Clone, Debug, PartialEq)]
struct Entry {
    /// Name in the list.
    name: String,
    /// Name of the model at the provider.
    model: String,
    provider: String,
    /// Address of the provider, if the list has it.
    address: Option<String>,
    /// The price; an error says what is wrong with it.
    price: Result<Price, String>,
}

/// Prices of `LiteLLM` by kind, as [`KINDS`]: of a token.
const LITELLM: [&str; 5] = [
    "input_cost_per_token",
    "output_cost_per_token",
    "cache_read_input_token_cost",
    "cache_creation_input_token_cost",
    "output_cost_per_reasoning_token",
];

/// Prices of models.dev by kind, as [`KINDS`]: of a million tokens.
const MODELS_DEV: [&str; 5] = ["input", "output", "cache_read", "cache_write", "reasoning"];

/// Kinds of tokens that have prices, for people.
const KINDS: [&str; 5] = ["input", "output", "cache reads", "cache writes", "reasoning"];

/// Content of a list by name. A name that is there twice is refused: one of its prices would win.
struct Listed(BTreeMap<String, Value>);

impl<'de> Deserialize<'de> for Listed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Self(BTreeMap::new()))
    }
}

impl<'de> Visitor<'de> for Listed {
    type Value = Self;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<Self, A::Error> {
        while let Some((name, listed)) = map.next_entry::<String, Value>()? {
            if self.0.insert(name.clone(), listed).is_some() {
                return Err(A::Error::custom(format!("{name:?} is there twice")));
            }
        }
        Ok(self)
    }
}

impl PriceList {
    /// Reads a list, of either shape and of at most [`TEXT_BYTES_MAX`](swarmbench_clock::files::TEXT_BYTES_MAX).
    ///
    /// # Errors
    /// If the file cannot be read, is too large, or is no list of prices.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = swarmbench_clock::files::read_text(path).map_err(|error| error.to_string())?;
        Self::parse(&text)
    }

    fn parse(text: &str) -> Result<Self, String> {
        let what = "a list of prices has the form of LiteLLM's model_prices_and_context_window.json or of models.dev's api.json";
        // Editors may begin a file with a byte-order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let Listed(listed) =
            serde_json::from_str(text).map_err(|error| format!("{what}: {error}"))?;
        let entries: Vec<Entry> =
            listed.iter().flat_map(|(name, listed)| Entry::of(name, listed)).collect();
        if entries.is_empty() {
            return Err(format!("{what}; no model in it has a price of tokens"));
        }
        Ok(Self(entries))
    }

    /// The price of a model at an address; `None` if the list has none.
    ///
    /// # Errors
    /// If several providers have the model at different prices and the address fits none of them, or the price is none.
    pub fn of(&self, model: &str, address: Option<&str>) -> Result<Option<Price>, String> {
        let mut found: Vec<&Entry> =
            self.0.iter().filter(|entry| entry.model == model || entry.name == model).collect();
        let address = address.map(|address| address.trim_end_matches('/'));
        narrow(&mut found, |entry| address.is_some() && entry.address.as_deref() == address);
        narrow(&mut found, |entry| address.is_some_and(|address| entry.is_at(address)));
        narrow(&mut found, |entry| entry.name == model);
        let Some(first) = found.first() else { return Ok(None) };
        if found.iter().any(|entry| entry.price != first.price) {
            let names: Vec<&str> =
                found.iter().take(NAMED_MAX).map(|entry| entry.name.as_str()).collect();
            return Err(format!(
                "{} entries have different prices, such as {}",
                found.len(),
                names.join(", ")
            ));
        }
        first.price.clone().map(Some).map_err(|wrong| format!("the entry {}: {wrong}", first.name))
    }
}

/// Keeps the entries that fit, if there are any.
fn narrow(found: &mut Vec<&Entry>, fits: impl Fn(&Entry) -> bool) {
    if found.iter().any(|entry| fits(entry)) {
        found.retain(|entry| fits(entry));
    }
}

impl Entry {
    fn of(name: &str, listed: &Value) -> Vec<Self> {
        let text = |field: &str| listed[field].as_str().map(str::to_owned);
        if let Some(models) = listed["models"].as_object() {
            let priced = models.iter().filter(|(_, listed)| listed["cost"].is_object());
            let of_model = |(model, listed): (&String, &Value)| Self {
                name: format!("{name}/{model}"),
                model: model.clone(),
                provider: name.to_owned(),
                address: text("api"),
                price: price(&listed["cost"], MODELS_DEV, 1.0, &listed["limit"]["output"]),
            };
            return priced.map(of_model).collect();
        }
        if listed[LITELLM[0]].is_null() {
            return Vec::new();
        }
        let price = price(listed, LITELLM, 1e6, &listed["max_output_tokens"]);
        let provider = text("litellm_provider").unwrap_or_default();
        let model = name.strip_prefix(&format!("{provider}/")).unwrap_or(name).to_owned();
        vec![Self { name: name.to_owned(), model, provider, address: None, price }]
    }

    /// True if the host of an address names the provider, as `api.openai.com` does.
    fn is_at(&self, address: &str) -> bool {
        let url = Url::parse(address).ok();
        let host = url.as_ref().and_then(Url::host_str).unwrap_or_default();
        !self.provider.is_empty() && host.split('.').any(|label| label == self.provider)
    }
}

/// A price from those of each kind of token, for `1e6 / scale` tokens.
fn price(
    listed: &Value,
    names: [&str; 5],
    scale: f64,
    answer_tokens_max: &Value,
) -> Result<Price, String> {
    let mut read = [None; 5];
    for ((name, kind), read) in names.into_iter().zip(KINDS).zip(&mut read) {
        let cost = &listed[name];
        if cost.is_null() {
            continue;
        }
        let number = cost.as_f64().ok_or_else(|| format!("the price of {kind} is {cost}"))?;
        // Prices of a token are published with few digits, which the product would lose.
        *read = Some((number * scale * 1e6).round() / 1e6);
    }
    let [input, output, cached, cache_write, reasoning] = read;
    let (input, output) = (input.unwrap_or(0.0), output.unwrap_or(0.0));
    let answer_tokens_max = answer_tokens_max.as_u64();
    let step = step(listed, names)?;
    let price = Price { input, output, cached, cache_write, reasoning, answer_tokens_max, step };
    Some(price)
        .filter(Price::is_sane)
        .ok_or_else(|| "its prices are from 0 to 100,000 dollars for a million tokens".to_owned())
}

/// The step to the prices of long prompts: `input_cost_per_token_above_200k_tokens` and the like in the list of `LiteLLM`, an
/// object `context_over_200k` or a list `tiers` in that of models.dev. Of several steps the lowest bound and the highest prices count.
fn step(listed: &Value, names: [&str; 5]) -> Result<Option<Step>, String> {
    let Some(fields) = listed.as_object() else { return Ok(None) };
    let mut steps: Vec<(u64, &str, &Value)> = Vec::new();
    for (field, value) in fields {
        if let Some(tokens) = field.strip_prefix("context_over_").and_then(thousands) {
            steps.extend(names.iter().map(|name| (tokens, *name, &value[*name])));
        }
        for tier in value.as_array().filter(|_| field == "tiers").into_iter().flatten() {
            let tokens = tier["tier"]["size"].as_u64().ok_or("a tier has no size")?;
            steps.extend(names.iter().map(|name| (tokens, *name, &tier[*name])));
        }
        for name in names {
            let bound = field.strip_prefix(name).and_then(|rest| rest.strip_prefix("_above_"));
            let tokens = bound.and_then(|bound| thousands(bound.strip_suffix("_tokens")?));
            steps.extend(tokens.map(|tokens| (tokens, name, value)));
        }
    }
    let mut step: Option<Step> = None;
    for (below, name, cost) in steps.into_iter().filter(|(_, _, cost)| !cost.is_null()) {
        // Without a price of its own, a kind has that of input or output.
        let usual = if [names[1], names[4]].contains(&name) { names[1] } else { names[0] };
        let base = listed[name].as_f64().or_else(|| listed[usual].as_f64()).unwrap_or(0.0);
        let higher = cost.as_f64().filter(|cost| *cost >= 0.0);
        let higher =
            higher.ok_or_else(|| format!("the price of {name} for long prompts is {cost}"))?;
        if higher.total_cmp(&base).is_eq() {
            continue;
        }
        let ratio = higher / base;
        let ratio = step.map_or(ratio, |step| step.ratio.max(ratio));
        step = Some(Step { below: step.map_or(below, |step| step.below.min(below)), ratio });
    }
    Ok(step)
}

/// Tokens of a bound such as `200k`.
fn thousands(bound: &str) -> Option<u64> {
    bound.strip_suffix('k')?.parse::<u64>().ok()?.checked_mul(1000)
}
