//! Games as rows of the table of episodes: the data of `table`.

mod settings;
mod source;

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::Arc;

use anyhow::{bail, ensure};
use data_encoding::HEXLOWER;
use serde_json::Value as Json;
use sha2::{Digest, Sha256};
use swarmbench_analysis::Metric;
use swarmbench_engine::{Control, RuleSet, TaskName};

use crate::dataset::rows::DatasetRow;
pub(super) use settings::Axes;
pub(super) use source::Choice;

/// Maximum games, as all are in memory.
const GAMES_MAX: usize = 100_000;

/// Maximum columns, including those from `agent_meta`.
const COLUMNS_MAX: usize = 500;

/// Bound of numbers, as squares of larger ones would be infinite.
const NUMBER_MAX: f64 = 1e100;

/// Maximum values or names that an error lists.
const SHOWN_MAX: usize = 8;

/// Minimum Jaro–Winkler similarity of names that are suggested.
const LIKE: f64 = 0.8;

/// Columns that no table uses: texts and times that differ in each game.
const LEFT_OUT: [&str; 7] =
    ["run", "models", "journal_head", "created_at", "started_at", "ended_at", "agent_meta"];

/// Columns that every table of episodes must have.
const NEEDED: [&str; 5] = ["episode", "task", "model", "status", "score"];

/// Keys of `agent_meta` that identify a run instead of telling how a player was asked.
const NO_SETTINGS: [&str; 2] = ["eval.identity", "eval.players"];

/// A cell. Numbers come before truth values, these before texts, and what is missing comes last.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Number(f64),
    Flag(bool),
    Text(Arc<str>),
    Missing,
}

/// Games by columns; a game is an index.
#[derive(Default)]
pub(super) struct Games {
    columns: BTreeMap<String, Vec<Value>>,
    /// Columns that tell how a player was asked: keys of `agent_meta`, the template of prompts, and the holders
    /// of a team.
    of_players: BTreeSet<String>,
    episodes: BTreeSet<String>,
    len: usize,
}

/// The games of a table, and notes on those left out.
pub(super) struct Selected {
    pub(super) games: Games,
    pub(super) chosen: Vec<usize>,
    pub(super) notes: Vec<String>,
}

/// A column and its accepted values.
#[derive(Clone, Debug)]
pub(super) struct Condition {
    column: String,
    values: Vec<String>,
}

impl Games {
    /// Adds the row of a game, unless the game was added before. Nested objects of `agent_meta` become columns such as
    /// `eval.max_tokens`, and width and height also become `map_size`.
    fn add(&mut self, row: DatasetRow) -> anyhow::Result<()> {
        for name in NEEDED {
            ensure!(
                row.contains_key(name),
                "a row has no column {name}: it is no table of episodes"
            );
        }
        let id = row["episode"].as_str().unwrap_or_default();
        if !self.episodes.insert(id.to_owned()) {
            return Ok(());
        }
        ensure!(
            self.len < GAMES_MAX,
            "there are more than {GAMES_MAX} games: select some with --from"
        );
        let meta = row.get("agent_meta").and_then(Json::as_str).unwrap_or("{}");
        for (key, value) in flat(meta)? {
            let name = if row.contains_key(&key) { format!("agent_meta.{key}") } else { key };
            self.of_players.insert(name.clone());
            self.set(name, &value)?;
        }
        if let Some(size) = row.get("width").zip(row.get("height")) {
            self.set("map_size".to_owned(), &format!("{}x{}", size.0, size.1).into())?;
        }
        for (name, value) in row {
            if name == "prompt" || name == "answer_reader" {
                self.of_players.insert(name.clone());
            }
            // Long texts are told apart by their digests.
            if name == "prompt_template" || name == "team_holders" {
                self.of_players.insert(name.clone());
                let digest = value.as_str().map(|text| HEXLOWER.encode(&Sha256::digest(text)[..4]));
                self.set(name, &digest.into())?;
            } else if !LEFT_OUT.contains(&name.as_str()) {
                self.set(name, &value)?;
            }
        }
        self.len += 1;
        Ok(())
    }

    /// Sets a cell of the game that is being added.
    fn set(&mut self, name: String, value: &Json) -> anyhow::Result<()> {
        let value = match value {
            Json::Null => Value::Missing,
            Json::Bool(flag) => Value::Flag(*flag),
            Json::Number(number) => {
                let number = number.as_f64().unwrap_or(f64::INFINITY);
                ensure!(number.abs() < NUMBER_MAX, "{name} is {number}, which is too large");
                // Adding 0 turns −0 into 0.
                Value::Number(number + 0.0)
            }
            Json::String(text) => Value::Text(printable(text).into()),
            Json::Array(_) | Json::Object(_) => Value::Text(value.to_string().into()),
        };
        let is_new = !self.columns.contains_key(&name);
        ensure!(
            !is_new || self.columns.len() < COLUMNS_MAX,
            "there are more than {COLUMNS_MAX} columns"
        );
        let cells = self.columns.entry(name).or_default();
        cells.resize(self.len, Value::Missing);
        cells.push(value);
        Ok(())
    }

