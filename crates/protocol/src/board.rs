//! Leaderboards and cross-play, as JSON and as CSV.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::act::UsageSums;
use super::failure::Failures;
use super::metrics::MetricsMethod;
use super::run::RunHolder;
use super::table::{Table, maybe, names, text};
use crate::time::Timestamp;

/// Board, or a page of one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Leaderboard {
    /// Name of the suite.
    #[cfg_attr(feature = "openapi", schema(example = "standard"))]
    pub suite: String,
    /// First 12 hexadecimal digits of SHA-256 of the suite. Suites of the same name with other tasks, seeds, settings or rules
    /// have another digest and a board of their own.
    #[cfg_attr(feature = "openapi", schema(example = "0123456789ab"))]
    pub digest: String,
    /// Rule set: `paper` or `reference`.
    pub rules: String,
    /// Tasks that are shown, in the order of the suite.
    pub tasks: Vec<String>,
    /// Value by which rows are ranked: `total`, or the name of a task for the mean of this task.
    pub sort: String,
    /// Run of a player that makes its row: `best`, `last` or `mean`.
    pub pick: String,
    /// Number of rows of the whole board.
    pub rows: u32,
    /// Requested metrics, in the requested order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Method by which the metrics were computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics_method: Option<MetricsMethod>,
    /// Rows, highest first.
    pub items: Vec<BoardRow>,
    /// Cursor of the next page; null on the last page.
    pub next_cursor: Option<String>,
}

/// Row of a board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct BoardRow {
    /// Rank: 1, 2, 2, 4. Null if the row has no value by which it could be ranked.
    pub rank: Option<u32>,
    /// Id of the row. A player has the same id on every board.
    pub id: String,
    /// Whether the row comes from the paper.
    pub reference: bool,
    /// Whether the row shows games that were read from files.
    pub imported: bool,
    /// Table of the paper: `models`, `rules` or `humans`; null for other rows.
    pub table: Option<String>,
    /// Source of the numbers; null for rows that were played here.
    pub note: Option<String>,
    /// Owner of the key; null without a key.
    pub owner: Option<String>,
    /// Name of the model.
    pub model: String,
    /// Sampling temperature, as declared.
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p), as declared.
    pub top_p: Option<f64>,
    /// Further sampling, as an evaluation declares it in `agent_meta.eval`: limits of tokens, effort and budget of the reasoning,
    /// and fields of `extra` such as `top_k`. Null without any.
    #[serde(default)]
    pub sampling: Option<String>,
    /// First 12 hexadecimal digits of SHA-256 of the prompt template; null for the built-in template.
    pub prompt_template: Option<String>,
    /// Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of `prompt_template`; `default:1` for the
    /// words of an earlier revision. A system message adds `+system:` and the first digits of its SHA-256. Null for built-in
    /// players and people, who read no prompt, and for rows of the paper and of files.
    #[serde(default)]
    pub prompt: Option<String>,
    /// Reader of answers: `last-marker`, `first-marker` or `json`; null for rows of the paper and of files.
    #[serde(default)]
    pub answer_reader: Option<String>,
    /// Whether the model is vouched for; false if only its owner declares it. Null for rows of the paper.
    pub vouched: Option<bool>,
    /// `declared` if one holder had all seats, and so could pool what they saw; `enforced` if each holder's token read its own
    /// seats alone, or the server played; null under centralized control, and for rows of the paper.
    pub decentralization: Option<String>,
    /// `human` if the owner declares that people played, by `agent_meta.kind`, and for the people of the paper; `team` if the
    /// seats belong to several holders; null for other rows.
    #[serde(default)]
    pub kind: Option<String>,
    /// Holders of a team, whose name is `model`; left out in other rows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holders: Vec<RunHolder>,
    /// Number of runs of the player on this board.
    pub runs: Option<u32>,
    /// Id of the run that is shown; with `mean`, of the last run.
    pub run: Option<String>,
    /// End of that run: `finished`, `aborted`, `abandoned` or `closed`. With `mean`: the end of a run that is not `finished`,
    /// if there is one.
    pub status: Option<String>,
    /// Time at which that run was started.
    pub started_at: Option<Timestamp>,
    /// Sum of the means of the tasks that are shown; null if one is missing.
    pub total: Option<f64>,
    /// Rule set by which the row was played.
    #[serde(default)]
    pub rules: String,
    /// Tasks whose scores were converted from the scale of those rules to that of the board.
    #[serde(default)]
    pub converted: Vec<String>,
    /// Tasks that those rules define in another way than the rules of the board, so that scores cannot simply be compared.
    #[serde(default)]
    pub other_rules: Vec<String>,
    /// Scores by task.
    pub tasks: BTreeMap<String, TaskScore>,
    /// Distance below the nearest row above that was played here.
    pub difference: Option<RowDifference>,
    /// Share of invalid answers among all answers of players; null without answers.
    pub invalid_share: Option<f64>,
    /// Invalid answers, counted by reason. Games of earlier versions did not record reasons.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = BTreeMap<String, u64>))]
    pub failures: Failures,
    /// Share of moves that timed out; null without moves.
    #[serde(default)]
    pub timeout_share: Option<f64>,
    /// Old name of `timeout_share`.
    pub clock_out_share: Option<f64>,
    /// Number of voided games, which do not count.
    pub voided: Option<u32>,
    /// Tokens of prompts in all games of the row, as players reported them; left out if they reported none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt_tokens: Option<u64>,
    /// Tokens of answers in all games of the row, as players reported them; left out if they reported none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion_tokens: Option<u64>,
    /// What else players reported in all games of the row. Left out if nothing was.
    #[serde(default, skip_serializing_if = "UsageSums::is_empty")]
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub usage: UsageSums,
    /// Mean cost of a game in US dollars; left out if no cost is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost_usd: Option<f64>,
    /// True if the cost of every answer is known: else `cost_usd` is less than the whole. Left out without a cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub costs_are_whole: Option<bool>,
    /// Requested metrics by task: means over the games of the run that is named in `run`. Null if no game has a value, or none
    /// was measured yet; empty for rows without a run.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

