//! Leaderboards and cross-play, as JSON and as CSV.

use std::collections::{BTreeMap, BTreeSet};

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_engine::TaskName;
use utoipa::ToSchema;

use crate::board::RowId;
use crate::board::collection::Ranked;
use crate::board::cross_play::Pair;
use crate::board::interval::Memory;
use crate::board::rank::Source;
use crate::board::result::TaskResult;

/// What is said of the rows of the paper.
const NOTE: &str = "a number of the paper, made with the public toolkit; not played here";

/// What is said of rows whose games were read from files.
const IMPORTED: &str = "games from files; not played here, and not verified";

/// A board, or a page of one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Leaderboard {
    /// The suite's name.
    #[schema(example = "standard")]
    pub suite: String,
    /// The first 12 hexadecimal digits of SHA-256 of the suite. Suites of the same name with other tasks, seeds,
    /// settings or rules have another one, and a board of their own.
    #[schema(example = "0123456789ab")]
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
    /// Rows, the highest first.
    pub items: Vec<BoardRow>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// A row of a board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoardRow {
    /// 1, 2, 2, 4. Null where the row has no value to be ranked by.
    pub rank: Option<u32>,
    /// The name of the row: the same player has the same in every board.
    pub id: String,
    /// Whether it is a row of the paper.
    pub reference: bool,
    /// Whether it shows games that were read from files.
    pub imported: bool,
    /// Of a row of the paper: `models`, `rules` or `humans`.
    pub table: Option<String>,
    /// Of a row that was not played here: where its numbers come from.
    pub note: Option<String>,
    /// Who answers for it; null where nobody showed a key.
    pub owner: Option<String>,
    /// The model's name.
    pub model: String,
    /// The sampling temperature, as declared.
    pub temperature: Option<f64>,
    /// The nucleus of sampling, as declared.
    pub top_p: Option<f64>,
    /// The first 12 hexadecimal digits of SHA-256 of the prompt template; null for the built-in one.
    pub prompt_template: Option<String>,
    /// False where nobody but its owner says that this was the model. Null for rows of the paper.
    pub vouched: Option<bool>,
    /// `declared` where one holder had all seats and could have pooled what they saw; `enforced` where that was not
    /// possible; null under centralized control, and for rows of the paper.
    pub decentralization: Option<String>,
    /// How many runs the player has on this board.
    pub runs: Option<u32>,
    /// The run that is shown; of several, which `mean` takes together, the last.
    pub run: Option<String>,
    /// How that run ended: `finished`, `aborted`, `abandoned` or `closed`. For `mean` one that is not `finished`,
    /// if there is one.
    pub status: Option<String>,
    /// When that run was started.
    #[schema(value_type = Option<String>, format = "date-time")]
    pub started_at: Option<Timestamp>,
    /// The sum of the means of the tasks that are shown; null where one has none.
    pub total: Option<f64>,
    /// The scores by task.
    pub tasks: BTreeMap<String, TaskScore>,
    /// How far it is below the nearest row above that was played here.
    pub difference: Option<RowDifference>,
    /// The share of invalid answers among all answers of players; null without answers.
    pub invalid_share: Option<f64>,
    /// The share of moves that timed out; null without moves.
    pub clock_out_share: Option<f64>,
    /// Voided games, which do not count.
    pub voided: Option<u32>,
}

/// The games of one task.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RowDifference {
    /// The `id` of the row above.
    pub to: String,
    /// By how much that one is better in the seeds that both have.
    pub mean: f64,
    /// The lower end of the interval that holds 95 % of 2,000 resamples of these seeds. Below 0 the order of the
    /// two is not sure. Null where a task has a single seed.
    pub low: Option<f64>,
    /// Its upper end; null where a task has a single seed.
    pub high: Option<f64>,
    /// How many seeds both have, over all tasks.
    pub pairs: u32,
}

/// A list that is written as JSON or as CSV.
pub trait Table: Serialize {
    /// An item of it.
    type Row: Serialize;

    /// How lines of CSV end.
    const LINES_END: csv::Terminator = csv::Terminator::CRLF;

