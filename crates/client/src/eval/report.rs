//! The results of an experiment, as a board: for people, for documents and for programs.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use swarmbench_engine::{Seed, TaskName};

use super::experiment::Shape;
use super::plan::{Plan, Planned, setting_text};
use swarmbench_journal::Tally;
use swarmbench_journal::record::Source;
use swarmbench_protocol::act::{Receipt, SwarmAct};
use swarmbench_protocol::failure::Failures;
use swarmbench_protocol::run::{ActTally, RunDetail, TaskResult};
use swarmbench_protocol::table::{names, text, write_csv};

/// The results of an experiment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExperimentReport {
    /// The name of the experiment.
    pub experiment: String,
    /// The purpose of the experiment.
    pub description: Option<String>,
    /// The settings that all runs share and that differ from the standard setting.
    pub settings: BTreeMap<&'static str, Value>,
    /// The settings that differ between runs.
    pub varied: Vec<&'static str>,
    /// The tasks.
    pub tasks: Vec<&'static str>,
    /// A row for each run.
    pub rows: Vec<ExperimentRow>,
}

/// A run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExperimentRow {
    /// The player's name.
    pub model: String,
    /// True if the player is a language model, not a built-in player.
    pub is_model: bool,
    /// The prompt of a language model: `default`, `toolkit`, `custom:` and a digest; in a team with the name of each model, where
    /// they differ; `None` for built-in players.
    pub prompt: Option<String>,
    /// The reader of its answers.
    pub answer_reader: String,
    /// The sampling beside temperature and `top_p`; `None` if nothing was set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sampling: Option<String>,
    /// The values of the varied settings, in the order of the report.
    pub varied: Vec<Option<Value>>,
    /// The id of the run.
    pub run: String,
    /// The status of the run.
    pub status: String,
    /// The seeds; `None` while they are sealed.
    pub seeds: Option<Vec<Seed>>,
    /// The seeds as people read them.
    #[serde(skip)]
    pub seeds_shown: String,
    /// The results, task by task.
    pub tasks: Vec<Cell>,
    /// The sum of the means, if the run played all tasks of the report.
    pub total: Option<f64>,
    /// Counts of its acts: those of games that have ended, and those that this call sent in the others.
    pub acts: ActTally,
    /// The cost in US dollars: as its acts have it, or else of its tokens by their price, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// True if all answers of models have a cost; otherwise the cost is less than the whole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost_is_whole: Option<bool>,
    /// True if a replay of all journals gave the same results.
    pub verified: bool,
}

/// The results of a run in one task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// The task.
    pub task: String,
    /// The mean over the seeds, once a game has ended.
    pub mean: Option<f64>,
    /// The population standard deviation over the seeds.
    pub deviation: Option<f64>,
    /// The lowest score of a game that has ended.
    pub least: Option<f64>,
    /// The highest score of a game that has ended.
    pub most: Option<f64>,
    /// Games that have ended and count.
    pub games: u32,
    /// Planned games.
    pub planned: u32,
}

/// The state of a run of a plan.
#[derive(Clone, Debug)]
pub struct Played {
    /// The planned run.
    pub planned: Planned,
    /// The run on the server.
    pub run: RunDetail,
    /// Acts that this call sent.
    pub sent: SentActs,
    /// True if all its journals were replayed.
    pub verified: bool,
}

/// The acts of a call, counted by their games: the server counts those of a game when it ends.
#[derive(Clone, Debug, Default)]
pub struct SentActs(BTreeMap<String, Tally>);

impl SentActs {
    /// Counts an act.
    pub fn note(&mut self, act: &SwarmAct, receipt: &Receipt) {
        if !receipt.duplicate {
            let tally = self.0.entry(act.episode.clone()).or_default();
            tally.count(Source::Player, receipt.valid, receipt.failure, act.usage.as_ref());
        }
    }