/// Games of one task.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskScore {
    /// Mean over the seeds.
    pub mean: Option<f64>,
    /// Population standard deviation over the seeds.
    pub deviation: Option<f64>,
    /// Games that were played and count.
    pub games: Option<u32>,
    /// Planned games, without voided ones. Planned games that were not played count as 0.
    pub planned: Option<u32>,
}

/// Distance of a row below another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RowDifference {
    /// The `id` of the row above; on the board of a competition, the id of the entrant.
    pub to: String,
    /// Difference in favour of the row above on the seeds that both have; in a task without such a seed, difference of the
    /// means.
    pub mean: f64,
    /// Lower end of the 95 % interval, by Student's t. If it is below 0, the order of the two rows is uncertain. Null if a task
    /// has fewer than three seeds that both have.
    pub low: Option<f64>,
    /// Upper end of the interval; null if `low` is null.
    pub high: Option<f64>,
    /// Number of seeds that both have, over all tasks.
    pub pairs: u32,
}

/// Last columns of a board before its metrics.
const SPENT: &str = "sampling prompt_tokens completion_tokens cached_tokens cache_write_tokens reasoning_tokens cost_usd \
     costs_are_whole holders";

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
        columns.chain(Failures::columns()).chain(names(SPENT)).chain(metrics).collect()
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
        // Rows whose answers were not counted have empty cells instead of zeros.
        let is_known = row.invalid_share.is_some();
        cells.extend(row.failures.cells().map(|cell| if is_known { cell } else { String::new() }));
        cells.push(maybe(row.sampling.as_deref().map(text)));
        let (usage, is_metered) = (&row.usage, row.prompt_tokens.is_some());
        cells.extend([maybe(row.prompt_tokens), maybe(row.completion_tokens)]);
        let parts = [usage.cached_tokens, usage.cache_write_tokens, usage.reasoning_tokens];
        cells.extend(parts.map(|part| maybe(is_metered.then_some(part))));
        cells.extend([maybe(row.cost_usd), maybe(row.costs_are_whole)]);
        cells.push(row.holders.iter().map(RunHolder::in_short).collect::<Vec<_>>().join("; "));
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
    /// Pairs of models, by task, rules and settings, best first.
    pub items: Vec<CrossPlayPair>,
    /// Cursor of the next page; null on the last page.
    pub next_cursor: Option<String>,
}

/// Two models that played together, as different holders of seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CrossPlayPair {
    /// Name of the task.
    pub task: String,
    /// Rule set: `paper` or `reference`.
    pub rules: String,
    /// All other settings except the seed. Games with other settings belong to another pair.
    #[cfg_attr(feature = "openapi", schema(value_type = Object))]
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// Names of the two models, in order; the same name twice if two holders used the same model.
    pub models: [String; 2],
    /// Whether both models are vouched for in all games; false if in one of them only the holder declares the model.
    pub vouched: bool,
    /// Number of finished games in which both took part, perhaps beside others.
    pub games: u32,
    /// Mean score of these games.
    pub mean: f64,
    /// Population standard deviation of these scores.
    pub deviation: f64,
}

/// First columns of cross-play; the settings follow.
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