    /// Its items.
    fn rows(&self) -> &[Self::Row];

    /// Where the next page begins.
    fn next_cursor(&self) -> Option<&str>;

    /// The names of the columns.
    fn columns(&self) -> Vec<String>;

    /// A row in these columns.
    fn record(&self, columns: &[String], row: &Self::Row) -> Vec<String>;

    /// All of it as CSV, a row for each item.
    fn csv(&self) -> String {
        let columns = self.columns();
        let records = self.rows().iter().map(|row| self.record(&columns, row));
        write_lines(std::iter::once(columns.clone()).chain(records), Self::LINES_END)
    }

    /// A row as a line of CSV.
    fn csv_line(&self, columns: &[String], row: &Self::Row) -> String {
        write_lines([self.record(columns, row)].into_iter(), Self::LINES_END)
    }
}

impl Leaderboard {
    /// A page of a board: `limit` rows from the place `start` on.
    #[must_use]
    pub fn page(ranked: &Ranked, start: usize, limit: usize, memory: &Memory) -> Self {
        let end = ranked.rows.len().min(start.saturating_add(limit));
        let items = (start..end).map(|place| BoardRow::of(ranked, place, memory)).collect();
        let last = ranked.rows[..end].last().filter(|_| end < ranked.rows.len());
        let name = |task: &TaskName| task.name().to_owned();
        Self {
            suite: ranked.board.suite.clone(),
            digest: ranked.board.digest.clone(),
            rules: ranked.board.rules.clone(),
            tasks: ranked.view.tasks.iter().map(name).collect(),
            sort: ranked.view.sort.as_ref().map_or_else(|| "total".to_owned(), name),
            pick: ranked.view.pick.name().to_owned(),
            rows: whole(ranked.rows.len()),
            items,
            next_cursor: last.map(|row| write_cursor(row.id(), end)),
        }
    }
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
            ["mean", "std", "games", "planned"]
                .map(|what| format!("{}_{what}", task.to_lowercase()))
        };
        let head = [
            "suite",
            "suite_digest",
            "rules",
            "rank",
            "reference",
            "imported",
            "table",
            "owner",
            "model",
        ];
        let declared = ["temperature", "top_p", "prompt_template", "vouched", "decentralization"];
        let runs = ["runs", "run", "status", "started_at", "total"];
        let difference = ["difference", "difference_low", "difference_high", "difference_pairs"];
        let wrong = ["invalid_share", "clock_out_share", "voided", "row", "difference_to"];
        let own = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        [
            own(&head),
            own(&declared),
            own(&runs),
            self.tasks.iter().flat_map(task).collect(),
            own(&difference),
            own(&wrong),
        ]
        .concat()
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
            maybe(row.clock_out_share),
            maybe(row.voided),
            text(&row.id),
            maybe(difference.map(|difference| text(&difference.to))),
        ]);
        cells
    }
}

