//! Correlations of metrics, as bars or as a heat map.

use anyhow::ensure;
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::TaskName;
use swarmbench_figures::Figure;
use swarmbench_figures::correlations::{Bars, Correlation, HeatMap};

use super::super::play::task;
use super::rows::{self, Game};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    games: rows::Selection,
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

fn definition(name: &str) -> Result<Definition, &'static str> {
    Definition::parse(name).ok_or("must be paper or toolkit")
}

/// Numbers of games, in their order; `None` where a game has none.
struct Quantity {
    name: String,
    values: Vec<Option<f64>>,
}

pub(super) fn figure(args: &Args) -> anyhow::Result<Box<dyn Figure>> {
    let mut games = args.games.games()?;
    games.retain(|game| game.task == args.task.name());
    let task = args.task.name();
    ensure!(!games.is_empty(), "there is no finished game of {task}");
    let definition = args.definition.name();
    let computed = rows::computed(&games)?;
    let notes = vec![rows::shared(&games, &[])?, format!("definition {definition}, {computed}")];
    let of_figures = Metric::ALL.into_iter().filter(|metric| metric.about().panel.is_some());
    let metrics: Vec<Quantity> =
        of_figures.map(|metric| quantity(&games, metric, args.definition)).collect();
    let score = Quantity {
        name: "Score".to_owned(),
        values: games.iter().map(|game| Some(game.score)).collect(),
    };
    let title = format!("{task}: metrics and the final score");
    if args.heat_map {
        let all: Vec<Quantity> = metrics.into_iter().chain([score]).collect();
        let row = |(place, a): (usize, &Quantity)| {
            all[..=place].iter().map(|b| correlate(a, b)).collect()
        };
        let cells: Vec<Vec<Correlation>> = all.iter().enumerate().map(row).collect();
        check(cells.iter().flatten())?;
        let names = all.iter().map(|quantity| quantity.name.clone()).collect();
        return Ok(Box::new(HeatMap { title, notes, names, cells }));
    }
    let row = |metric: &Quantity| (metric.name.clone(), correlate(metric, &score));
    let rows: Vec<(String, Correlation)> = metrics.iter().map(row).collect();
    check(rows.iter().map(|(_, correlation)| correlation))?;
    Ok(Box::new(Bars { title, notes, rows }))
}

fn quantity(games: &[Game], metric: Metric, definition: Definition) -> Quantity {
    let column = match definition {
        Definition::Paper => metric.name().to_owned(),
        Definition::Toolkit => format!("toolkit_{}", metric.name()),
    };
    let values = games.iter().map(|game| game.row.number(&column)).collect();
    Quantity { name: metric.about().title.to_owned(), values }
}

/// Of the games that have both numbers: the one place that asks the statistics.
fn correlate(a: &Quantity, b: &Quantity) -> Correlation {
    let both = a.values.iter().zip(&b.values).filter_map(|(a, b)| a.zip(*b));
    let pairs: Vec<(f64, f64)> = both.collect();
    Correlation { n: pairs.len(), ..Correlation::default() }
}

fn check<'a>(mut all: impl Iterator<Item = &'a Correlation>) -> anyhow::Result<()> {
    ensure!(
        all.any(|correlation| correlation.r.is_some()),
        "no correlation is defined: that takes at least three games that differ in score and metrics"
    );
    Ok(())
}
