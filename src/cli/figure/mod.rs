//! `swarmbench figure`

mod board;
mod correlations;
mod rows;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use swarmbench_analysis::Metric;
use swarmbench_analysis::metric::Panel;
use swarmbench_engine::TaskName;
use swarmbench_figures::dynamics::{Curve, Dynamics};
use swarmbench_figures::frame::Frames;
use swarmbench_figures::palette::STYLES;
use swarmbench_figures::sensitivity::{Point, Sensitivity};
use swarmbench_figures::series::{Band, Summary, whole_score};
use swarmbench_figures::{Figure, png, svg, trends};
use tokio_util::sync::CancellationToken;

use super::journals::{self, Journal, Outline};
use super::options::ServerArgs;
use super::output::{progress_bar, set};
use super::partial::Partial;
use super::play::task;
use rows::{Game, Series};

/// The most moments that stand side by side.
const MOMENTS_MAX: usize = 24;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The same games give the same bytes. docs/evaluate/figures.md shows every figure.\n\nExamples:\n  \
    swarmbench export games --format jsonl\n  \
    swarmbench figure trends --from games --out trends.svg --data trends.csv\n  \
    swarmbench figure dynamics --from games --task Pursuit --model my-model --out dynamics.png\n  \
    swarmbench figure frame game.jsonl --rounds 0,10,20 --out frames.svg"
)]
pub(super) struct Args {
    #[command(subcommand)]
    figure: Kind,
    /// The file to write: its name ends in .svg or .png.
    #[arg(long, global = true)]
    out: Option<PathBuf>,
    /// Also write the numbers behind the figure, as CSV.
    #[arg(long, global = true, value_name = "FILE")]
    data: Option<PathBuf>,
    /// Pixels of a PNG for each unit of the figure.
    #[arg(long, global = true, default_value_t = 2.0, value_parser = scale)]
    scale: f64,
}

#[derive(Debug, clap::Subcommand)]
enum Kind {
    /// How scores rise over a game: a panel a task, a line a model.
    Trends(rows::Selection),
    /// Score, messages, choices and positions of a model in a task, round by round.
    Dynamics(DynamicsArgs),
    /// Moments of a game: the map, and what the agents chose.
    Frame(FrameArgs),
    /// How metrics correlate with the final score.
    Correlations(correlations::Args),
    /// How the final score depends on two settings.
    Sensitivity(SensitivityArgs),
    /// Final scores: a row a model, a panel a task.
    Board(board::Args),
}

#[derive(Debug, clap::Args)]
struct DynamicsArgs {
    #[command(flatten)]
    games: rows::Selection,
    /// The task.
    #[arg(long, value_parser = task)]
    task: TaskName,
    /// The model.
    #[arg(long)]
    model: String,
}

#[derive(Debug, clap::Args)]
struct FrameArgs {
    /// A journal file, or the id of an episode on the server.
    game: String,
    /// The states to draw, such as 0,10,20.
    #[arg(long, required = true, value_delimiter = ',')]
    rounds: Vec<u32>,
    /// Show the messages below each map.
    #[arg(long)]
    messages: bool,
    #[command(flatten)]
    server: ServerArgs,
}

#[derive(Debug, clap::Args)]
struct SensitivityArgs {
    #[command(flatten)]
    games: rows::Selection,
    /// The setting along the horizontal axis.
    #[arg(long, default_value = "num_agents")]
    across: String,
    /// The setting in which the lines differ.
    #[arg(long, default_value = "view_size")]
    lines: String,
}