    pub(super) fn value(&self, column: &str, game: usize) -> &Value {
        self.columns.get(column).and_then(|cells| cells.get(game)).unwrap_or(&Value::Missing)
    }

    pub(super) fn number(&self, column: &str, game: usize) -> Option<f64> {
        match self.value(column, game) {
            Value::Number(number) => Some(*number),
            Value::Flag(_) | Value::Text(_) | Value::Missing => None,
        }
    }

    /// Values of a column in order, each with its number of games.
    pub(super) fn counts(&self, column: &str, games: &[usize]) -> BTreeMap<&Value, usize> {
        let mut counts = BTreeMap::new();
        for &game in games {
            *counts.entry(self.value(column, game)).or_default() += 1;
        }
        counts
    }

    /// Splits games by their value of a column, in order.
    pub(super) fn groups(
        &self,
        column: &str,
        games: &[usize],
    ) -> BTreeMap<RankedValue, Vec<usize>> {
        let mut groups: BTreeMap<RankedValue, Vec<usize>> = BTreeMap::new();
        for &game in games {
            groups.entry(RankedValue::of(column, self.value(column, game))).or_default().push(game);
        }
        groups
    }

    /// # Errors
    /// If no game has a column of that name; the error lists the most similar names.
    pub(super) fn check_column(&self, column: &str) -> anyhow::Result<()> {
        if self.columns.contains_key(column) {
            return Ok(());
        }
        let likeness = |name: &str| strsim::jaro_winkler(column, name);
        let mut names: Vec<&str> = self.columns.keys().map(String::as_str).collect();
        names.retain(|name| likeness(name) > LIKE);
        names.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
        names.truncate(SHOWN_MAX);
        if names.is_empty() {
            bail!("no game has the column {column}");
        }
        bail!("no game has the column {column}; the most similar are {}", names.join(", "))
    }

    /// # Errors
    /// If the column cannot be averaged: it is not numeric, its metric is missing in these games, or its values were computed in
    /// different ways.
    pub(super) fn check_numbers(&self, column: &str, games: &[usize]) -> anyhow::Result<()> {
        let metric = metric_of(column);
        let is_metric = metric.is_some();
        if is_metric && !self.columns.contains_key(column) {
            bail!(
                "these games have no column {column}: they were exported by an earlier version; export them again with \
                 `swarmbench export FOLDER --format jsonl`"
            );
        }
        self.check_column(column)?;
        let other = games.iter().find_map(|game| match self.value(column, *game) {
            Value::Number(_) | Value::Missing => None,
            Value::Flag(_) => Some("a truth value"),
            Value::Text(_) => Some("text"),
        });
        if let Some(other) = other {
            bail!("{column} is {other}, and means are of numbers");
        }
        if is_metric {
            let valued: Vec<usize> =
                games.iter().copied().filter(|&game| self.number(column, game).is_some()).collect();
            let is_of_vectors = metric.is_some_and(|metric| metric.about().of_vectors);
            let computed = ["metrics_revision", "embedder"];
            for how in computed.into_iter().take(1 + usize::from(is_of_vectors)) {
                let counts = self.counts(how, &valued);
                if let Some(usual) = usual(&counts).filter(|_| counts.len() > 1) {
                    bail!(
                        "the values of {column} differ in {how}: {}. They are never in one table: select with --where \
                         {how}={usual}",
                        told(&counts)
                    );
                }
            }
        }
        Ok(())
    }
}

/// A text that is harmless to a terminal: control characters and marks of text direction are replaced.
fn printable(text: &str) -> String {
    let is_control =
        |c: char| c.is_control() || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    text.chars().map(|c| if is_control(c) { '\u{fffd}' } else { c }).collect()
}

/// Metric of a column, in either definition, or of its count of rounds.
fn metric_of(column: &str) -> Option<Metric> {
    let name = column.strip_prefix("toolkit_").unwrap_or(column);
    Metric::parse(name).or_else(|| Metric::parse(name.strip_suffix("_rounds")?))
}

/// The most frequent value.
fn usual<'a>(counts: &BTreeMap<&'a Value, usize>) -> Option<&'a Value> {
    counts.iter().max_by_key(|(_, games)| **games).map(|(value, _)| *value)
}

/// Values with their numbers of games, as text.
fn told(counts: &BTreeMap<&Value, usize>) -> String {
    let mut parts: Vec<String> = (counts.iter())
        .take(SHOWN_MAX)
        .map(|(value, games)| format!("{value} ({})", games_told(*games)))
        .collect();
    if counts.len() > SHOWN_MAX {
        parts.push(format!("and {} more", counts.len() - SHOWN_MAX));
    }
    parts.join(", ")
}

