//! Correlations of metrics, as bars or as a heat map.

use anyhow::ensure;
use swarmbench_analysis::statistics::correlation;
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::TaskName;
use swarmbench_figures::Figure;
use swarmbench_figures::correlations::{Bars, Found, HeatMap};

use super::super::correlations::{SCORE, column, definition, of_paper, pairs};
use super::super::games::{Choice, Selected};
use super::super::play::task;
use super::{method, select};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    games: Choice,
    /// The task: correlations are never over games of several.
    #[arg(long, value_parser = task)]
    task: TaskName,
    /// All pairs of metrics, with the score as the last row.
    #[arg(long)]
    heat_map: bool,
    /// paper, or toolkit: what the public toolkit's scripts compute.
    #[arg(long, default_value = "paper", value_parser = definition)]
    definition: Definition,
}

pub(super) async fn figure(args: Args) -> anyhow::Result<Box<dyn Figure>> {
    let Args { games: choice, task, heat_map, definition } = args;
    let selected = select(&choice.with("task", task.name()), &["model"]).await?;
    let metrics: Vec<Metric> = of_paper().collect();
    let columns: Vec<String> = metrics.iter().map(|metric| column(*metric, definition)).collect();
    let method = method(&selected, definition, &columns)?;
    let Selected { games, chosen, mut notes } = selected;
    notes.push(method);
    let title = format!("{}: metrics and the final score", task.name());
    let names = metrics.iter().map(|metric| metric.about().title.to_owned());
    let found = |x: &str, y: &str| correlation(&pairs(&games, &chosen, x, y));
    if heat_map {
        let all: Vec<&str> = columns.iter().map(String::as_str).chain([SCORE]).collect();
        let row = |last: usize| all[..=last].iter().map(|other| found(other, all[last])).collect();
        let cells: Vec<Vec<Found>> = (0..all.len()).map(row).collect();
        check(cells.iter().flatten())?;
        let names = names.chain(["Score".to_owned()]).collect();
        return Ok(Box::new(HeatMap { title, notes, names, cells }));
    }
    let rows: Vec<(String, Found)> =
        names.zip(columns.iter().map(|column| found(column, SCORE))).collect();
    check(rows.iter().map(|(_, found)| found))?;
    Ok(Box::new(Bars { title, notes, rows }))
}

fn check<'a>(mut all: impl Iterator<Item = &'a Found>) -> anyhow::Result<()> {
    ensure!(
        all.any(Result::is_ok),
        "no correlation is defined: that takes at least three games that differ in score and metrics"
    );
    Ok(())
}
