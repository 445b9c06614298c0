//! Episodes, acts and rounds as rows of tables: one definition for JSON Lines and for Parquet.
//!
//! No column has a name that is a reserved word of SQL.

use std::sync::LazyLock;

use jiff::Timestamp;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};
use swarmbench_analysis::game::Heard;
use swarmbench_analysis::{Counts, Definition, Metric};
use swarmbench_engine::{AgentId, for_each_setting};

use super::game::{DatasetGame, GameAct, Turn, grid};
use super::header::Header;
use crate::store::metrics::{Measured, stored_method};
use crate::store::port::StoredEpisode;
use swarmbench_journal::Tally;
use swarmbench_journal::record::{RecordedConfig, Source};
use swarmbench_protocol::act::{Usage, UsageSums};
use swarmbench_protocol::failure::Failure;
use swarmbench_protocol::worth::GameWorth;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Text,
    Whole,
    Real,
    Flag,
    /// Milliseconds of UTC.
    Time,
}

/// Name and kind. Every value may be missing.
pub type Column = (&'static str, Kind);

#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[expect(missing_docs, reason = "the kinds of columns")]
pub enum Cell {
    Missing,
    Text(String),
    Whole(i64),
    Real(f64),
    Flag(bool),
    #[serde(serialize_with = "with_milliseconds")]
    Time(Timestamp),
}

/// Writes three digits after the second in all cases: readers infer the format of a column from its first value.
fn with_milliseconds<S: Serializer>(time: &Timestamp, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{time:.3}"))
}

swarmbench_engine::named! {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum TableName {
        /// One row per episode.
        Episodes = "episodes",
        /// One row per act.
        Acts = "acts",
        /// One row per state.
        Rounds = "rounds",
        /// One row per message that an agent received.
        Heard = "heard",
        /// One row per agent and state in which it decided: its window.
        Views = "views",
    }
}

impl TableName {
    pub fn columns(self) -> &'static [Column] {
        static EPISODES: LazyLock<Vec<Column>> = LazyLock::new(|| {
            [HEAD, SETTINGS, OF_EPISODES, &metrics_of_episodes(), WORTH_OF_EPISODES].concat()
        });
        static ACTS: LazyLock<Vec<Column>> =
            LazyLock::new(|| [HEAD, OF_ACTS, WORTH_OF_ACTS].concat());
        static ROUNDS: LazyLock<Vec<Column>> = LazyLock::new(|| {
            [HEAD, SETTINGS, OF_ROUNDS, &metrics_of_rounds(), WORTH_OF_ROUNDS].concat()
        });
        static HEARD: LazyLock<Vec<Column>> = LazyLock::new(|| [HEAD, OF_HEARD].concat());
        static VIEWS: LazyLock<Vec<Column>> = LazyLock::new(|| [HEAD, OF_VIEWS].concat());
        match self {
            Self::Episodes => &EPISODES,
            Self::Acts => &ACTS,
            Self::Rounds => &ROUNDS,
            Self::Heard => &HEARD,
            Self::Views => &VIEWS,
        }
    }
}

/// Metrics that the toolkit also computes.
fn of_toolkit() -> impl Iterator<Item = Metric> {
    Metric::ALL.into_iter().filter(|metric| metric.about().of_paper)
}

/// Whether a metric is a column of rounds: it has a value for each state and is not a count.
fn is_column(metric: Metric) -> bool {
    metric.about().by_round && !Counts::NAMES.contains(&metric.name())
}

/// Leaks the name of a column, which is composed only once.
fn name(text: String) -> &'static str {
    Box::leak(text.into_boxed_str())
}

fn metrics_of_episodes() -> Vec<Column> {
    let own = Metric::ALL.into_iter().flat_map(|metric| {
        let rounds = name(format!("{}_rounds", metric.name()));
        [(metric.name(), Kind::Real), (rounds, Kind::Whole)]
    });
    let toolkit =
        of_toolkit().map(|metric| (name(format!("toolkit_{}", metric.name())), Kind::Real));
    own.chain(toolkit).collect()
}

