//! Requests and responses for runs.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::Seconds;
use super::act::UsageSums;
use super::failure::Failures;
use super::problem::Limit;
use super::suite::Suite;
use crate::carried::Carried;
use crate::game_settings;
use crate::time::Timestamp;
use swarmbench_engine::{Seed, Settings};

/// Settings of a new run. All but `suite` and `model` have defaults.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"suite": "quick", "model": "my-model", "temperature": 0.7})))]
pub struct RunRequest {
    /// Name of a built-in suite, or a suite of your own.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub suite: Option<SuiteRequest>,
    /// Rule set: `paper` or `reference`.
    #[cfg_attr(feature = "openapi", schema(default = "paper"))]
    #[serde(default, deserialize_with = "crate::any_case::rules")]
    pub rules: Option<String>,
    /// Name of the model that plays; at most 200 characters.
    #[cfg_attr(feature = "openapi", schema(required, example = "my-model"))]
    pub model: Option<String>,
    /// Sampling temperature.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 10))]
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p).
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub top_p: Option<f64>,
    /// Further facts about the player; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// Prompt template of the run's own; at most 32 KiB.
    pub prompt_template: Option<String>,
    /// Number of games that are open at a time.
    #[cfg_attr(feature = "openapi", schema(default = 4, minimum = 1, maximum = 64))]
    pub parallel: Option<u32>,
    /// Clock of a round in seconds; none by default.
    #[cfg_attr(feature = "openapi", schema(minimum = 0.05, maximum = 86_400))]
    pub round_deadline_s: Option<f64>,
    /// Time that a seat may overspend in all rounds of a game together, in seconds.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<f64>,
    /// Seconds without any act after which a game ends as abandoned, and its run with it.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<f64>,
    /// Readers of the run and of its games before their end: `public` (anyone) or `owner` (the creator).
    #[cfg_attr(feature = "openapi", schema(default = "public"))]
    pub visibility: Option<String>,
    /// Built-in player with which the server plays all seats; `default` is each task's own player. Such a run has no token.
    pub player: Option<String>,
    /// Holders of a team: each plays its own seats of every game, with a token of its own; 1 to 64. Then `model` is the name of
    /// the team, and `player`, `temperature` and `top_p` are left out.
    pub holders: Option<Vec<HolderRequest>>,
}

/// Holder of a team, who plays some seats of every game of a run. Every seat has one holder.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"model": "my-model", "seats": [0, 1, 2]})))]
pub struct HolderRequest {
    /// Name within the team; that of the model by default. No two holders have the same.
    pub name: Option<String>,
    /// Numbers of its agents.
    pub seats: Vec<i64>,
    /// Name of the model that plays; at most 200 characters.
    pub model: Option<String>,
    /// Built-in player with which the server plays these seats; `default` is each task's own. Such a holder has no token.
    pub player: Option<String>,
    /// Sampling temperature.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 10))]
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p).
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub top_p: Option<f64>,
    /// Further facts about the player; at most 16 KiB of JSON, and 64 KiB of all holders together.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
}

/// Holder of a team, as it was declared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunHolder {
    /// Name within the team.
    pub name: String,
    /// Name of the model that plays.
    pub model: String,
    /// Numbers of its agents, in order.
    pub seats: Vec<u16>,
    /// Built-in player with which the server plays these seats.
    pub player: Option<String>,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p).
    pub top_p: Option<f64>,
    /// Further sampling, as of a run; null without any.
    #[serde(default)]
    pub sampling: Option<String>,
    /// Name of the prompt, with its harness, as of a run; null for players that read none.
    pub prompt: Option<String>,
    /// Further facts about the player; left out on boards, and before the end of the run for other holders.
    #[serde(default, skip_serializing_if = "Carried::is_empty")]
    #[cfg_attr(feature = "openapi", schema(value_type = serde_json::Map<String, serde_json::Value>))]
    pub agent_meta: Carried,
}

impl RunHolder {
    /// The `agent_meta` of the holder's seats: the declared sampling and further declarations.
    #[must_use]
    pub fn agent_meta_of_seats(&self) -> Carried {
        self.agent_meta.with(&[("temperature", self.temperature), ("top_p", self.top_p)])
    }