    /// All acts of a run, with those of games that have not ended.
    fn with_ended(&self, run: &RunDetail) -> ActTally {
        let mut acts = run.run.acts.clone();
        let open = run.games.iter().filter(|game| game.status == "running");
        for tally in open.filter_map(|game| self.0.get(game.episode.as_ref()?)) {
            acts.sent += tally.acts;
            acts.invalid += tally.invalid;
            acts.failures.add(tally.failures);
            acts.prompt_tokens = acts.prompt_tokens.saturating_add(tally.prompt_tokens);
            acts.completion_tokens = acts.completion_tokens.saturating_add(tally.completion_tokens);
            acts.usage.add(&tally.usage);
        }
        #[expect(clippy::cast_precision_loss, reason = "nobody sends 2⁵³ acts")]
        let share = (acts.sent > 0).then(|| acts.invalid as f64 / acts.sent as f64);
        acts.invalid_share = share;
        acts
    }
}

impl ExperimentReport {
    /// Builds the report of a plan.
    #[must_use]
    pub fn of(plan: &Plan, played: &[Played]) -> Self {
        Self {
            experiment: plan.name.clone(),
            description: plan.description.clone(),
            settings: plan.shared().into_iter().collect(),
            varied: plan.varied.clone(),
            tasks: plan.tasks.iter().map(|task| task.name()).collect(),
            rows: played.iter().map(|played| ExperimentRow::of(plan, played)).collect(),
        }
    }

    fn has_totals(&self) -> bool {
        self.tasks.len() > 1 && self.rows.iter().any(|row| row.total.is_some())
    }

    /// True if a language model played.
    fn has_models(&self) -> bool {
        self.rows.iter().any(|row| row.is_model)
    }

    /// True if the price of some model's tokens is known.
    fn has_costs(&self) -> bool {
        self.rows.iter().any(|row| row.cost.is_some())
    }

    /// True if the further sampling of a model was set.
    fn has_samplings(&self) -> bool {
        self.rows.iter().any(|row| row.sampling.is_some())
    }

