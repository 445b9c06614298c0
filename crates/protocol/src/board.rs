//! Leaderboards and cross-play, as JSON and as CSV.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::failure::Failures;
use super::metrics::MetricsMethod;
use super::table::{Table, maybe, names, text};
use crate::time::Timestamp;

/// A board, or a page of one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Leaderboard {
    /// The suite's name.
    #[cfg_attr(feature = "openapi", schema(example = "standard"))]
    pub suite: String,
    /// The first 12 hexadecimal digits of SHA-256 of the suite. Suites of the same name with other tasks, seeds,
    /// settings or rules have another one, and a board of their own.
    #[cfg_attr(feature = "openapi", schema(example = "0123456789ab"))]
    pub digest: String,
    /// The rule set: `paper` or `reference`.
    pub rules: String,
    /// The tasks that are shown, in the order of the suite.
    pub tasks: Vec<String>,
    /// What rows are ranked by: `total`, or the mean of this task.
    pub sort: String,
    /// Which run of a player makes its row: `best`, `last` or `mean`.
    pub pick: String,
    /// How many rows the whole board has.
    pub rows: u32,
    /// The metrics that were asked for, in that order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// How their values were computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics_method: Option<MetricsMethod>,
    /// Rows, the highest first.
    pub items: Vec<BoardRow>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// A row of a board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BoardRow {
    /// 1, 2, 2, 4. Null where the row has no value to be ranked by.
    pub rank: Option<u32>,
    /// The id of the row. A player has the same id on every board.
    pub id: String,
    /// Whether it is a row of the paper.
    pub reference: bool,
    /// Whether it shows games that were read from files.
    pub imported: bool,
    /// The table of the paper: `models`, `rules` or `humans`; null for other rows.
    pub table: Option<String>,
    /// The source of the numbers; null for rows that were played here.
    pub note: Option<String>,
    /// The owner of the key; null without a key.
    pub owner: Option<String>,
    /// The model's name.
    pub model: String,
    /// The sampling temperature, as declared.
    pub temperature: Option<f64>,
    /// The nucleus of sampling, as declared.
    pub top_p: Option<f64>,
    /// The first 12 hexadecimal digits of SHA-256 of the prompt template; null for the built-in one.
    pub prompt_template: Option<String>,
    /// The name of the prompt: `default`, `toolkit` or `custom:` and the first digits of `prompt_template`; `default:1` for
    /// the words of an earlier revision. A system message adds `+system:` and the first digits of its SHA-256. Null for
    /// built-in players and people, who read none, and for rows of the paper and of files.
    #[serde(default)]
    pub prompt: Option<String>,
    /// How answers were read: `last-marker` or `first-marker`; null for rows of the paper and of files.
    #[serde(default)]
    pub answer_reader: Option<String>,
    /// False if only its owner says that this was the model. Null for rows of the paper.
    pub vouched: Option<bool>,
    /// `declared` if one holder had all seats, and so could pool what they saw; `enforced` if that was impossible;
    /// null under centralized control, and for rows of the paper.
    pub decentralization: Option<String>,
    /// `human` if its owner declares that people played, by `agent_meta.kind`, and for the people of the paper; null for
    /// others.
    #[serde(default)]
    pub kind: Option<String>,
    /// How many runs the player has on this board.
    pub runs: Option<u32>,
    /// The run that is shown; with `mean`, the last one.
    pub run: Option<String>,
    /// How that run ended: `finished`, `aborted`, `abandoned` or `closed`. With `mean`: that of a run
    /// that is not `finished`, if there is one.
    pub status: Option<String>,
    /// When that run was started.
    pub started_at: Option<Timestamp>,
    /// The sum of the means of the tasks that are shown; null if one is missing.
    pub total: Option<f64>,
    /// The rule set by which it was played.
    #[serde(default)]
    pub rules: String,
    /// The tasks whose scores were converted from the scale of those rules to that of the board.
    #[serde(default)]
    pub converted: Vec<String>,
    /// The tasks that those rules define in another way than the rules of the board, so that scores cannot simply be
    /// compared.
    #[serde(default)]
    pub other_rules: Vec<String>,
    /// The scores by task.
    pub tasks: BTreeMap<String, TaskScore>,
    /// How far it is below the nearest row above that was played here.
    pub difference: Option<RowDifference>,
    /// The share of invalid answers among all answers of players; null without answers.
    pub invalid_share: Option<f64>,
    /// How many answers were invalid, by the reason. Games of earlier versions do not tell it.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = BTreeMap<String, u64>))]
    pub failures: Failures,
    /// The share of moves that timed out; null without moves.
    #[serde(default)]
    pub timeout_share: Option<f64>,
    /// The old name of `timeout_share`.
    pub clock_out_share: Option<f64>,
    /// Voided games, which do not count.
    pub voided: Option<u32>,
    /// Of each task the metrics that were asked for: means over the games of the run that is named in `run`. Null where
    /// no game has a value, or none was measured yet; empty for rows without a run.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

/// The games of one task.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskScore {
    /// The mean over the seeds.
    pub mean: Option<f64>,
    /// The population standard deviation over the seeds.
    pub deviation: Option<f64>,
    /// Games that were played and count.
    pub games: Option<u32>,
    /// Planned games, without voided ones. Those that were not played count as 0.
    pub planned: Option<u32>,
}

/// How far a row is below another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RowDifference {
    /// The `id` of the row above; of the entrant, on the board of a competition.
    pub to: String,
    /// By how much that one is better on the seeds that both have; in a task without such a seed, by the means.
    pub mean: f64,
    /// The lower end of the interval of 95 %, by Student's t. If it is below 0, the order of the two rows is
    /// uncertain. Null if a task has fewer than three seeds that both have.
    pub low: Option<f64>,
    /// Its upper end; null where `low` is.
    pub high: Option<f64>,
    /// How many seeds both have, over all tasks.
    pub pairs: u32,
}