pub(super) fn games_told(games: usize) -> String {
    if games == 1 { "1 game".to_owned() } else { format!("{games} games") }
}

/// Columns of `agent_meta`: nested objects are flattened; other values that are not scalars stay JSON.
fn flat(meta: &str) -> anyhow::Result<Vec<(String, Json)>> {
    let Ok(Json::Object(meta)) = serde_json::from_str(meta) else {
        bail!("agent_meta is no JSON object: {meta:.100}");
    };
    let cells = meta.into_iter().flat_map(|(key, value)| match value {
        Json::Object(inner) => {
            inner.into_iter().map(|(name, value)| (format!("{key}.{name}"), value)).collect()
        }
        value => vec![(key, value)],
    });
    Ok(cells.filter(|(name, _)| !NO_SETTINGS.contains(&name.as_str())).collect())
}

/// A value with its rank in its column: tasks have the order of boards.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct RankedValue(Option<TaskName>, pub(super) Value);

impl RankedValue {
    pub(super) fn of(column: &str, value: &Value) -> Self {
        let task = match value {
            Value::Text(name) if column == "task" => TaskName::parse(name),
            _ => None,
        };
        Self(task, value.clone())
    }
}

impl Ord for Value {
    fn cmp(&self, other: &Self) -> Ordering {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => a.total_cmp(b),
            (Self::Flag(a), Self::Flag(b)) => a.cmp(b),
            (Self::Text(a), Self::Text(b)) => a.cmp(b),
            (Self::Missing, Self::Missing) => Ordering::Equal,
            (Self::Number(_), _) | (_, Self::Missing) | (Self::Flag(_), Self::Text(_)) => {
                Ordering::Less
            }
            (_, Self::Number(_)) | (Self::Missing, _) | (Self::Text(_), Self::Flag(_)) => {
                Ordering::Greater
            }
        }
    }
}

impl PartialOrd for Value {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Value {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Value {}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

/// Whole numbers become JSON numbers without decimals.
impl From<&Value> for Json {
    fn from(value: &Value) -> Self {
        match value {
            Value::Number(number) => {
                number.to_string().parse::<i64>().map_or_else(|_| Self::from(*number), Self::from)
            }
            Value::Flag(flag) => Self::from(*flag),
            Value::Text(text) => Self::from(&**text),
            Value::Missing => Self::Null,
        }
    }
}

/// Values are written as `--where` accepts them.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Flag(flag) => flag.fmt(f),
            Self::Text(text) => text.fmt(f),
            Self::Missing => "none".fmt(f),
        }
    }
}

impl std::str::FromStr for Condition {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (column, values) = text.split_once('=').ok_or("must look like view_size=5")?;
        let column = column.trim().to_owned();
        let named = |value: String| match column.as_str() {
            "task" => TaskName::canonical(value),
            "rules" => RuleSet::canonical(value),
            "control" => Control::canonical(value),
            _ => value,
        };
        let values = quoted(values)?.into_iter().map(named).collect();
        Ok(Self { column, values })
    }
}

/// Splits values at commas. A value with commas is in double quotes, as in CSV.
fn quoted(text: &str) -> Result<Vec<String>, &'static str> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let wrong = "has values that cannot be read: put one with commas into double quotes";
    match reader.records().next() {
        Some(Ok(record)) => Ok(record.iter().map(str::to_owned).collect()),
        Some(Err(_)) => Err(wrong),
        None => Ok(vec![String::new()]),
    }
}

/// One value in the syntax of `--where`.
fn one_value(value: &str) -> String {
    if value.contains([',', '"']) {
        format!("\"{}\"", value.replace('"', "\"\""))
    } else {
        value.to_owned()
    }
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values: Vec<String> = self.values.iter().map(|value| one_value(value)).collect();
        write!(f, "--where {}={}", self.column, values.join(","))
    }
}

impl Condition {
    fn holds(&self, value: &Value) -> bool {
        self.values.iter().any(|wanted| match value {
            Value::Number(number) => wanted.parse() == Ok(*number),
            Value::Flag(_) | Value::Text(_) | Value::Missing => *wanted == value.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_conditions_may_have_commas_and_names_any_case() {
        for (text, values, shown) in [
            ("temperature=0, 1", &["0", "1"][..], "--where temperature=0,1"),
            ("suite=\"a, b\",c", &["a, b", "c"], "--where suite=\"a, b\",c"),
            ("model=\"say \"\"x\"\"\"", &["say \"x\""], "--where model=\"say \"\"x\"\"\""),
            ("task=foraging,PURSUIT", &["Foraging", "Pursuit"], "--where task=Foraging,Pursuit"),
            ("model=", &[""], "--where model="),
        ] {
            let condition: Condition = text.parse().expect("a condition");
            assert_eq!(condition.values, values, "{text}");
            assert_eq!(condition.to_string(), shown);
        }
    }
}
