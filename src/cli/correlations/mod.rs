//! `swarmbench correlations`

mod pairs;

use std::collections::BTreeMap;

use anyhow::ensure;
use swarmbench_analysis::statistics::{
    Correlation, NoCorrelation, by_models, correlation, float, q_values, stars,
};
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::TaskName;

use super::games::{Axes, Choice, Games, Selected, Value};
use super::sheet::{Cell, Column, Kind, Row, Sheet, Showing};
use pairs::{Pairs, pairs, within_tasks};

/// Metrics whose correlations with the score the paper shows: those that it draws.
fn of_paper() -> impl Iterator<Item = Metric> {
    Metric::ALL.into_iter().filter(|metric| metric.about().panel.is_some())
}

/// Failure modes of the paper: the metric of each and its task.
const FAILURES: [(TaskName, Metric); 3] = [
    (TaskName::Pursuit, Metric::DirectionImbalance),
    (TaskName::Synchronization, Metric::Components),
    (TaskName::Foraging, Metric::Separation),
];

/// Metrics of whether messages become alike during a game.
const CONVERGENCE: [Metric; 2] = [Metric::HomogeneityIncrease, Metric::EditConsistencyIncrease];

const SCORE: &str = "score";

#[derive(Debug, clap::Args)]
#[command(
    after_help = "r is Pearson's coefficient with its two-sided p (* below 0.05, ** below 0.01, *** below 0.001), q the false \
    discovery rate over all tests of a table, rho Spearman's coefficient. docs/evaluate/tables.md says how to read \
    these.\n\nExamples:\n  \
    swarmbench correlations --db swarmbench.db --where task=Pursuit\n  \
    swarmbench correlations --from games --matrix --format csv > matrix.csv\n  \
    swarmbench correlations --from games --convergence --format latex"
)]
pub(super) struct Args {
    /// The metrics: columns of the table of episodes. Default: the twelve of the paper.
    #[arg(long, value_name = "METRIC,…", value_delimiter = ',', conflicts_with_all = ["failures", "convergence"])]
    metrics: Vec<String>,
    /// The definition of metrics: paper, or toolkit for what the public toolkit's scripts compute.
    #[arg(long, default_value = "paper", value_parser = definition)]
    definition: Definition,
    /// Correlate all pairs of metrics, with the score as the last row.
    #[arg(long, conflicts_with_all = ["failures", "convergence"])]
    matrix: bool,
    /// Show the metrics of three failure modes, each in its task.
    #[arg(long, conflicts_with = "convergence")]
    failures: bool,
    /// Show whether messages become alike: by task, and by model over all tasks.
    #[arg(long)]
    convergence: bool,
    #[command(flatten)]
    games: Choice,
    #[command(flatten)]
    showing: Showing,
}

fn definition(name: &str) -> Result<Definition, &'static str> {
    Definition::parse(name).ok_or("must be paper or toolkit")
}