fn metrics_of_rounds() -> Vec<Column> {
    let has = |column: &str| OF_ROUNDS.iter().any(|(name, _)| *name == column);
    let counts = Counts::NAMES.into_iter().filter(|name| !has(name));
    let values = Metric::ALL
        .into_iter()
        .filter(|metric| is_column(*metric))
        .map(|metric| (metric.name(), Kind::Real));
    counts.map(|name| (name, Kind::Whole)).chain(values).collect()
}

const HEAD: &[Column] = &[
    ("episode", Kind::Text),
    ("run", Kind::Text),
    ("task", Kind::Text),
    ("model", Kind::Text),
    ("seed", Kind::Whole),
    ("rules", Kind::Text),
    ("control", Kind::Text),
    ("mixed", Kind::Flag),
];

const OF_EPISODES: &[Column] = &[
    ("models", Kind::Text),
    ("round_deadline_s", Kind::Real),
    ("bank_s", Kind::Real),
    ("start_mode", Kind::Text),
    ("idle_timeout_s", Kind::Real),
    ("visibility", Kind::Text),
    ("agent_meta", Kind::Text),
    ("prompt_template", Kind::Text),
    ("open_seats", Kind::Whole),
    ("fill_after_s", Kind::Real),
    ("fill_with", Kind::Text),
    ("player", Kind::Text),
    ("status", Kind::Text),
    ("reason", Kind::Text),
    ("score", Kind::Real),
    ("rounds", Kind::Whole),
    ("journal_head", Kind::Text),
    ("created_at", Kind::Time),
    ("started_at", Kind::Time),
    ("ended_at", Kind::Time),
    ("void_reason", Kind::Text),
    ("suite", Kind::Text),
    ("suite_digest", Kind::Text),
    ("acts", Kind::Whole),
    ("invalid", Kind::Whole),
    ("timeouts", Kind::Whole),
    ("prompt_tokens", Kind::Whole),
    ("completion_tokens", Kind::Whole),
    ("failed_refusal", Kind::Whole),
    ("failed_content_filter", Kind::Whole),
    ("failed_truncated", Kind::Whole),
    ("failed_tool_call", Kind::Whole),
    ("failed_reasoning_only", Kind::Whole),
    ("failed_rejected", Kind::Whole),
    ("failed_empty", Kind::Whole),
    ("failed_no_marker", Kind::Whole),
    ("failed_unknown_action", Kind::Whole),
    ("metrics_revision", Kind::Whole),
    ("embedder", Kind::Text),
    ("prompt", Kind::Text),
    ("answer_reader", Kind::Text),
    ("fork_of", Kind::Text),
    ("fork_round", Kind::Whole),
    ("team", Kind::Text),
    ("team_holders", Kind::Text),
    ("cached_tokens", Kind::Whole),
    ("cache_write_tokens", Kind::Whole),
    ("reasoning_tokens", Kind::Whole),
    ("cost_usd", Kind::Real),
    ("priced", Kind::Whole),
];

const OF_ACTS: &[Column] = &[
    ("round", Kind::Whole),
    ("agent", Kind::Whole),
    ("holder", Kind::Whole),
    ("player", Kind::Text),
    ("acted_at", Kind::Time),
    ("source", Kind::Text),
    ("i", Kind::Whole),
    ("j", Kind::Whole),
    ("action", Kind::Text),
    ("action_success", Kind::Flag),
    ("valid", Kind::Flag),
    ("failure", Kind::Text),
    ("message", Kind::Text),
    ("receiver", Kind::Text),
    ("response", Kind::Text),
    ("reasoning", Kind::Text),
    ("prompt_tokens", Kind::Whole),
    ("completion_tokens", Kind::Whole),
    ("latency_ms", Kind::Whole),
    ("bank_spent_ms", Kind::Whole),
    ("first_token_ms", Kind::Whole),
    ("cached_tokens", Kind::Whole),
    ("cache_write_tokens", Kind::Whole),
    ("reasoning_tokens", Kind::Whole),
    ("cost_usd", Kind::Real),
];

