//! Runs: requests and responses.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::Seconds;
use super::failure::Failures;
use super::problem::Limit;
use super::suite::Suite;
use crate::carried::Carried;
use crate::game_settings;
use crate::time::Timestamp;
use swarmbench_engine::{Seed, Settings};

/// What a run is to be. Everything but `suite` and `model` has a default.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"suite": "quick", "model": "my-model", "temperature": 0.7})))]
pub struct RunRequest {
    /// The name of a built-in suite, or one of your own.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub suite: Option<SuiteRequest>,
    /// `paper` or `reference`.
    #[cfg_attr(feature = "openapi", schema(default = "paper"))]
    #[serde(default, deserialize_with = "crate::any_case::rules")]
    pub rules: Option<String>,
    /// Which model plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(required, example = "my-model"))]
    pub model: Option<String>,
    /// The sampling temperature.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 10))]
    pub temperature: Option<f64>,
    /// The nucleus of sampling.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub top_p: Option<f64>,
    /// What else is known of who plays; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// A prompt template of the run's own; at most 32 KiB.
    pub prompt_template: Option<String>,
    /// How many games are open at a time.
    #[cfg_attr(feature = "openapi", schema(default = 4, minimum = 1, maximum = 64))]
    pub parallel: Option<u32>,
    /// A round's clock in seconds; none by default.
    #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
    pub round_deadline_s: Option<f64>,
    /// What a seat may overspend in all rounds of a game together, in seconds.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<f64>,
    /// Seconds without any act after which a game ends as abandoned, and its run with it.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<f64>,
    /// `public` or `owner`: who sees the run, and reads its games, before their end.
    #[cfg_attr(feature = "openapi", schema(default = "public"))]
    pub visibility: Option<String>,
    /// The built-in player with which the server plays all seats; `default` is each task's own. Such a run has no
    /// token.
    pub player: Option<String>,
}

/// Which games a run plays.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum SuiteRequest {
    /// The name of a built-in suite: `standard` or `quick`.
    Named(String),
    /// One of your own.
    Own(Box<OwnSuite>),
}