/// Column of a metric in the table of episodes.
fn column(metric: Metric, definition: Definition) -> String {
    match definition {
        Definition::Paper => metric.name().to_owned(),
        Definition::Toolkit => format!("toolkit_{}", metric.name()),
    }
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { metrics, definition, matrix, failures, convergence, games, showing } = args;
    let ignored = games.ignore.clone();
    let Selected { games, chosen, mut notes } = games.select().await?;
    let axes =
        Axes { apart: &["task", "model"].map(str::to_owned), ignored: &ignored, option: None };
    notes.extend(games.shared(&chosen, &axes)?);
    let column = |metric: &Metric| column(*metric, definition);
    let columns: Vec<String> = if failures {
        FAILURES.iter().map(|(_, metric)| column(metric)).collect()
    } else if convergence {
        CONVERGENCE.iter().map(column).collect()
    } else if metrics.is_empty() {
        of_paper().map(|metric| column(&metric)).collect()
    } else {
        metrics
    };
    for column in &columns {
        games.check_numbers(column, &chosen)?;
    }
    let tasks: Vec<(String, Vec<usize>)> = (games.groups("task", &chosen).into_iter())
        .map(|(task, games)| (task.1.to_string(), games))
        .collect();
    let of_tasks = tasks.iter().flat_map(|(task, chosen)| {
        columns.iter().map(move |column| (vec![task.clone(), column.clone()], chosen))
    });
    let heads = |first: &str| vec![first.to_owned(), "metric".to_owned()];
    let sheets = if matrix {
        tasks.iter().map(|(task, chosen)| all_pairs(&games, task, chosen, &columns)).collect()
    } else if failures {
        let is_failure = |heads: &[String]| {
            FAILURES.iter().any(|(task, metric)| heads == [task.name().to_owned(), column(metric)])
        };
        let rows = of_tasks.filter(|(heads, _)| is_failure(heads));
        let rows = rows.map(|(heads, chosen)| Test::of(&games, heads, chosen)).collect();
        vec![tested(None, heads("task"), rows)]
    } else if convergence {
        let by_task = of_tasks.map(|(heads, chosen)| Test::of(&games, heads, chosen)).collect();
        let models = games.groups("model", &chosen);
        let by_model = models.iter().flat_map(|(model, of_model)| {
            let games = &games;
            columns.iter().map(move |column| {
                let heads = vec![model.1.to_string(), column.clone()];
                Test::of_model(games, heads, of_model)
            })
        });
        vec![tested(None, heads("task"), by_task), tested(None, heads("model"), by_model.collect())]
    } else {
        let one = |(task, chosen): &(String, Vec<usize>)| {
            let test = |column: &String| Test::of(&games, vec![column.clone()], chosen);
            let group = Some(("task".to_owned(), task.clone()));
            tested(group, vec!["metric".to_owned()], columns.iter().map(test).collect())
        };
        tasks.iter().map(one).collect()
    };
    let has_any = |sheet: &Sheet| sheet.rows.iter().any(|row| row.cells.iter().any(is_coefficient));
    if !sheets.iter().any(has_any) {
        let why: Vec<String> = sheets.into_iter().flat_map(|sheet| sheet.notes).collect();
        ensure!(!why.is_empty(), "none of these games is of a task that has such a metric");
        anyhow::bail!("no correlation is defined: {}", why.join("; "));
    }
    if !matrix {
        notes.push(
            "intervals of 95 %. Games of one model are not independent: by models is the interval if \
             models are drawn"
                .to_owned(),
        );
    }
    showing.show(&sheets, &notes)
}

fn is_coefficient(cell: &Cell) -> bool {
    matches!(cell, Cell::Coefficient { .. } | Cell::Number(_))
}

/// A correlation of a metric with the score.
struct Test {
    heads: Vec<String>,
    found: Result<Correlation, NoCorrelation>,
    last: Last,
}

/// Content of the last column, beside the coefficient over all games.
enum Last {
    /// Confidence interval when models are resampled.
    Models(Option<(f64, f64)>),
    /// Coefficient of the values standardised within their tasks.
    Tasks(Option<Correlation>),
}

impl Test {
    /// Tests the metric that the last of `heads` names.
    fn of(games: &Games, heads: Vec<String>, chosen: &[usize]) -> Self {
        let column = heads.last().expect("the metric");
        let all = pairs(games, chosen, column, SCORE);
        let mut models: BTreeMap<_, Pairs> = BTreeMap::new();
        for (model, chosen) in games.groups("model", chosen) {
            models.insert(model, pairs(games, &chosen, column, SCORE));
        }
        let found = correlation(&all);
        let interval = found.is_ok().then(|| by_models(&models.into_values().collect::<Vec<_>>()));
        Self { heads, found, last: Last::Models(interval.flatten()) }
    }

    fn of_model(games: &Games, heads: Vec<String>, chosen: &[usize]) -> Self {
        let column = heads.last().expect("the metric");
        let found = correlation(&pairs(games, chosen, column, SCORE));
        let of_tasks = correlation(&within_tasks(games, chosen, column, SCORE)).ok();
        Self { heads, found, last: Last::Tasks(of_tasks) }
    }
}

fn coefficient(found: &Correlation) -> Cell {
    Cell::Coefficient { r: found.r, stars: stars(found.p) }
}

fn interval(interval: Option<(f64, f64)>) -> Cell {
    interval.map_or(Cell::Empty, |(low, high)| Cell::Interval(low, high))
}