const OF_ROUNDS: &[Column] = &[
    ("round", Kind::Whole),
    ("resolved_at", Kind::Time),
    ("score", Kind::Real),
    ("alive", Kind::Whole),
    ("acts", Kind::Whole),
    ("invalid", Kind::Whole),
    ("timeouts", Kind::Whole),
    ("messages", Kind::Whole),
    ("grid", Kind::Text),
    ("positions", Kind::Text),
];

/// Columns of stored worths, the last ones of their tables: an export computes none.
const WORTH_OF_EPISODES: &[Column] = &[
    ("worth_start", Kind::Real),
    ("accuracy", Kind::Real),
    ("settled_round", Kind::Whole),
    ("worth_revision", Kind::Whole),
];
const WORTH_OF_ROUNDS: &[Column] = &[("worth", Kind::Real)];
const WORTH_OF_ACTS: &[Column] = &[("loss", Kind::Real)];

const OF_HEARD: &[Column] = &[
    ("round", Kind::Whole),
    ("receiver", Kind::Whole),
    ("sender", Kind::Whole),
    ("sent_round", Kind::Whole),
    ("message", Kind::Text),
    ("own", Kind::Flag),
];

const OF_VIEWS: &[Column] = &[("round", Kind::Whole), ("agent", Kind::Whole), ("view", Kind::Text)];

macro_rules! kind_of {
    (f64) => {
        Kind::Real
    };
    ($whole:ident) => {
        Kind::Whole
    };
}

macro_rules! define_settings {
    ({} $([$(
        $(#[doc = $doc:literal])* $(#[serde $later:tt])?
        $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
    )*] {})*) => {
        const SETTINGS: &[Column] = &[$($((stringify!($setting), kind_of!($checked)),)*)*];

        fn settings(config: &RecordedConfig) -> Vec<Cell> {
            vec![$($(config.$setting.into(),)*)*]
        }
    };
}

for_each_setting! { define_settings, {}, {} }

/// A row with its columns, serialized as a JSON object.
pub struct Named<'a>(pub &'a [Column], pub &'a [Cell]);

impl Serialize for Named<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for ((name, _), cell) in self.0.iter().zip(self.1) {
            map.serialize_entry(name, cell)?;
        }
        map.end()
    }
}

macro_rules! cells {
    ($($kind:ident: $($type:ty),*;)*) => {$($(
        impl From<$type> for Cell {
            fn from(value: $type) -> Self {
                Self::$kind(value.into())
            }
        }
    )*)*};
}

cells! {
    Text: String, &String, &str;
    Whole: i64, u32, u16, i32;
    Real: f64;
    Flag: bool;
    Time: Timestamp;
}

impl From<u64> for Cell {
    fn from(number: u64) -> Self {
        number.try_into().map_or(Self::Missing, Self::Whole)
    }
}

impl From<usize> for Cell {
    fn from(number: usize) -> Self {
        number.try_into().map_or(Self::Missing, Self::Whole)
    }
}

impl<T: Into<Self>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

/// The first cells of every row.
fn head(header: &Header, model: &str) -> Vec<Cell> {
    let config = &header.opening.config;
    vec![
        (&header.opening.episode).into(),
        header.opening.run.as_ref().into(),
        (&config.task).into(),
        model.into(),
        config.seed.get().into(),
        (&config.rules).into(),
        (&config.control).into(),
        header.is_mixed().into(),
    ]
}

#[expect(clippy::cast_precision_loss, reason = "at most a year")]
fn seconds(millis: u64) -> f64 {
    millis as f64 / 1000.0
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("string keys")
}

/// Facts about an episode that are not in its header.
pub struct Outcome {
    pub started_at: Option<Timestamp>,
    pub tally: Tally,
    /// Name and digest of its run's suite.
    pub suite: Option<(String, String)>,
    pub measured: Measured,
    /// The worth, if it is stored.
    pub worth: Option<GameWorth>,
}

