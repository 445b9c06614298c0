//! Prices of tokens, and budgets.

use std::str::FromStr;

use serde::Deserialize;
use serde_json::Value;

use swarmbench_protocol::act::Usage;

/// Billionths of a dollar in a dollar.
pub const NANO: u64 = 1_000_000_000;

/// Maximum dollars for a million tokens. A higher price is a mistake of units.
const PRICE_MAX: f64 = 100_000.0;

/// Maximum dollars of a budget.
const BUDGET_USD_MAX: f64 = 1e6;

/// Dollars as whole billionths; `None` if they are negative, no number, or more than 10 million.
#[must_use]
pub fn to_nano(usd: f64) -> Option<u64> {
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked"
    )]
    (0.0..=1e7).contains(&usd).then(|| (usd * NANO as f64).round() as u64)
}

/// Billionths of a dollar as dollars.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "dollars are rounded anyway")]
pub fn to_usd(nano: u64) -> f64 {
    nano as f64 / NANO as f64
}

/// Prices of a million tokens, in US dollars.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Price {
    /// The price of tokens of prompts.
    pub input: f64,
    /// The price of tokens of answers.
    pub output: f64,
    /// The price of tokens of prompts that are read from a cache; that of other tokens of prompts if there is none.
    pub cached: Option<f64>,
    /// The price of tokens of prompts that are written into a cache; that of other tokens of prompts if there is none.
    pub cache_write: Option<f64>,
    /// The price of tokens of reasoning; that of other tokens of answers if there is none.
    pub reasoning: Option<f64>,
    /// The maximum tokens of an answer, if a list of prices names it.
    #[serde(skip)]
    pub answer_tokens_max: Option<u64>,
    /// The step to the prices of long prompts, if a list of prices has one.
    #[serde(skip)]
    pub step: Option<Step>,
}

/// Step to higher prices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The maximum tokens of a prompt below it.
    pub below: u64,
    /// The largest ratio of a price above it to the same price below it. All prices are multiplied by it, so that no cost is
    /// higher.
    pub ratio: f64,
}

impl Price {
    /// Prices of prompts and answers alone.
    #[must_use]
    pub const fn flat(input: f64, output: f64) -> Self {
        Self {
            input,
            output,
            cached: None,
            cache_write: None,
            reasoning: None,
            answer_tokens_max: None,
            step: None,
        }
    }

    /// The cost of these tokens in dollars, without any cache.
    #[must_use]
    pub fn of(&self, prompt_tokens: u64, completion_tokens: u64) -> f64 {
        cost(prompt_tokens, self.input) + cost(completion_tokens, self.output)
    }

    /// The cost of an answer in billionths of a dollar; `None` if the tokens of its prompt or its own are unknown. No prompt has 0
    /// tokens.
    #[must_use]
    pub fn of_usage(&self, usage: &Usage) -> Option<u64> {
        let read = usage.prompt_tokens.filter(|tokens| *tokens > 0)?;
        let said = usage.completion_tokens?;
        let [cached, written, reasoned] =
            [usage.cached_tokens, usage.cache_write_tokens, usage.reasoning_tokens]
                .map(|tokens| tokens.unwrap_or(0));
        let plain = read.saturating_sub(cached).saturating_sub(written);
        let usd = self.of(plain, said.saturating_sub(reasoned))
            + cost(cached, self.cached.unwrap_or(self.input))
            + cost(written, self.cache_write.unwrap_or(self.input))
            + cost(reasoned, self.reasoning.unwrap_or(self.output));
        to_nano(usd * self.ratio(read))
    }

    /// Factor of all prices for a prompt of this length.
    fn ratio(&self, prompt_tokens: u64) -> f64 {
        self.step.filter(|step| prompt_tokens > step.below).map_or(1.0, |step| step.ratio)
    }

    /// The highest cost of a request in billionths of a dollar: nothing is read from a cache, all is written into it.
    #[must_use]
    pub fn at_most(&self, prompt_tokens: u64, completion_tokens: u64) -> u64 {
        let input = self.input.max(self.cache_write.unwrap_or(0.0));
        let output = self.output.max(self.reasoning.unwrap_or(0.0));
        let usd = cost(prompt_tokens, input) + cost(completion_tokens, output);
        to_nano(usd * self.ratio(prompt_tokens).max(1.0)).unwrap_or(u64::MAX)
    }

    /// True if all prices are numbers from 0 to 100,000 dollars, and a step has a ratio.
    #[must_use]
    pub fn is_sane(&self) -> bool {
        let all =
            [Some(self.input), Some(self.output), self.cached, self.cache_write, self.reasoning];
        all.into_iter().flatten().all(|price| (0.0..=PRICE_MAX).contains(&price))
            && self.step.is_none_or(|step| step.ratio.is_finite())
    }
}

/// Dollars for tokens.
fn cost(tokens: u64, price: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "prices are rounded anyway")]
    let tokens = tokens as f64;
    tokens * price / 1e6
}

impl FromStr for Price {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once(',').and_then(|(input, output)| {
            Some(Self::flat(input.trim().parse().ok()?, output.trim().parse().ok()?))
        });
        numbers.filter(Self::is_sane).ok_or_else(|| {
            "a price is two numbers, of a million tokens of prompts and of answers, like 0.15,0.6".to_owned()
        })
    }
}

/// What one call may spend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Value")]
pub enum Budget {
    /// Tokens of prompts and answers.
    Tokens(u64),
    /// Billionths of a US dollar.
    NanoUsd(u64),
}

impl FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let lower = text.trim().to_ascii_lowercase();
        let budget = match lower.strip_suffix("usd") {
            Some(money) => {
                let usd = money.trim().parse().ok().filter(|usd| *usd <= BUDGET_USD_MAX);
                usd.and_then(to_nano).filter(|nano| *nano > 0).map(Self::NanoUsd)
            }
            None => lower.parse().ok().filter(|tokens| *tokens > 0).map(Self::Tokens),
        };
        budget.ok_or_else(|| {
            format!(
                "{text:?} is no budget: tokens, such as 2000000, or US dollars, such as 5usd (more than 0, at most a million)"
            )
        })
    }
}

impl TryFrom<Value> for Budget {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        value.as_str().map_or_else(|| value.to_string().parse(), str::parse)
    }
}