    /// Seats, model and what else tells it from another in a line, such as `0–8 my-model (effort low)`.
    #[must_use]
    pub fn in_short(&self) -> String {
        let mut ranges: Vec<(u16, u16)> = Vec::new();
        for &seat in &self.seats {
            match ranges.last_mut() {
                Some((_, last)) if *last + 1 == seat => *last = seat,
                _ => ranges.push((seat, seat)),
            }
        }
        let range = |(first, last): &(u16, u16)| {
            if first == last { first.to_string() } else { format!("{first}–{last}") }
        };
        let seats: Vec<String> = ranges.iter().map(range).collect();
        let further = [
            self.temperature.map(|temperature| format!("T {temperature}")),
            self.top_p.map(|top_p| format!("top_p {top_p}")),
            self.sampling.clone(),
            self.prompt
                .clone()
                .filter(|name| name != "default")
                .map(|name| format!("prompt {name}")),
        ];
        let further: Vec<String> = further.into_iter().flatten().collect();
        let who = format!("{} {}", seats.join(","), self.model);
        if further.is_empty() { who } else { format!("{who} ({})", further.join(", ")) }
    }
}

/// Suite of a run.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum SuiteRequest {
    /// Name of a built-in suite: `standard`, `quick` or `baselines`.
    Named(String),
    /// Suite of your own.
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

/// Suite of one's own: every task is played once on each seed.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({"name": "two seeds", "tasks": ["Foraging"], "seeds": [1, 2], "settings": {"max_round": 50}})))]
pub struct OwnSuite {
    /// Name of the suite: 1 to 100 characters, and not that of a built-in suite.
    pub name: String,
    /// Tasks, in the order in which they are played; all five by default.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
    /// Seeds, each 0 to 2⁵³ − 1.
    pub seeds: Vec<i64>,
    /// Settings of all games; settings that are left out are those of the standard setting.
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

/// Suite as it is shown. Only runs with the same name, digest and rules can be compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SuiteView {
    /// Name of the suite.
    #[cfg_attr(feature = "openapi", schema(example = "standard"))]
    pub name: String,
    /// First 12 hexadecimal digits of SHA-256 of the suite with its rules, seeds and settings. Null while the seeds are null.
    pub digest: Option<String>,
    /// Rule set: `paper` or `reference`.
    pub rules: String,
    /// Tasks, in the order in which they are played.
    pub tasks: Vec<String>,
    /// Seeds; null while the caller may not know them.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Vec<u64>>))]
    pub seeds: Option<Vec<Seed>>,
    /// Whether each task has its own seeds: those of the first task come first in `seeds`.
    #[serde(default)]
    pub seeds_by_task: bool,
    /// Number of games.
    pub games: u32,
    /// Settings of all games.
    pub settings: SuiteSettingsView,
}

game_settings! {
    complete
    /// Settings of all games of a suite.
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
    /// View of a suite, with its seeds or without.
    #[must_use]
    pub fn of(suite: &Suite, with_seeds: bool) -> Self {
        let settings = &suite.settings;
        let seconds = |millis| Seconds::of(std::time::Duration::from_millis(millis));
        Self {
            name: suite.name.clone(),
            // The digest would allow guessing the seeds by trial.
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

/// Built-in suites.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SuiteList {
    /// Suites, each by each rule set.
    pub items: Vec<SuiteView>,
    /// Always null: all suites are on one page.
    pub next_cursor: Option<String>,
}

/// Run as it is listed.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunSummary {
    /// Id of the run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0199f0c2a1d87c3e9b5a4d6f10e2b3c4"))]
    pub id: String,
    /// Status: `running`, `finished`, `aborted`, `abandoned` or `closed`.
    pub status: String,
    /// Suite of the run.
    pub suite: SuiteView,
    /// Name of the model that plays, as declared; temperature, `top_p` and `agent_meta` are declared, too.
    pub model: String,
    /// Sampling temperature.
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p).
    pub top_p: Option<f64>,
    /// Further sampling, as an evaluation declares it in `agent_meta.eval`; null without any.
    #[serde(default)]
    pub sampling: Option<String>,
    /// Further facts about the player.
    #[cfg_attr(feature = "openapi", schema(value_type = serde_json::Map<String, serde_json::Value>))]
    pub agent_meta: Carried,
    /// Digest of the prompt template; null for the built-in template.
    pub template_digest: Option<String>,
    /// Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of `template_digest`; `default:1` for the
    /// words of an earlier revision. A system message adds `+system:` and the first digits of its SHA-256. `none` for built-in
    /// players and people, who read no prompts.
    #[serde(default)]
    pub prompt: String,
    /// Built-in player with which the server plays all seats.
    pub player: Option<String>,
    /// Holders of a team; left out where one player has all seats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holders: Vec<RunHolder>,
    /// Number of games that are open at a time.
    pub parallel: u32,
    /// Visibility: `public`, `owner` or `sealed`.
    pub visibility: String,
    /// Seconds without any act after which a game ends as abandoned.
    pub idle_timeout_s: Seconds,
    /// Time from which no new round begins.
    pub closes_at: Option<Timestamp>,
    /// Number of the attempt, if the run belongs to a competition.
    pub attempt: Option<u32>,
    /// Reason for which the run was voided as an attempt; null if it was not.
    pub void_reason: Option<String>,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which the run ended; null before.
    pub ended_at: Option<Timestamp>,
    /// Number of games that have ended and count.
    pub played: u32,
    /// Number of games of the plan that count.
    pub planned: u32,
    /// Number of voided games.
    pub voided: u32,
    /// Results, task by task.
    pub tasks: Vec<TaskResult>,
    /// Sum of the tasks' means; null while a mean is missing or the caller may not know it.
    pub total: Option<f64>,
    /// Acts of all games that have ended and count.
    pub acts: ActTally,
    /// Limit that keeps the run from opening more games now; null while no limit does.
    #[serde(default)]
    pub waits_for: Option<Limit>,
}