    /// The reasons why answers did not count: a line for each run with such answers, the most frequent reason first.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let failing = self.rows.iter().filter(|row| !row.acts.failures.is_empty());
        failing
            .map(|row| {
                let (name, acts) = (row.name().join(" "), &row.acts);
                format!(
                    "{name}: {} of {} answers did not count: {}",
                    acts.invalid,
                    acts.sent,
                    acts.failures.words()
                )
            })
            .collect()
    }

    /// The board as headings and rows of text, for people.
    #[must_use]
    pub fn table(&self, shape: Shape) -> (Vec<String>, Vec<Vec<String>>) {
        let mut headings = vec!["model".to_owned()];
        headings.extend(self.varied.iter().map(|axis| axis.replace('_', " ")));
        headings.extend(self.has_samplings().then(|| "sampling".to_owned()));
        let mut add = |names: &[&str]| headings.extend(names.iter().map(|&name| name.to_owned()));
        let rows = match shape {
            Shape::Wide => {
                add(&self.tasks);
                if self.has_totals() {
                    add(&["total"]);
                }
                add(&["games"]);
                if self.has_models() {
                    add(&["invalid", "tokens in", "out"]);
                }
                if self.has_costs() {
                    add(&["cost"]);
                }
                self.rows.iter().map(|row| self.wide(row)).collect()
            }
            Shape::Long => {
                add(&["task", "mean ± deviation", "least", "most", "games", "seeds"]);
                self.rows.iter().flat_map(|row| self.long(row)).collect()
            }
        };
        (headings, rows)
    }

    /// The player, the varied settings and the further sampling.
    fn named(&self, row: &ExperimentRow) -> Vec<String> {
        let sampling = self.has_samplings().then(|| row.sampling.clone().unwrap_or_default());
        row.name().into_iter().chain(sampling).collect()
    }

    fn wide(&self, row: &ExperimentRow) -> Vec<String> {
        let mut cells = self.named(row);
        for task in &self.tasks {
            let cell = row.tasks.iter().find(|cell| cell.task == *task);
            cells.push(cell.map_or_else(String::new, Cell::score));
        }
        if self.has_totals() {
            cells.push(number(row.total));
        }
        let (games, planned): (u32, u32) =
            (row.tasks.iter()).fold((0, 0), |sum, cell| (sum.0 + cell.games, sum.1 + cell.planned));
        cells.push(of(games, planned));
        if self.has_models() {
            let share = row.acts.invalid_share;
            cells.push(share.map_or_else(String::new, |share| format!("{:.1} %", share * 100.0)));
            // Some endpoints report no usage.
            let tokens = [row.acts.prompt_tokens, row.acts.completion_tokens];
            let is_reported = tokens != [0, 0];
            cells.extend(
                tokens.map(|count| if is_reported { short(count) } else { "–".to_owned() }),
            );
        }
        if self.has_costs() {
            let mark = if row.cost_is_whole == Some(false) { "≥" } else { "" };
            cells.push(row.cost.map_or_else(String::new, |cost| format!("{mark}{cost:.2}")));
        }
        cells
    }

    fn long(&self, row: &ExperimentRow) -> Vec<Vec<String>> {
        let line = |cell: &Cell| {
            let mut cells = self.named(row);
            cells.extend([
                cell.task.clone(),
                cell.score(),
                number(cell.least),
                number(cell.most),
                of(cell.games, cell.planned),
                row.seeds_shown.clone(),
            ]);
            cells
        };
        row.tasks.iter().map(line).collect()
    }

    /// The board as a table in Markdown.
    #[must_use]
    pub fn markdown(&self, shape: Shape) -> String {
        let (headings, rows) = self.table(shape);
        let line = |cells: &[String]| {
            let cells: Vec<_> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = vec!["---".to_owned(); headings.len()];
        let rows = rows.iter().map(|row| line(row));
        let reasons = self.reasons().into_iter().map(|reason| format!("\n{reason}\n"));
        [line(&headings), line(&rule)].into_iter().chain(rows).chain(reasons).collect()
    }

    /// The board as comma-separated values: a line for each run and task, numbers in full precision.
    #[must_use]
    pub fn csv(&self) -> String {
        // A varied reader has its column before the task.
        let shows_reader = !self.varied.contains(&"answer_reader");
        let columns = names("experiment model")
            .chain(self.varied.iter().map(|&axis| axis.to_owned()))
            .chain(names(
                "task mean deviation least most games planned seeds run status verified run_acts run_invalid \
                 run_prompt_tokens run_completion_tokens run_cost prompt",
            ))
            .chain(shows_reader.then(|| "answer_reader".to_owned()))
            .chain(Failures::columns().map(|column| format!("run_{column}")))
            .chain(names("sampling"));
        let full =
            |number: Option<f64>| number.map_or_else(String::new, |number| number.to_string());
        let line = |row: &ExperimentRow, cell: &Cell| {
            let mut cells = vec![text(&self.experiment), text(&row.model)];
            cells.extend(row.varied().map(|value| text(&value.unwrap_or_default())));
            cells.extend([
                cell.task.clone(),
                full(cell.mean),
                full(cell.deviation),
                full(cell.least),
                full(cell.most),
                cell.games.to_string(),
                cell.planned.to_string(),
                row.seeds_shown.clone(),
                row.run.clone(),
                row.status.clone(),
                row.verified.to_string(),
                row.acts.sent.to_string(),
                row.acts.invalid.to_string(),
                row.acts.prompt_tokens.to_string(),
                row.acts.completion_tokens.to_string(),
                full(row.cost),
                row.prompt.clone().unwrap_or_default(),
            ]);
            cells.extend(shows_reader.then(|| row.answer_reader.clone()));
            cells.extend(row.acts.failures.cells());
            cells.push(text(row.sampling.as_deref().unwrap_or_default()));
            cells
        };
        let lines =
            self.rows.iter().flat_map(|row| row.tasks.iter().map(move |cell| line(row, cell)));
        write_csv(&columns.collect::<Vec<_>>(), lines)
    }

    /// The board as JSON.
    #[must_use]
    pub fn json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self).expect("a report has string keys");
        json.push('\n');
        json
    }
}