fn scale(text: &str) -> Result<f64, String> {
    let scale = text.parse::<f64>().ok().filter(|scale| (0.1..=20.0).contains(scale));
    scale.ok_or_else(|| "must be a number from 0.1 to 20".to_owned())
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { figure, out, data, scale } = args;
    let out = out.context("name the file with --out, such as --out figure.svg")?;
    let format = Format::of(&out)?;
    let figure: Box<dyn Figure> = match figure {
        Kind::Trends(games) => Box::new(trends(&games)?),
        Kind::Dynamics(args) => Box::new(dynamics(&args)?),
        Kind::Frame(args) => Box::new(frames(args).await?),
        Kind::Correlations(args) => correlations::figure(&args)?,
        Kind::Sensitivity(args) => Box::new(sensitivity(&args)?),
        Kind::Board(args) => Box::new(board::figure(args).await?),
    };
    let scene = figure.scene();
    match format {
        Format::Svg => Partial::write(&out, svg(&scene).as_bytes())?,
        Format::Png => Partial::write(&out, &png(&scene, scale)?)?,
    }
    if let Some(data) = data {
        Partial::write(&data, figure.data().csv().as_bytes())?;
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Format {
    Svg,
    Png,
}

impl Format {
    fn of(out: &Path) -> anyhow::Result<Self> {
        match out.extension().and_then(|end| end.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => bail!("{} must end in .svg or .png", out.display()),
        }
    }
}

/// The tasks that have games, in the usual order.
fn tasks(games: &[Game]) -> Vec<String> {
    let found: BTreeSet<&str> = games.iter().map(|game| game.task.as_str()).collect();
    let known = TaskName::ALL.map(TaskName::name).into_iter();
    known.filter(|task| found.contains(task)).map(str::to_owned).collect()
}

/// All models in the order of their names.
fn models(games: &[Game]) -> Vec<String> {
    let found: BTreeSet<&String> = games.iter().map(|game| &game.model).collect();
    found.into_iter().cloned().collect()
}

/// After how many rounds these games end at the latest.
fn max_round(games: &[Game]) -> anyhow::Result<usize> {
    let rounds = games.first().and_then(|game| game.row.number("max_round"));
    let rounds = rounds.filter(|rounds| (1.0..=1e6).contains(rounds));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
    rounds.map(|rounds| rounds as usize).context("the games have no column max_round")
}

/// The scores of all states of a game that ended early, too.
fn scores(game: &Game, series: &Series, rounds: usize) -> anyhow::Result<Vec<Option<f64>>> {
    let scores: Option<Vec<f64>> = series[0].iter().copied().collect();
    let scores = scores.with_context(|| format!("{} has states without a score", game.episode))?;
    whole_score(&scores, rounds).with_context(|| format!("{} cannot be drawn", game.episode))
}

fn trends(args: &rows::Selection) -> anyhow::Result<trends::Trends> {
    let games = args.games()?;
    let settings = rows::shared(&games, &[])?;
    let (models, rounds) = (models(&games), max_round(&games)?);
    ensure!(
        models.len() <= STYLES,
        "{} models are more than the {STYLES} that a figure can tell apart: select some with --where model=…",
        models.len()
    );
    let series = args.series(&games, &["score"])?;
    let mut of: BTreeMap<(&str, &str), Vec<Vec<Option<f64>>>> = BTreeMap::new();
    for (game, series) in games.iter().zip(&series) {
        let scores = scores(game, series, rounds)?;
        of.entry((&game.task, &game.model)).or_default().push(scores);
    }
    let panel = |task: String| {
        let line = |(model, name): (usize, &String)| {
            let games = of.get(&(task.as_str(), name.as_str()))?;
            let games: Vec<_> = games.iter().map(Vec::as_slice).collect();
            Some(trends::Line { model, score: Band::of(&games) })
        };
        let lines = models.iter().enumerate().filter_map(line).collect();
        trends::Panel { rounds, lines, task }
    };
    let panels = tasks(&games).into_iter().map(panel).collect();
    Ok(trends::Trends { notes: vec![settings], panels, models })
}

/// What the paper draws in three panels: the sum of all steps stands for the step of each round.
fn drawn() -> Vec<(Metric, Panel)> {
    let drawn = Metric::ALL.into_iter().filter_map(|metric| Some((metric, metric.about().panel?)));
    let instead = |metric| if metric == Metric::StepLength { Metric::PathLength } else { metric };
    drawn.map(|(metric, panel)| (instead(metric), panel)).collect()
}

fn dynamics(args: &DynamicsArgs) -> anyhow::Result<Dynamics> {
    let mut games = args.games.games()?;
    let known = models(&games).join(", ");
    games.retain(|game| game.model == args.model && game.task == args.task.name());
    let (task, model) = (args.task.name(), &args.model);
    ensure!(
        !games.is_empty(),
        "{model} has no finished game of {task}; there are games of {known}"
    );
    let notes =
        vec![rows::shared(&games, &[])?, format!("definition paper, {}", rows::computed(&games)?)];
    let rounds = max_round(&games)?;
    let metrics = drawn();
    let columns: Vec<&str> =
        ["score"].into_iter().chain(metrics.iter().map(|(metric, _)| metric.name())).collect();
    let mut series = args.games.series(&games, &columns)?;
    for (game, series) in games.iter().zip(&mut series) {
        series[0] = scores(game, series, rounds)?;
    }
    let best = (0..games.len()).max_by(|&a, &b| {
        // Of equal games the first.
        games[a].score.total_cmp(&games[b].score).then(b.cmp(&a))
    });
    let best = best.context("there is a game")?;
    let curve = |number: usize, name: &str, divisor: f64| {
        let all: Vec<_> = series.iter().map(|columns| columns[number].as_slice()).collect();
        let best = series[best][number].clone();
        Curve { name: name.to_owned(), divisor, band: Band::of(&all), best }
    };
    let curves = metrics.iter().enumerate().map(|(number, (metric, panel))| {
        let about = metric.about();
        (*panel, curve(number + 1, about.title, about.divisor))
    });
    Ok(Dynamics {
        title: format!("{model}, {task}"),
        notes,
        games: games.len(),
        rounds,
        score: curve(0, "Score", 1.0),
        metrics: curves.collect(),
    })
}

async fn frames(args: FrameArgs) -> anyhow::Result<Frames> {
    let FrameArgs { game, rounds, messages, server } = args;
    let journal = Journal::find(&game, server).await?;
    let outline = Outline::of(&journal)?;
    ensure!(
        rounds.len() <= MOMENTS_MAX,
        "{} moments are more than the limit of {MOMENTS_MAX} in a figure",
        rounds.len()
    );
    let wanted: BTreeSet<u32> = rounds.into_iter().collect();
    let last = wanted.last().copied().unwrap_or_default();
    ensure!(last <= outline.last(), "the game has the states 0 to {}", outline.last());
    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let mut moments = Vec::new();
    let show = |round: u32| set(&bar, round.into(), last.into());
    let is_wanted = |round| wanted.contains(&round);
    let stop = CancellationToken::new();
    journals::replay(&journal, (last, false), is_wanted, &stop, show, |moment| {
        moments.push(moment.clone());
        Ok(())
    })?;
    bar.finish_and_clear();
    let config = &outline.opening.config;
    let title = format!("{}, {}, seed {}", config.task, config.model, config.seed);
    Ok(Frames { title, moments, messages })
}

fn sensitivity(args: &SensitivityArgs) -> anyhow::Result<Sensitivity> {
    let games = args.games.games()?;
    let models = models(&games);
    ensure!(
        models.len() == 1,
        "the figure is of one model: select it with --where model={}; there are {}",
        models[0],
        models.join(", ")
    );
    let settings = rows::shared(&games, &[&args.across, &args.lines])?;
    let number = |game: &Game, column: &str| {
        let number = game.row.number(column);
        number.with_context(|| format!("{} has no number in the column {column}", game.episode))
    };
    let mut values = Vec::new();
    for game in &games {
        values.push(number(game, &args.lines)?);
    }
    values.sort_by(f64::total_cmp);
    values.dedup();
    ensure!(
        values.len() <= STYLES,
        "{} lines are more than the {STYLES} that a figure can tell apart",
        values.len()
    );
    // By task, line and place along the axis; the bits of numbers that are not negative are in their order.
    let mut scores: BTreeMap<(&str, usize, u64), Vec<f64>> = BTreeMap::new();
    for game in &games {
        let value = number(game, &args.lines)?;
        let line = values.partition_point(|&other| other < value);
        let across = number(game, &args.across)?.to_bits();
        scores.entry((&game.task, line, across)).or_default().push(game.score);
    }
    let points = |task: &String| {
        let of_task = scores.iter().filter(|((name, ..), _)| name == task);
        of_task
            .filter_map(|(&(_, line, across), scores)| {
                let across = f64::from_bits(across);
                Some(Point { line, across, score: Summary::of(scores)? })
            })
            .collect()
    };
    let panels = tasks(&games).into_iter().map(|task| (task.clone(), points(&task))).collect();
    let notes = vec![models[0].clone(), settings];
    let name = |column: &str| column.replace('_', " ");
    Ok(Sensitivity { notes, across: name(&args.across), line: name(&args.lines), values, panels })
}