impl Table for Leaderboard {
    type Row = BoardRow;

    fn rows(&self) -> &[BoardRow] {
        &self.items
    }

    fn next_cursor(&self) -> Option<&str> {
        self.next_cursor.as_deref()
    }

    fn columns(&self) -> Vec<String> {
        let task = |task: &String| {
            ["mean", "deviation", "games", "planned"]
                .map(|what| format!("{}_{what}", task.to_lowercase()))
        };
        let columns = names(
            "suite suite_digest rules rank reference imported table owner model temperature top_p prompt_template \
             vouched decentralization runs run status started_at total",
        );
        let last = names(
            "difference difference_low difference_high difference_pairs invalid_share timeout_share voided row \
             difference_to row_rules converted other_rules kind prompt answer_reader",
        );
        let metrics = self.tasks.iter().flat_map(|task| {
            self.metrics.iter().map(move |metric| format!("{}_{metric}", task.to_lowercase()))
        });
        let columns = columns.chain(self.tasks.iter().flat_map(task)).chain(last);
        columns.chain(Failures::columns()).chain(metrics).collect()
    }

    fn record(&self, _: &[String], row: &BoardRow) -> Vec<String> {
        let mut cells = vec![
            text(&self.suite),
            text(&self.digest),
            text(&self.rules),
            maybe(row.rank),
            row.reference.to_string(),
            row.imported.to_string(),
            maybe(row.table.as_deref().map(text)),
            maybe(row.owner.as_deref().map(text)),
            text(&row.model),
            maybe(row.temperature),
            maybe(row.top_p),
            maybe(row.prompt_template.as_deref().map(text)),
            maybe(row.vouched),
            maybe(row.decentralization.as_deref().map(text)),
            maybe(row.runs),
            maybe(row.run.as_deref().map(text)),
            maybe(row.status.as_deref().map(text)),
            maybe(row.started_at),
            maybe(row.total),
        ];
        for task in &self.tasks {
            let score = row.tasks.get(task);
            cells.extend([
                maybe(score.and_then(|score| score.mean)),
                maybe(score.and_then(|score| score.deviation)),
                maybe(score.and_then(|score| score.games)),
                maybe(score.and_then(|score| score.planned)),
            ]);
        }
        let difference = row.difference.as_ref();
        cells.extend([
            maybe(difference.map(|difference| difference.mean)),
            maybe(difference.and_then(|difference| difference.low)),
            maybe(difference.and_then(|difference| difference.high)),
            maybe(difference.map(|difference| difference.pairs)),
            maybe(row.invalid_share),
            maybe(row.timeout_share),
            maybe(row.voided),
            text(&row.id),
            maybe(difference.map(|difference| text(&difference.to))),
            text(&row.rules),
            row.converted.join(" "),
            row.other_rules.join(" "),
            maybe(row.kind.as_deref().map(text)),
            maybe(row.prompt.as_deref().map(text)),
            maybe(row.answer_reader.as_deref().map(text)),
        ]);
        // Nobody knows it of rows whose answers were not counted.
        let is_known = row.invalid_share.is_some();
        cells.extend(row.failures.cells().map(|cell| if is_known { cell } else { String::new() }));
        for task in &self.tasks {
            let of = row.metrics.get(task);
            cells.extend(
                self.metrics.iter().map(|metric| maybe(of.and_then(|of| *of.get(metric)?))),
            );
        }
        cells
    }
}

/// Cross-play: pairs of models and their scores, or a page of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CrossPlay {
    /// Pairs of models, by task, rules and settings, the best first.
    pub items: Vec<CrossPlayPair>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// Two models that played together, as different holders of seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CrossPlayPair {
    /// The task.
    pub task: String,
    /// The rule set.
    pub rules: String,
    /// All other settings except the seed. Games with other settings belong to another pair.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// The two models, in order of their names; the same name twice if two holders used the same model.
    pub models: [String; 2],
    /// False if in one of the games only the holder says that this was the model.
    pub vouched: bool,
    /// Finished games in which both took part, perhaps beside others.
    pub games: u32,
    /// The mean score of these games.
    pub mean: f64,
    /// Its population standard deviation.
    pub deviation: f64,
}

/// The first columns of cross-play; settings follow.
const PAIR_COLUMNS: &str = "task rules model_a model_b vouched games mean deviation";

impl Table for CrossPlay {
    type Row = CrossPlayPair;

    fn rows(&self) -> &[CrossPlayPair] {
        &self.items
    }

    fn next_cursor(&self) -> Option<&str> {
        self.next_cursor.as_deref()
    }

    fn columns(&self) -> Vec<String> {
        let settings: BTreeSet<&String> =
            self.items.iter().flat_map(|pair| pair.settings.keys()).collect();
        names(PAIR_COLUMNS).chain(settings.into_iter().cloned()).collect()
    }

    fn record(&self, columns: &[String], pair: &CrossPlayPair) -> Vec<String> {
        let mut cells = vec![
            text(&pair.task),
            text(&pair.rules),
            text(&pair.models[0]),
            text(&pair.models[1]),
            pair.vouched.to_string(),
            pair.games.to_string(),
            pair.mean.to_string(),
            pair.deviation.to_string(),
        ];
        let settings = columns.iter().skip(names(PAIR_COLUMNS).count());
        cells.extend(settings.map(|name| match pair.settings.get(name) {
            None | Some(serde_json::Value::Null) => String::new(),
            Some(serde_json::Value::String(word)) => text(word),
            Some(other) => other.to_string(),
        }));
        cells
    }
}