impl BoardRow {
    fn of(ranked: &Ranked, place: usize, memory: &Memory) -> Self {
        let row = &ranked.rows[place];
        let tasks = ranked.view.tasks.iter();
        let difference = ranked.difference(place, memory).map(|(to, difference)| RowDifference {
            to: to.id().to_string(),
            mean: difference.mean,
            low: difference.is_known.then_some(difference.low),
            high: difference.is_known.then_some(difference.high),
            pairs: whole(difference.pairs),
        });
        let (total, rank, id) = (row.total(&ranked.view.tasks), row.rank, row.id().to_string());
        match &row.source {
            Source::Reference(reference) => Self {
                reference: true,
                table: Some(reference.table.name().to_owned()),
                tasks: tasks
                    .filter_map(|&task| {
                        let numbers = reference.task(task)?;
                        let score = TaskScore {
                            mean: Some(numbers.mean),
                            deviation: Some(numbers.deviation),
                            games: numbers.games,
                            planned: None,
                        };
                        Some((task.name().to_owned(), score))
                    })
                    .collect(),
                ..Self::not_played_here(rank, id, total, &reference.name, NOTE)
            },
            Source::Imported(shown) => Self {
                imported: true,
                vouched: Some(false),
                tasks: tasks
                    .filter_map(|&task| shown.task(task))
                    .map(|task| (task.task.name().to_owned(), score(task)))
                    .collect(),
                ..Self::not_played_here(rank, id, total, &shown.run.player.model, IMPORTED)
            },
            Source::Runs { shown, runs } => {
                let of: Vec<&TaskResult> = tasks.filter_map(|&task| shown.task(task)).collect();
                let sum =
                    |count: fn(&TaskResult) -> u64| of.iter().map(|task| count(task)).sum::<u64>();
                let answers = sum(|task| task.answers);
                let timeouts = sum(|task| task.timeouts);
                let run = &shown.run;
                Self {
                    rank,
                    id,
                    reference: false,
                    imported: false,
                    table: None,
                    note: None,
                    owner: run.player.owner.as_ref().map(|owner| owner.name.clone()),
                    model: run.player.model.clone(),
                    temperature: run.player.temperature,
                    top_p: run.player.top_p,
                    prompt_template: run.player.template.clone(),
                    vouched: Some(run.vouched),
                    decentralization: run.decentralization.map(|kind| kind.name().to_owned()),
                    runs: Some(whole(*runs)),
                    run: Some(run.id.clone()),
                    status: Some(run.status.clone()),
                    started_at: Some(run.created_at),
                    total,
                    tasks: of
                        .iter()
                        .map(|task| (task.task.name().to_owned(), score(task)))
                        .collect(),
                    difference,
                    invalid_share: share(sum(|task| task.invalid), answers),
                    clock_out_share: share(timeouts, answers + timeouts),
                    voided: Some(of.iter().map(|task| task.voided).sum()),
                }
            }
        }
    }

    /// A row that has numbers, and nothing behind them.
    fn not_played_here(
        rank: Option<u32>,
        id: String,
        total: Option<f64>,
        model: &str,
        note: &str,
    ) -> Self {
        Self {
            rank,
            id,
            reference: false,
            imported: false,
            table: None,
            note: Some(note.to_owned()),
            owner: None,
            model: model.to_owned(),
            temperature: None,
            top_p: None,
            prompt_template: None,
            vouched: None,
            decentralization: None,
            runs: None,
            run: None,
            status: None,
            started_at: None,
            total,
            tasks: BTreeMap::new(),
            difference: None,
            invalid_share: None,
            clock_out_share: None,
            voided: None,
        }
    }
}

fn score(task: &TaskResult) -> TaskScore {
    TaskScore {
        mean: task.mean(),
        deviation: task.mean_and_deviation.map(|(_, deviation)| deviation),
        games: Some(task.games),
        planned: Some(task.planned),
    }
}

#[expect(clippy::cast_precision_loss, reason = "nobody gives 2⁵³ answers")]
fn share(part: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| part as f64 / of as f64)
}

fn whole(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Where a page ends: the row, and its place, should it leave the board.
fn write_cursor(row: RowId, place: usize) -> String {
    format!("{row}-{place:x}")
}

/// Reads a cursor.
#[must_use]
pub fn read_cursor(text: &str) -> Option<(RowId, usize)> {
    let (row, place) = text.split_once('-')?;
    Some((RowId::parse(row)?, usize::from_str_radix(place, 16).ok()?))
}

/// Who did how well together, or a page of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CrossPlay {
    /// Pairs of models, by task, rules and settings, the best first.
    pub items: Vec<CrossPlayPair>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// Two models that played together, as different holders of seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CrossPlayPair {
    /// The task.
    pub task: String,
    /// The rule set.
    pub rules: String,
    /// All other settings but the seed: games with other ones are another pair.
    #[schema(value_type = Object)]
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// The two models, in order of their names. Twice the same where two holders played with it.
    pub models: [String; 2],
    /// False where in some of the games nobody but the holder says that this was the model.
    pub vouched: bool,
    /// Finished games in which both took part, perhaps beside others.
    pub games: u32,
    /// The mean score of these games.
    pub mean: f64,
    /// Its population standard deviation.
    pub deviation: f64,
}