pub fn episode(header: &Header, stored: &StoredEpisode, outcome: &Outcome) -> Vec<Cell> {
    let Outcome { started_at, tally, suite, measured, worth } = outcome;
    let Header { opening, .. } = header;
    let config = &opening.config;
    let template = config.custom_template.then_some(&opening.prompt_template);
    let mut cells = head(header, &config.model);
    cells.extend(settings(config));
    cells.extend([
        json(&header.models()).into(),
        config.round_deadline_ms.map(seconds).into(),
        seconds(config.bank_ms).into(),
        (&config.start).into(),
        seconds(config.idle_timeout_ms).into(),
        (&config.visibility).into(),
        json(&opening.agent_meta).into(),
        template.into(),
        config.open_seats.len().into(),
        config.fill_after_ms.map(seconds).into(),
        config.fill_with.as_ref().into(),
        config.player.as_ref().into(),
        (&stored.status).into(),
        stored.reason.as_ref().into(),
        stored.score.into(),
        stored.rounds.into(),
        stored.reason.as_ref().map(|_| stored.head.to_string()).into(),
        stored.created_at.into(),
        (*started_at).into(),
        stored.ended_at.into(),
        stored.void_reason.as_ref().into(),
        suite.as_ref().map(|(name, _)| name).into(),
        suite.as_ref().map(|(_, digest)| digest).into(),
        tally.acts.into(),
        tally.invalid.into(),
        tally.timeouts.into(),
        tally.prompt_tokens.into(),
        tally.completion_tokens.into(),
    ]);
    cells.extend(tally.failures.iter().map(|(_, count)| count.into()));
    let (embedder, revision) = stored_method();
    cells.extend([revision.into(), embedder.into()]);
    cells.extend([header.prompt_name().as_ref().into(), (&config.answer_reader).into()]);
    let fork = opening.fork.as_ref();
    cells.extend([fork.map(|fork| &fork.episode).into(), fork.map(|fork| fork.round).into()]);
    cells.push(header.team().map(|team| json(&team)).into());
    cells.push(header.team_holders().map(|holders| json(&holders)).into());
    let spent = &tally.usage;
    cells.extend([
        spent.cached_tokens.into(),
        spent.cache_write_tokens.into(),
        spent.reasoning_tokens.into(),
        spent.cost_usd().into(),
        spent.priced.into(),
    ]);
    for metric in Metric::ALL {
        let (value, rounds) = measured.value(Definition::Paper, metric);
        cells.extend([value.into(), rounds.into()]);
    }
    cells.extend(of_toolkit().map(|metric| measured.value(Definition::Toolkit, metric).0.into()));
    cells.extend([
        worth_at(worth.as_ref(), 0),
        worth.as_ref().and_then(|worth| worth.accuracy).into(),
        worth.as_ref().and_then(|worth| worth.settled_round).into(),
        worth.as_ref().map(|worth| worth.method.worth_revision).into(),
    ]);
    cells
}

/// The worth of a state.
fn worth_at(worth: Option<&GameWorth>, state: u32) -> Cell {
    let value = worth.and_then(|worth| worth.values.as_ref()?.get(state as usize).copied());
    value.into()
}

/// The row of a message delivered with the current state.
pub fn heard(game: &DatasetGame, heard: &Heard) -> Vec<Cell> {
    let sender = &game.header.holder(heard.sender).model;
    let mut cells = head(&game.header, sender);
    cells.extend([
        game.world().round().into(),
        heard.receiver.0.into(),
        heard.sender.0.into(),
        heard.sent.into(),
        (&heard.text).into(),
        (heard.receiver == heard.sender).into(),
    ]);
    cells
}

/// The row of a window that an agent saw when it decided the last played round; `None` once it has escaped.
pub fn view(game: &DatasetGame, turn: &Turn, agent: AgentId) -> Option<Vec<Cell>> {
    let rows = game.view(turn, agent)?;
    let rows: Vec<String> = rows.into_iter().map(|row| row.join(" ")).collect();
    let mut cells = head(&game.header, &game.header.holder(agent).model);
    cells.extend([turn.round.into(), agent.0.into(), rows.join("\n").into()]);
    Some(cells)
}