impl<'de> Deserialize<'de> for SuiteRequest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // An untagged enum does not name the field that is wrong.
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = SuiteRequest;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the name of a suite, or an object")
            }

            fn visit_str<E>(self, name: &str) -> Result<SuiteRequest, E> {
                Ok(SuiteRequest::Named(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SuiteRequest, A::Error> {
                OwnSuite::deserialize(MapAccessDeserializer::new(map))
                    .map(|suite| SuiteRequest::Own(Box::new(suite)))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// A suite of one's own: every task is played once on each seed.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"name": "two seeds", "tasks": ["Foraging"], "seeds": [1, 2], "settings": {"max_round": 50}})))]
pub struct OwnSuite {
    /// Its name: 1 to 100 characters, and not that of a built-in one.
    pub name: String,
    /// The tasks, in the order in which they are played; all five where they are left out.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
    /// The seeds, each 0 to 2⁵³ − 1.
    pub seeds: Vec<i64>,
    /// The settings of all games; those that are left out are those of the standard setting.
    pub settings: Option<OwnSettings>,
}

game_settings! {
    partial
    /// Settings of all games of a suite of one's own, as for an episode.
    #[serde_with::skip_serializing_none]
    #[derive(Clone, Debug, Default, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[serde(deny_unknown_fields)]
    pub struct OwnSettings {
        /// `decentralized` or `centralized`.
        #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
        #[serde(default, deserialize_with = "crate::any_case::control")]
        pub control: Option<String>,
        ..settings,
    }
}

/// A suite as it is shown. Only runs with the same name, digest and rules can be compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SuiteView {
    /// Its name.
    #[cfg_attr(feature = "openapi", schema(example = "standard"))]
    pub name: String,
    /// The first 12 hexadecimal digits of SHA-256 of the suite with its rules, seeds and settings. Null
    /// while the seeds are null.
    pub digest: Option<String>,
    /// `paper` or `reference`.
    pub rules: String,
    /// The tasks, in the order in which they are played.
    pub tasks: Vec<String>,
    /// The seeds; null while the caller may not know them.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<u64>>))]
    pub seeds: Option<Vec<Seed>>,
    /// Whether each task has seeds of its own: those of the first task come first in `seeds`.
    #[serde(default)]
    pub seeds_by_task: bool,
    /// How many games it has.
    pub games: u32,
    /// The settings of all games.
    pub settings: SuiteSettingsView,
}

game_settings! {
    complete
    /// The settings of all games of a suite.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[expect(missing_docs, reason = "the same as of an episode")]
    pub struct SuiteSettingsView {
        pub control: String,
        ..settings,
        pub round_deadline_s: Option<Seconds>,
        pub bank_s: Seconds,
    }
}

impl SuiteView {
    /// A suite, with its seeds or without.
    #[must_use]
    pub fn of(suite: &Suite, with_seeds: bool) -> Self {
        let settings = &suite.settings;
        let seconds = |millis| Seconds::of(std::time::Duration::from_millis(millis));
        Self {
            name: suite.name.clone(),
            // From the digest the seeds could be found by trying.
            digest: with_seeds.then(|| suite.digest()),
            rules: suite.rules.clone(),
            tasks: suite.tasks.clone(),
            seeds: with_seeds.then(|| suite.seeds.clone()),
            seeds_by_task: suite.seeds_by_task,
            games: u32::try_from(suite.tasks.len() * suite.seeds_each()).unwrap_or(u32::MAX),
            settings: SuiteSettingsView {
                round_deadline_s: settings.round_deadline_ms.map(seconds),
                bank_s: seconds(settings.bank_ms),
                ..SuiteSettingsView::from(&Settings::from(settings))
            },
        }
    }
}

/// The built-in suites.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SuiteList {
    /// Each suite by each rule set.
    pub items: Vec<SuiteView>,
    /// Always null: all suites are on one page.
    pub next_cursor: Option<String>,
}

/// A run as it is listed.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunSummary {
    /// Its id.
    #[cfg_attr(feature = "openapi", schema(example = "run_0199f0c2a1d87c3e9b5a4d6f10e2b3c4"))]
    pub id: String,
    /// `running`, `finished`, `aborted`, `abandoned` or `closed`.
    pub status: String,
    /// What is played.
    pub suite: SuiteView,
    /// The model that plays, as declared; temperature, `top_p` and `agent_meta` are declared, too.
    pub model: String,
    /// Its temperature.
    pub temperature: Option<f64>,
    /// Its nucleus of sampling.
    pub top_p: Option<f64>,
    /// What else is known of who plays.
    #[cfg_attr(feature = "openapi", schema(value_type = serde_json::Map<String, serde_json::Value>))]
    pub agent_meta: Carried,
    /// The digest of the prompt template; null for the built-in one.
    pub template_digest: Option<String>,
    /// The name of the prompt: `default`, `toolkit` or `custom:` and the first digits of `template_digest`; `default:1` for
    /// the words of an earlier revision. A system message adds `+system:` and the first digits of its SHA-256. `none` for
    /// built-in players and people, who read no prompts.
    #[serde(default)]
    pub prompt: String,
    /// The built-in player with which the server plays all seats.
    pub player: Option<String>,
    /// How many games are open at a time.
    pub parallel: u32,
    /// `public`, `owner` or `sealed`.
    pub visibility: String,
    /// The time without an act after which a game ends as abandoned.
    pub idle_timeout_s: Seconds,
    /// No new round begins at or after this time.
    pub closes_at: Option<Timestamp>,
    /// The number of the attempt, if the run belongs to a competition.
    pub attempt: Option<u32>,
    /// Why it was voided as an attempt, if it was.
    pub void_reason: Option<String>,
    /// When it was created.
    pub created_at: Timestamp,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
    /// How many games have ended and count.
    pub played: u32,
    /// How many games of the plan count.
    pub planned: u32,
    /// How many games were voided.
    pub voided: u32,
    /// The results, task by task.
    pub tasks: Vec<TaskResult>,
    /// The sum of the tasks' means; null while a mean is missing or the caller may not know it.
    pub total: Option<f64>,
    /// The acts of all games that have ended and count.
    pub acts: ActTally,
    /// The limit that keeps the run from opening more games now; null while no limit does.
    #[serde(default)]
    pub waits_for: Option<Limit>,
}

/// The result of a run in one task. While it is running these are means over what has ended; once it is over, a
/// game that was never played counts as 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskResult {
    /// The task.
    pub task: String,
    /// The mean score over the seeds.
    pub mean: Option<f64>,
    /// The population standard deviation over the seeds.
    pub deviation: Option<f64>,
    /// How many games have ended and count.
    pub played: u32,
    /// How many games of the plan count.
    pub planned: u32,
    /// How many games were voided.
    pub voided: u32,
}

