//! Validation of requests, field by field: all errors are reported at once.

use std::time::Duration;

use super::App;
use super::error::ApiError;
use super::limits::Limits;
use crate::episode::spec::Visibility;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::names;
use swarmbench_protocol::problem::FieldProblem;

/// Maximum nesting of an `agent_meta`. Records that carry it are nested a little deeper, and JSON is read to a depth of 127.
pub(super) const AGENT_META_DEPTH_MAX: usize = 64;

/// Problems of one request that are named; a body of the largest size can have as many as it has numbers.
pub(super) const FIELD_PROBLEMS_MAX: usize = 100;

/// Problems found in a request so far.
#[derive(Default)]
pub(super) struct Problems {
    named: Vec<FieldProblem>,
    /// Number of those that are counted only.
    more: usize,
}

impl Problems {
    /// Adds the problem of a field.
    pub(super) fn refuse(&mut self, field: &str, problem: impl Into<String>) {
        if self.named.len() < FIELD_PROBLEMS_MAX {
            self.named.push(FieldProblem { field: field.to_owned(), problem: problem.into() });
        } else {
            self.more += 1;
        }
    }

    /// Adds the problem of a field, if there is one.
    pub(super) fn check(&mut self, field: &str, problem: Option<String>) {
        if let Some(problem) = problem {
            self.refuse(field, problem);
        }
    }

    /// The checked value, if there are no problems.
    pub(super) fn none_or<T>(mut self, checked: Option<T>) -> Result<T, ApiError> {
        if let (Some(last), more @ 1..) = (self.named.last_mut(), self.more) {
            let more = format!("; and {more} more problems (field_problems_max)");
            last.problem.push_str(&more);
        }
        match checked {
            Some(checked) if self.named.is_empty() => Ok(checked),
            _ => Err(ApiError::fields(self.named)),
        }
    }

    /// Seconds within bounds, as whole milliseconds.
    pub(super) fn seconds(
        &mut self,
        field: &str,
        value: Option<f64>,
        default: f64,
        low: f64,
        high: f64,
    ) -> Duration {
        let value = value.unwrap_or(default);
        if !(low..=high).contains(&value) {
            self.refuse(field, format!("must be from {low} to {high} seconds, is {value}"));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the range was checked"
        )]
        Duration::from_millis((value.clamp(low, high) * 1000.0).round() as u64)
    }

    /// The time limit of a round, if any, the time bank of a seat, and the idle timeout.
    pub(super) fn clocks(
        &mut self,
        round_deadline_s: Option<f64>,
        bank_s: Option<f64>,
        idle_timeout_s: Option<f64>,
    ) -> (Option<Duration>, Duration, Duration) {
        let bank = self.seconds("bank_s", bank_s, 0.0, 0.0, 604_800.0);
        let idle = self.seconds("idle_timeout_s", idle_timeout_s, 86_400.0, 1.0, 31_536_000.0);
        let round = round_deadline_s
            .map(|value| self.seconds("round_deadline_s", Some(value), 0.0, 0.05, 86_400.0));
        (round, bank, idle)
    }

    /// Visibility before the end. A creator cannot choose `sealed`.
    pub(super) fn visibility(&mut self, app: &App, name: Option<&str>) -> Option<Visibility> {
        let usual = if app.has_keys { Visibility::Owner } else { Visibility::Public };
        let name = name.unwrap_or(usual.name());
        let found = Visibility::ALL.into_iter().find(|known| known.name() == name);
        if found == Some(Visibility::Sealed) {
            self.refuse("visibility", "sealed is set by competitions only; use public or owner");
        } else if found.is_none() {
            let problem = format!("must be one of public, owner, is {:?}", short(name));
            self.refuse("visibility", problem);
        }
        found
    }

    /// Checks a player's name.
    pub(super) fn model(&mut self, limits: &Limits, model: &str) {
        if let Err(problem) = names::check_model(model, limits.name_chars_max) {
            self.refuse("model", problem);
        }
    }

    pub(super) fn text(&mut self, field: &str, text: &str, most: usize) {
        if let Err(problem) = names::check(text, most) {
            self.refuse(field, problem);
        }
    }

    /// Checks how a player is sampled.
    pub(super) fn sampling(&mut self, temperature: Option<f64>, top_p: Option<f64>) {
        for (field, value, most) in [("temperature", temperature, 10.0), ("top_p", top_p, 1.0)] {
            if let Some(value) = value.filter(|value| !(0.0..=most).contains(value)) {
                self.refuse(field, format!("must be from 0 to {most}, is {value}"));
            }
        }
    }

    /// Adds the problems of the fields of `object`.
    pub(super) fn add_within(&mut self, object: &str, Self { named, more }: Self) {
        for FieldProblem { field, problem } in named {
            self.refuse(&format!("{object}.{field}"), problem);
        }
        self.more += more;
    }

    /// Checks further declarations about the player.
    pub(super) fn agent_meta(&mut self, limits: &Limits, meta: &Carried) {
        let (bytes, most) = (meta.0.len(), limits.agent_meta_bytes_max);
        if bytes > most {
            let problem = format!("must be at most {most} bytes of JSON, is {bytes}");
            self.refuse("agent_meta", problem);
        }
        let (depth, most) = (meta.depth(), AGENT_META_DEPTH_MAX);
        if depth > most {
            let problem =
                format!("must be nested at most {most} deep (agent_meta_depth_max), is {depth}");
            self.refuse("agent_meta", problem);
        }
    }

    pub(super) fn template(&mut self, template: Option<&str>) {
        if let Some(template) = template
            && let Err(error) = swarmbench_prompt::check(template)
        {
            self.refuse("prompt_template", error.to_string());
        }
    }
}

/// Checks the reason of an action.
pub(super) fn checked_reason(app: &App, reason: String) -> Result<String, ApiError> {
    let mut problems = Problems::default();
    problems.text("reason", &reason, app.limits.reason_chars_max);
    problems.none_or(Some(reason))
}

/// The beginning of a text, for messages.
pub(super) fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// An unpredictable seed: 53 random bits.
pub(super) fn random_seed(app: &App) -> i64 {
    let mut bytes = [0; 8];
    app.entropy.fill(&mut bytes);
    i64::from_le_bytes(bytes) & ((1 << 53) - 1)
}