impl CrossPlay {
    /// A page: `limit` pairs from the place `start` on.
    #[must_use]
    pub fn page(pairs: &[Pair], start: usize, limit: usize) -> Self {
        let start = start.min(pairs.len());
        let end = pairs.len().min(start.saturating_add(limit));
        Self {
            items: pairs[start..end].iter().map(CrossPlayPair::of).collect(),
            next_cursor: (end < pairs.len()).then(|| format!("c{end:x}")),
        }
    }

    /// The place of a cursor.
    #[must_use]
    pub fn read_cursor(text: &str) -> Option<usize> {
        usize::from_str_radix(text.strip_prefix('c')?, 16).ok()
    }
}

/// The first columns of cross-play; settings follow.
const PAIR_COLUMNS: [&str; 8] =
    ["task", "rules", "model_a", "model_b", "vouched", "games", "mean", "std"];

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
        PAIR_COLUMNS.map(str::to_owned).into_iter().chain(settings.into_iter().cloned()).collect()
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
        let settings = columns.iter().skip(PAIR_COLUMNS.len());
        cells.extend(settings.map(|name| match pair.settings.get(name) {
            None | Some(serde_json::Value::Null) => String::new(),
            Some(serde_json::Value::String(word)) => text(word),
            Some(other) => other.to_string(),
        }));
        cells
    }
}

impl CrossPlayPair {
    fn of(pair: &Pair) -> Self {
        Self {
            task: pair.setting.task.name().to_owned(),
            rules: pair.setting.rules.clone(),
            settings: serde_json::from_str(&pair.setting.settings).unwrap_or_default(),
            models: pair.models.clone(),
            vouched: pair.vouched,
            games: whole(pair.games),
            mean: pair.mean,
            deviation: pair.deviation,
        }
    }
}

fn maybe<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// A text as a cell. Names come from strangers, and spreadsheets run what begins like a formula: such a text gets an
/// apostrophe before it, which they do not show.
#[must_use]
pub fn text(cell: &str) -> String {
    if cell.trim_start().starts_with(['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠'])
    {
        format!("'{cell}")
    } else {
        cell.to_owned()
    }
}

pub(crate) fn write_csv(columns: &[String], records: impl Iterator<Item = Vec<String>>) -> String {
    write_lines(std::iter::once(columns.to_vec()).chain(records), csv::Terminator::CRLF)
}

fn write_lines(records: impl Iterator<Item = Vec<String>>, end: csv::Terminator) -> String {
    let mut csv = csv::WriterBuilder::new().terminator(end).from_writer(Vec::new());
    for record in records {
        csv.write_record(record)
            .expect("memory can be written, and all records have as many cells");
    }
    let bytes = csv.into_inner().expect("memory can be written");
    String::from_utf8(bytes).expect("texts and numbers")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spreadsheet_runs_a_name() {
        for formula in ["=1+1", "+1", "-1", "@SUM(A1)", "  =1", "\t=1", "\r=1", "＝1"] {
            assert_eq!(text(formula), format!("'{formula}"));
        }
        for name in ["gpt-4.1", "a=b", "'quoted'", "", "Ünï"] {
            assert_eq!(text(name), name);
        }
    }

    #[test]
    fn csv_holds_any_name() {
        let name = "a \"quoted\", name\nof two lines";
        let written = write_csv(
            &["x".to_owned(), "y".to_owned()],
            [vec![text(name), text("=2")]].into_iter(),
        );
        let mut reader = csv::Reader::from_reader(written.as_bytes());
        let record = reader.records().next().expect("a record").expect("well-formed");
        assert_eq!((&record[0], &record[1]), (name, "'=2"));
    }

    #[test]
    fn a_cursor_is_read_as_it_was_written() {
        let row = RowId([7; 16]);
        assert_eq!(read_cursor(&write_cursor(row, 50)), Some((row, 50)));
        for wrong in ["", "c1", "-", "0707-1", "zz-1", &format!("{row}-x")] {
            assert_eq!(read_cursor(wrong), None, "{wrong}");
        }
    }
}