/// The cost of the acts of a run, and whether it is the whole: the sum of what is known, or else by a price that all models have.
fn cost(planned: &Planned, acts: &ActTally) -> Option<(f64, bool)> {
    let models = planned.models();
    let Some(known) = acts.usage.cost_usd() else {
        let (first, _) = models.first()?;
        let price =
            first.price.filter(|_| models.iter().all(|(model, _)| model.price == first.price))?;
        return Some((price.of(acts.prompt_tokens, acts.completion_tokens), true));
    };
    // Seats that the server plays act as often as the others, and cost nothing.
    let seats: usize = models.iter().map(|(_, seats)| *seats).sum();
    let all = u64::try_from(planned.suite.settings.num_agents).unwrap_or(1).max(1);
    Some((known, acts.usage.priced >= acts.sent * seats as u64 / all))
}

impl ExperimentRow {
    fn of(plan: &Plan, Played { planned, run, sent, verified }: &Played) -> Self {
        let cell = |result: &TaskResult| {
            let ended = run.games.iter().filter(|game| {
                game.task == result.task
                    && game.void_reason.is_none()
                    && !["planned", "running"].contains(&game.status.as_str())
            });
            let scores: Vec<f64> = ended.filter_map(|game| game.score).collect();
            Cell {
                task: result.task.clone(),
                mean: result.mean,
                deviation: result.deviation,
                least: scores.iter().copied().reduce(f64::min),
                most: scores.iter().copied().reduce(f64::max),
                games: result.played,
                planned: result.planned,
            }
        };
        let acts = sent.with_ended(run);
        let cost = cost(planned, &acts);
        let plays = |task: &TaskName| run.run.suite.tasks.iter().any(|own| own == task.name());
        Self {
            model: planned.name(),
            is_model: !planned.models().is_empty(),
            prompt: planned.prompts(),
            answer_reader: planned.suite.settings.answer_reader.clone(),
            sampling: planned.further_sampling(),
            varied: plan.varied.iter().map(|axis| planned.value(axis)).collect(),
            run: run.run.id.clone(),
            status: run.run.status.clone(),
            seeds: planned.entry.is_none().then(|| planned.suite.seeds.clone()),
            seeds_shown: planned.seeds(),
            tasks: run.run.tasks.iter().map(cell).collect(),
            total: run.run.total.filter(|_| plan.tasks.iter().all(plays)),
            cost: cost.map(|(cost, _)| cost),
            cost_is_whole: cost.map(|(_, is_whole)| is_whole),
            acts,
            verified: *verified,
        }
    }

    /// The player and the varied settings.
    fn name(&self) -> Vec<String> {
        let varied = self.varied().map(|value| value.unwrap_or_else(|| "–".to_owned()));
        std::iter::once(self.model.clone()).chain(varied).collect()
    }

    /// The values of the varied settings as texts.
    fn varied(&self) -> impl Iterator<Item = Option<String>> {
        self.varied.iter().map(|value| value.as_ref().map(setting_text))
    }
}

impl Cell {
    fn score(&self) -> String {
        match (self.mean, self.deviation) {
            (Some(mean), Some(deviation)) => format!("{mean:.2} ± {deviation:.2}"),
            _ => "–".to_owned(),
        }
    }
}

fn number(number: Option<f64>) -> String {
    number.map_or_else(String::new, |number| format!("{number:.2}"))
}

/// A part of a whole, as "3 of 5"; the number alone if they are equal.
fn of(part: u32, all: u32) -> String {
    if part == all { all.to_string() } else { format!("{part} of {all}") }
}

/// A count of tokens, abbreviated from 10,000 on.
#[must_use]
pub fn short(count: u64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "three digits are shown")]
    match count {
        0..10_000 => count.to_string(),
        10_000..1_000_000 => format!("{:.1}k", count as f64 / 1e3),
        _ => format!("{:.1}M", count as f64 / 1e6),
    }
}
