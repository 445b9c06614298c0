//! Report at the end of an evaluation.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use comfy_table::{CellAlignment, ColumnConstraint};
use serde_json::json;
use swarmbench_engine::{Seed, TaskName};

use super::estimate::{
    ESTIMATED, Estimate, PromptBytes, Recording, SEALED_ESTIMATE_SEED, estimate,
};
use crate::boards::{fit, short};
use crate::output::{self, table, wrapped};
use swarmbench_client::eval::experiment::Shape;
use swarmbench_client::eval::plan::{Plan, Planned, ranges, setting_text};
use swarmbench_client::eval::report::{ExperimentReport, Played, short as tokens};

/// Minimum columns of a terminal into which a model's name may be wrapped.
const NAME_COLUMNS: usize = 12;

/// Maximum other suites whose boards are named at the end.
const SUITES_TOLD: usize = 3;

#[derive(Debug, clap::Args)]
pub(super) struct Showing {
    /// The format of the board.
    #[arg(long, default_value = "table")]
    format: Format,
    /// Print JSON: the same as --format json.
    #[arg(long, conflicts_with = "format")]
    json: bool,
    /// The shape of the board: wide has a row per run and a column per task, long has a row per run and task, with minimum and
    /// maximum (wide).
    #[arg(long)]
    pub(super) board: Option<Board>,
    /// The file to write the board into, in the format of --format. The terminal shows a table in any case.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Format {
    Table,
    Markdown,
    Csv,
    Json,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(super) enum Board {
    Wide,
    Long,
}

impl From<Board> for Shape {
    fn from(board: Board) -> Self {
        match board {
            Board::Wide => Self::Wide,
            Board::Long => Self::Long,
        }
    }
}

impl Showing {
    const fn format(&self) -> Format {
        if self.json { Format::Json } else { self.format }
    }

    /// Checks, before hours of play, that the board can be written.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        if let Some(path) = &self.output {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let is_there = folder.is_none_or(std::path::Path::is_dir);
            ensure!(is_there && !path.is_dir(), "--output {}: no such folder", path.display());
        }
        Ok(())
    }

    /// Shows the board, if anything was played. An incomplete board is not written to a file.
    pub(super) fn show(
        &self,
        plan: &Plan,
        report: &ExperimentReport,
        is_whole: bool,
    ) -> anyhow::Result<()> {
        if report.rows.is_empty() {
            return Ok(());
        }
        if self.output.is_some() || self.format() == Format::Table {
            out!("{}", headline(plan));
            out!("{}", report_table(plan, report, terminal_width()));
            for reason in reasons(report, terminal_width()) {
                out!("{reason}");
            }
        }
        let text = match self.format() {
            Format::Table => {
                let board = report_table(plan, report, u16::MAX).to_string();
                let reasons = reasons(report, u16::MAX);
                let lines = [headline(plan), board].into_iter().chain(reasons);
                lines.map(|line| line + "\n").collect()
            }
            Format::Markdown => report.markdown(plan.shape),
            Format::Csv => report.csv(),
            Format::Json => report.json(),
        };
        match &self.output {
            Some(path) if is_whole => {
                std::fs::write(path, text).with_context(|| format!("{}", path.display()))?;
                note!("the board is in {}", path.display());
            }
            Some(path) => note!("not all games were played, so {} is not written", path.display()),
            None if self.format() == Format::Table => {}
            None => crate::output::data(&text),
        }
        Ok(())
    }

    pub(super) fn dry_run(&self, plan: &Plan, recorded: &Recording<'_>) -> anyhow::Result<()> {
        if self.format() == Format::Json {
            return output::json(&planned(plan, recorded)?);
        }
        show_planned(plan, recorded)
    }

    /// Names commands that show more.
    pub(super) fn tell_more(&self, plan: &Plan, played: &[Played], place: &str) {
        if self.format() != Format::Table && self.output.is_none() {
            return;
        }
        if let Some(entry) = plan.runs.iter().find_map(|run| run.entry.as_ref()) {
            let id = &entry.competition.id;
            note!(
                "means over the seeds ± population standard deviation; the others, as far as the board shows them:"
            );
            note!("  swarmbench competition board {id} {place}");
            return;
        }
        let suites: BTreeSet<_> = (played.iter())
            .map(|played| {
                let suite = &played.run.run.suite;
                let digest = suite.digest.as_ref().map(|digest| format!("@{digest}"));
                let is_usual = suite.name == "standard";
                let name =
                    format!("{}{}", suite.name, digest.filter(|_| !is_usual).unwrap_or_default());
                (name, suite.rules.clone())
            })
            .collect();
        note!(
            "means over the seeds ± population standard deviation; among others, with intervals:"
        );
        for (name, rules) in suites.iter().take(SUITES_TOLD) {
            let rules = if rules == "paper" { String::new() } else { format!(" --rules {rules}") };
            note!("  swarmbench leaderboard --suite '{name}'{rules} {place}");
        }
        if suites.len() > SUITES_TOLD {
            note!("  … and {} more suites", suites.len() - SUITES_TOLD);
        }
    }
}