/// Acts, counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ActTally {
    /// Acts that players sent.
    pub sent: u64,
    /// Invalid answers of language models among them.
    pub invalid: u64,
    /// The share of invalid answers in all acts that were sent; null before the first act.
    pub invalid_share: Option<f64>,
    /// Why they were invalid, by kind. Games of earlier versions do not tell it, so these may be fewer than `invalid`.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = std::collections::BTreeMap<String, u64>))]
    pub failures: Failures,
    /// How often a clock expired.
    #[serde(default)]
    pub timeouts: u64,
    /// The share of expired clocks in all acts that were due; null before the first act.
    #[serde(default)]
    pub timeout_share: Option<f64>,
    /// The old name of `timeouts`.
    pub clock_outs: u64,
    /// The old name of `timeout_share`.
    pub clock_out_share: Option<f64>,
    /// Tokens of prompts, as reported by players.
    pub prompt_tokens: u64,
    /// Tokens of answers, as reported by players.
    pub completion_tokens: u64,
}

/// A run with its games.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunDetail {
    /// The run.
    #[serde(flatten)]
    pub run: RunSummary,
    /// Its games in the order of the plan. A voided game comes before its replacement. If the answer would be too
    /// large, replaced games are left out, beginning with the first slot.
    pub games: Vec<RunGame>,
}

/// A game of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunGame {
    /// Its place in the plan, from 0.
    pub slot: u32,
    /// The task.
    pub task: String,
    /// The seed; null while the caller may not know it.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u64>))]
    pub seed: Option<Seed>,
    /// The id of its episode; null before it is opened.
    pub episode: Option<String>,
    /// The status of its episode; `planned` before it is opened.
    pub status: String,
    /// Why it ended; null before, and where the caller may not know it.
    pub reason: Option<String>,
    /// How many rounds were resolved.
    pub round: u32,
    /// The score so far; null before the game is opened, and while the caller may not know it.
    pub score: Option<f64>,
    /// Why it was voided, if it was.
    pub void_reason: Option<String>,
}

/// A new run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedRun {
    /// The run.
    #[serde(flatten)]
    pub run: RunDetail,
    /// A token for all seats of all its games, shown this once; null where the server itself plays.
    pub swarm_token: Option<String>,
}

/// A new token of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunToken {
    /// The run's id.
    pub id: String,
    /// A token for all seats of all its games, shown this once. The earlier one is revoked.
    pub swarm_token: String,
}

page! {
    /// A page of runs, newest first.
    RunList of RunSummary
}

/// One Server-Sent Event of a run, by the names of its fields. It is only described here: a stream writes its
/// events itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamedRunEvent {
    /// `game` or `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "game"))]
    pub event: String,
    /// JSON: a `RunGame`, or the `RunDetail` where it is `finished`.
    pub data: String,
}