/// Cost of an answer in US dollars.
fn cost_usd(usage: &Usage) -> Option<f64> {
    let mut sums = UsageSums::NONE;
    sums.count(usage);
    sums.cost_usd()
}

/// The row of an act of the last played round.
pub fn act(game: &DatasetGame, turn: &Turn, act: &GameAct, worth: Option<&GameWorth>) -> Vec<Cell> {
    let record = &act.record;
    let holder = game.header.holder(act.agent);
    let at = turn.before.agent_states().nth(act.agent.index()).map(|state| state.at);
    let usage = record.usage.as_deref().copied().unwrap_or_default();
    let source = match record.source {
        Source::Player => "player",
        Source::Clock => "clock",
    };
    let mut cells = head(&game.header, &holder.model);
    cells.extend([
        turn.round.into(),
        act.agent.0.into(),
        holder.holder.into(),
        holder.player.as_ref().into(),
        act.at.into(),
        source.into(),
        at.map(|at| at.i).into(),
        at.map(|at| at.j).into(),
        record.action.as_ref().into(),
        act.took_effect.into(),
        record.valid.into(),
        record.failure.map(Failure::name).into(),
        record.message.as_ref().into(),
        record.to.as_ref().into(),
        record.response.as_ref().into(),
        record.reasoning.as_ref().into(),
        usage.prompt_tokens.into(),
        usage.completion_tokens.into(),
        usage.latency_ms.into(),
        record.bank_spent_ms.into(),
        usage.first_token_ms.into(),
        usage.cached_tokens.into(),
        usage.cache_write_tokens.into(),
        usage.reasoning_tokens.into(),
        cost_usd(&usage).into(),
    ]);
    let loss = worth.and_then(|worth| {
        let round = worth.losses.as_ref()?.get(turn.round as usize)?;
        round.seats.as_ref()?.get(&act.agent.to_string()).copied()
    });
    cells.push(loss.into());
    cells
}

/// The row of the current state. `turn` is the round that led to it; `None` at the layout.
pub fn round(
    game: &DatasetGame,
    turn: Option<&Turn>,
    created_at: Timestamp,
    (counts, values): (&Counts, &[Option<f64>; Metric::ALL.len()]),
    worth: Option<&GameWorth>,
) -> Vec<Cell> {
    let (config, world) = (&game.header.opening.config, game.world());
    let count = |wanted: &dyn Fn(&GameAct) -> bool| {
        turn.map(|turn| turn.acts.iter().filter(|act| wanted(act)).count()).into()
    };
    let grid: Vec<String> = grid(world).into_iter().map(|row| row.concat()).collect();
    let mut cells = head(&game.header, &config.model);
    cells.extend(settings(config));
    cells.extend([
        world.round().into(),
        turn.map_or(created_at, |turn| turn.at).into(),
        world.score().into(),
        world.agent_states().filter(|agent| agent.alive).count().into(),
        count(&|_| true),
        count(&|act| !act.record.valid),
        count(&|act| act.record.source == Source::Clock),
        count(&|act| act.record.message.is_some()),
        grid.join("\n").into(),
        json(&world.agent_states().map(|agent| [agent.at.i, agent.at.j]).collect::<Vec<_>>())
            .into(),
    ]);
    let has = |column: &str| OF_ROUNDS.iter().any(|(name, _)| *name == column);
    let counts = counts.columns(turn.is_none()).into_iter();
    cells.extend(counts.filter(|(name, _)| !has(name)).map(|(_, count)| count.into()));
    let values = Metric::ALL.into_iter().zip(values);
    cells.extend(values.filter(|(metric, _)| is_column(*metric)).map(|(_, value)| (*value).into()));
    cells.push(worth_at(worth, world.round()));
    cells
}