/// Columns of the terminal; output elsewhere has lines of any length.
fn terminal_width() -> u16 {
    output::width()
}

/// One-line summary of the evaluation.
fn headline(plan: &Plan) -> String {
    let seeds: BTreeSet<Seed> =
        plan.runs.iter().flat_map(|run| run.suite.seeds.iter().copied()).collect();
    let seeds = ranges(&seeds.into_iter().collect::<Vec<_>>());
    let entry = plan.runs.iter().find_map(|run| run.entry.as_ref());
    let what = entry.map_or_else(
        || format!("{}: seeds {seeds}", plan.name),
        |entry| format!("{}, {}: {} sealed seeds", plan.name, entry.entrant.name, entry.seeds()),
    );
    let shared = plan.shared();
    let shared = shared.iter().map(|(axis, value)| format!(", {axis} {}", setting_text(value)));
    let prompts: BTreeSet<String> = (plan.runs.iter()).filter_map(Planned::prompts).collect();
    let prompts = prompts.into_iter().collect::<Vec<_>>().join(" and ");
    let prompts = if prompts.is_empty() { prompts } else { format!(", prompt {prompts}") };
    format!("{what}{}{prompts}", shared.collect::<String>())
}

/// The board in `width` columns. If it is wider, it gets a row for each task and drops columns until it fits, as a wrapped number
/// would be unreadable.
fn report_table(plan: &Plan, report: &ExperimentReport, width: u16) -> comfy_table::Table {
    let narrower: [(Shape, &[&str]); 4] = [
        (Shape::Long, &[]),
        (Shape::Long, &["seeds"]),
        (Shape::Long, &["seeds", "least", "most"]),
        (Shape::Long, &["seeds", "least", "most", "sampling"]),
    ];
    let (mut shown, mut least) = laid_out(report.table(plan.shape), &[]);
    for (shape, left_out) in narrower {
        if least <= width.into() {
            break;
        }
        (shown, least) = laid_out(report.table(shape), left_out);
    }
    fit(&mut shown, width);
    shown
}

/// Reasons for which answers did not count, in lines of at most `width` columns.
fn reasons(report: &ExperimentReport, width: u16) -> Vec<String> {
    report.reasons().iter().map(|reason| wrapped(reason, width.into())).collect()
}

/// A table in which only the first column may wrap, and its minimum width in columns of a terminal.
fn laid_out(
    (headings, rows): (Vec<String>, Vec<Vec<String>>),
    left_out: &[&str],
) -> (comfy_table::Table, usize) {
    let stays = |cells: &[String]| -> Vec<String> {
        let cells = headings.iter().zip(cells);
        let cells = cells.filter(|(heading, _)| !left_out.contains(&heading.as_str()));
        cells.map(|(_, cell)| cell.clone()).collect()
    };
    let named: Vec<String> = stays(&headings);
    let mut shown = table(&named.iter().map(|heading| short(heading)).collect::<Vec<_>>());
    for row in &rows {
        shown.add_row(stays(row));
    }
    for column in shown.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
        column.set_constraint(ColumnConstraint::ContentWidth);
    }
    let whole = shown.lines().next().map_or(0, |line| line.chars().count());
    let first = rows.iter().chain([&headings]).filter_map(|row| Some(row.first()?.chars().count()));
    let spare = first.max().unwrap_or(0).saturating_sub(NAME_COLUMNS);
    (shown, whole - spare)
}

/// The plan as JSON, run by run.
fn planned(plan: &Plan, recorded: &Recording<'_>) -> anyhow::Result<serde_json::Value> {
    let mut known = PromptBytes::default();
    let run = |run: &Planned| {
        let settings = plan.varied.iter().map(|axis| ((*axis).to_owned(), json!(run.value(axis))));
        let estimate = estimate(run, recorded, &mut known)?;
        let estimated = estimate.as_ref().map(|estimate| {
            json!({
                "prompt_tokens": estimate.prompt_tokens,
                "completion_tokens": estimate.completion_tokens,
                "cost": estimate.cost,
            })
        });
        anyhow::Ok(json!({
            "model": run.name(),
            "settings": settings.collect::<serde_json::Map<_, _>>(),
            "tasks": run.suite.tasks,
            "seeds": run.entry.is_none().then_some(&run.suite.seeds),
            "games": run.games(),
            "asked_max": estimate.as_ref().map(|estimate| estimate.questions),
            "estimated": estimated,
        }))
    };
    let runs = plan.runs.iter().map(run).collect::<anyhow::Result<Vec<_>>>()?;
    Ok(json!({ "name": plan.name, "runs": runs }))
}