/// Result of a run in one task. While the run is running, the values are means over the games that have ended; once it is over,
/// a game that was never played counts as 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskResult {
    /// Name of the task.
    pub task: String,
    /// Mean score over the seeds.
    pub mean: Option<f64>,
    /// Population standard deviation over the seeds.
    pub deviation: Option<f64>,
    /// Number of games that have ended and count.
    pub played: u32,
    /// Number of games of the plan that count.
    pub planned: u32,
    /// Number of voided games.
    pub voided: u32,
}

/// Counts of acts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ActTally {
    /// Acts that players sent.
    pub sent: u64,
    /// Invalid answers of language models among them.
    pub invalid: u64,
    /// Share of invalid answers in all acts that were sent; null before the first act.
    pub invalid_share: Option<f64>,
    /// Invalid answers, counted by reason. Games of earlier versions did not record reasons, so the sum may be less than
    /// `invalid`.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = std::collections::BTreeMap<String, u64>))]
    pub failures: Failures,
    /// Number of expired clocks.
    #[serde(default)]
    pub timeouts: u64,
    /// Share of expired clocks in all acts that were due; null before the first act.
    #[serde(default)]
    pub timeout_share: Option<f64>,
    /// Old name of `timeouts`.
    pub clock_outs: u64,
    /// Old name of `timeout_share`.
    pub clock_out_share: Option<f64>,
    /// Tokens of prompts, as reported by players.
    pub prompt_tokens: u64,
    /// Tokens of answers, as reported by players.
    pub completion_tokens: u64,
    /// What else players reported: tokens of caches and of reasoning, and the cost. Left out if nothing was.
    #[serde(default, skip_serializing_if = "UsageSums::is_empty")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub usage: UsageSums,
}

/// Run with its games.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunDetail {
    /// The run.
    #[serde(flatten)]
    pub run: RunSummary,
    /// Games in the order of the plan. A voided game comes before its replacement. If the answer would be too large, replaced
    /// games are left out, beginning with the first slot.
    pub games: Vec<RunGame>,
}

/// Game of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunGame {
    /// Place of the game in the plan, from 0.
    pub slot: u32,
    /// Name of the task.
    pub task: String,
    /// Seed of the game; null while the caller may not know it.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u64>))]
    pub seed: Option<Seed>,
    /// Id of the game's episode; null before it is opened.
    pub episode: Option<String>,
    /// Status of the episode; `planned` before it is opened.
    pub status: String,
    /// Reason of the end; null before, and if the caller may not know it.
    pub reason: Option<String>,
    /// Number of resolved rounds.
    pub round: u32,
    /// Score so far; null before the game is opened, and while the caller may not know it.
    pub score: Option<f64>,
    /// Reason for which the game was voided; null if it was not.
    pub void_reason: Option<String>,
}

/// New run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedRun {
    /// The run.
    #[serde(flatten)]
    pub run: RunDetail,
    /// Token for all seats of all games, shown only once; null if the server itself plays, and in a team.
    pub swarm_token: Option<String>,
    /// Tokens of a team's holders, shown only once; none for holders that the server plays.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holder_tokens: Vec<HolderToken>,
}

/// Token of a holder of a team.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct HolderToken {
    /// Name of the holder within its team.
    pub holder: String,
    /// Token for the holder's seats of all games.
    pub swarm_token: String,
}

/// New token of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunToken {
    /// Id of the run.
    pub id: String,
    /// Name of the holder in the run's team; left out where one player has all seats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<String>,
    /// Token for all seats of all games, or for those of the holder, shown only once. The earlier token is revoked.
    pub swarm_token: String,
}

page! {
    /// Page of runs, newest first.
    RunList of RunSummary
}

/// Fields of one Server-Sent Event of a run. This type only describes them: a stream writes its events itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamedRunEvent {
    /// Kind of the event: `game` or `finished`.
    #[cfg_attr(feature = "openapi", schema(example = "game"))]
    pub event: String,
    /// JSON: a `RunGame`, or in `finished` the `RunDetail`.
    pub data: String,
}