/// A sheet with a row per test; q is computed over all of them.
fn tested(group: Option<(String, String)>, heads: Vec<String>, tests: Vec<Test>) -> Sheet {
    let is_by_model = tests.iter().any(|test| matches!(test.last, Last::Tasks(_)));
    let last = if is_by_model {
        ("r within tasks", Kind::Coefficient)
    } else {
        ("by models", Kind::Interval)
    };
    let columns = [
        ("r", Kind::Coefficient),
        ("p", Kind::Probability),
        ("q", Kind::Probability),
        ("interval", Kind::Interval),
        ("rho", Kind::Fixed(2)),
        ("n", Kind::Fixed(0)),
        last,
    ];
    let p: Vec<Option<f64>> = tests.iter().map(|test| Some(test.found.as_ref().ok()?.p)).collect();
    let mut undefined: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut rows = Vec::new();
    for (test, q) in tests.into_iter().zip(q_values(&p)) {
        let cells = match &test.found {
            Ok(found) => vec![
                coefficient(found),
                Cell::Number(found.p),
                q.map_or(Cell::Empty, Cell::Number),
                interval(found.interval),
                Cell::Number(found.rho),
                Cell::Number(float(found.n)),
                match &test.last {
                    Last::Models(models) => interval(*models),
                    Last::Tasks(found) => found.as_ref().map_or(Cell::Empty, coefficient),
                },
            ],
            Err(why) => {
                undefined.entry(told(*why)).or_default().push(test.heads.join(" "));
                vec![Cell::Empty; columns.len()]
            }
        };
        let heads = test.heads.iter().map(|head| head.as_str().into()).collect();
        rows.push(Row { heads, cells });
    }
    Sheet {
        heads,
        columns: columns.map(|(name, kind)| Column { name: name.to_owned(), kind }).to_vec(),
        rows,
        notes: notes(group.as_ref(), undefined),
        group,
    }
}

/// Reason for a missing coefficient.
fn told(why: NoCorrelation) -> String {
    match why {
        NoCorrelation::SecondConstant(n) => format!("the score is the same in all {n} games"),
        why => why.to_string(),
    }
}

/// A sentence for each reason, with the rows that it applies to.
fn notes(
    group: Option<&(String, String)>,
    undefined: BTreeMap<String, Vec<String>>,
) -> Vec<String> {
    let group = group.map(|(_, name)| format!("{name}, ")).unwrap_or_default();
    let note = |(why, which): (String, Vec<String>)| format!("{group}{}: {why}", which.join(", "));
    undefined.into_iter().map(note).collect()
}

/// Coefficients of all pairs of metrics in a task, and of each with the score.
fn all_pairs(games: &Games, task: &str, chosen: &[usize], metrics: &[String]) -> Sheet {
    let names: Vec<&str> = metrics.iter().map(String::as_str).chain([SCORE]).collect();
    let mut numbers: Vec<usize> = Vec::new();
    let mut rows = Vec::new();
    for (row, name) in names.iter().enumerate() {
        let cells = (0..metrics.len()).map(|column| {
            let found = correlation(&pairs(games, chosen, names[column], name));
            match found.ok().filter(|_| column < row) {
                Some(found) => {
                    numbers.push(found.n);
                    Cell::Number(found.r)
                }
                None => Cell::Empty,
            }
        });
        let cells = cells.collect();
        rows.push(Row { heads: vec![Value::Number(float(row + 1)), (*name).into()], cells });
    }
    let constant = names.iter().filter_map(|name| {
        let own = correlation(&pairs(games, chosen, name, name));
        Some((own.err()?.to_string(), (*name).to_owned()))
    });
    let mut undefined: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (why, name) in constant {
        undefined.entry(why).or_default().push(name);
    }
    let group = Some(("task".to_owned(), task.to_owned()));
    let mut notes = notes(group.as_ref(), undefined);
    if let Some((least, most)) = numbers.iter().min().zip(numbers.iter().max()) {
        notes.push(format!("{task}: each coefficient is over {least} to {most} games"));
    }
    let column = |number: usize| Column { name: number.to_string(), kind: Kind::Fixed(2) };
    Sheet {
        group,
        heads: vec!["no".to_owned(), "metric".to_owned()],
        columns: (1..=metrics.len()).map(column).collect(),
        rows,
        notes,
    }
}