/// Prints the plan.
fn show_planned(plan: &Plan, recorded: &Recording<'_>) -> anyhow::Result<()> {
    out!("{}", headline(plan));
    let mut known = PromptBytes::default();
    let estimates = plan.runs.iter().map(|run| estimate(run, recorded, &mut known));
    let estimates = estimates.collect::<anyhow::Result<Vec<_>>>()?;
    let has_models = estimates.iter().any(Option::is_some);
    let has_costs = estimates.iter().flatten().any(|estimate| estimate.cost.is_some());
    let mut headings = vec!["model"];
    headings.extend(&plan.varied);
    headings.extend(["tasks", "seeds", "games", "asked at most"]);
    if has_models {
        headings.extend(["tokens in", "out"]);
    }
    if has_costs {
        headings.push("cost");
    }
    let mut shown = table(&headings);
    fit(&mut shown, terminal_width());
    let mut games = 0;
    let mut all = Estimate::default();
    for (run, estimate) in plan.runs.iter().zip(&estimates) {
        let mut cells = vec![run.name()];
        cells.extend(
            plan.varied.iter().map(|axis| run.setting(axis).unwrap_or_else(|| "–".to_owned())),
        );
        let count = run.games();
        games += count;
        let is_all = run.tasks().count() == TaskName::ALL.len();
        cells.extend([
            if is_all { "all".to_owned() } else { run.suite.tasks.join(", ") },
            run.seeds(),
            count.to_string(),
        ]);
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
        let estimate = estimate.as_ref();
        cells.push(or_dash(estimate.map(|estimate| estimate.questions.to_string())));
        if has_models {
            let tokens = [
                estimate.map(|estimate| tokens(estimate.prompt_tokens)),
                estimate.map(|estimate| tokens(estimate.completion_tokens)),
            ];
            cells.extend(tokens.map(or_dash));
        }
        if has_costs {
            let cost = estimate.and_then(|estimate| estimate.cost);
            cells.push(or_dash(cost.map(|cost| format!("{cost:.2}"))));
        }
        if let Some(estimate) = estimate {
            all.add(estimate);
        }
        shown.add_row(cells);
    }
    out!("{shown}");
    let runs = plan.runs.len();
    let asked = all.questions;
    out!("{runs} runs, {games} games; models would be asked at most {asked} times");
    if has_models {
        let (read, said) = (tokens(all.prompt_tokens), tokens(all.completion_tokens));
        let cost = all.cost.map_or_else(String::new, |cost| format!(", which cost {cost:.2}"));
        out!(
            "{}",
            wrapped(
                &format!("estimate: {read} tokens of prompts and {said} of answers{cost}"),
                terminal_width().into()
            )
        );
        out!("{}", wrapped(ESTIMATED, terminal_width().into()));
        if plan.runs.iter().any(|run| run.entry.is_some()) {
            out!("the seeds are sealed, so the estimate is of seed {SEALED_ESTIMATE_SEED}");
        }
    }
    out!("nothing was played: leave out --dry-run to play");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_is_broken_however_narrow_the_terminal() {
        let headings: Vec<String> =
            ["model", "noise", "task", "mean ± deviation", "least", "most", "games", "seeds"]
                .map(str::to_owned)
                .to_vec();
        let row = ["a-model-with-a-rather-long-name", "0.2", "Flocking", "11.25 ± 0.50", "10.00"];
        let row = row.iter().chain(&["12.00", "5", "27, 42, 57, 72, 87"]);
        let row: Vec<String> = row.map(|&cell| cell.to_owned()).collect();
        for left_out in [&[][..], &["seeds"], &["seeds", "least", "most"]] {
            let (mut shown, least) = laid_out((headings.clone(), vec![row.clone()]), left_out);
            fit(&mut shown, u16::try_from(least).expect("a width"));
            let drawn = shown.to_string();
            assert!(drawn.lines().all(|line| line.chars().count() <= least), "{least}\n{drawn}");
            assert!(drawn.contains(" 11.25 ± 0.50 "), "{drawn}");
            for (heading, cell) in headings.iter().zip(&row).skip(1) {
                assert_ne!(drawn.contains(cell), left_out.contains(&heading.as_str()), "{drawn}");
            }
        }
    }
}
