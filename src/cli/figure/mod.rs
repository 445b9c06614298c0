//! `swarmbench figure`

mod board;

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use swarmbench_analysis::metric::Panel;
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::TaskName;
use swarmbench_figures::dynamics::{Curve, Dynamics};
use swarmbench_figures::frame::Frames;
use swarmbench_figures::palette::STYLES;
use swarmbench_figures::sensitivity::{Point, Sensitivity};
use swarmbench_figures::series::{Band, Summary, whole_score};
use swarmbench_figures::{Figure, png, svg, trends};
use tokio_util::sync::CancellationToken;

use super::games::{Axes, Choice, Games, Selected, Series};
use super::journals::{self, Journal, Outline};
use super::options::ServerArgs;
use super::output::{progress_bar, set};
use super::partial::Partial;
use super::play::task;

/// Maximum moments side by side.
const MOMENTS_MAX: usize = 24;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The same games always give the same bytes. docs/evaluate/figures.md shows every figure.\n\nExamples:\n  \
    swarmbench export games --format jsonl\n  \
    swarmbench figure trends --from games --out trends.svg --data trends.csv\n  \
    swarmbench figure dynamics --db swarmbench.db --task Pursuit --model my-model --out dynamics.png\n  \
    swarmbench figure frame game.jsonl --rounds 0,10,20 --out frames.svg"
)]
pub(super) struct Args {
    #[command(subcommand)]
    figure: Kind,
    /// The file to write. Its name ends in .svg or .png.
    #[arg(long, global = true)]
    out: Option<PathBuf>,
    /// Also write the numbers behind the figure, as CSV.
    #[arg(long, global = true, value_name = "FILE")]
    data: Option<PathBuf>,
    /// The number of pixels of a PNG per unit of the figure.
    #[arg(long, global = true, default_value_t = 2.0, value_parser = scale)]
    scale: f64,
}

#[derive(Debug, clap::Subcommand)]
enum Kind {
    /// Draw scores over the rounds of a game: one panel per task, one line per model.
    Trends(Choice),
    /// Draw score, messages, choices and positions of a model in a task, round by round.
    Dynamics(DynamicsArgs),
    /// Draw moments of a game: the map, and the agents' choices.
    Frame(FrameArgs),
    /// Draw how the final score depends on two settings.
    Sensitivity(SensitivityArgs),
    /// Draw final scores: one row per model, one panel per task.
    Board(board::Args),
    /// Refuses: the Python package draws charts of correlations. The command exists for one release, to say so.
    #[command(hide = true)]
    Correlations {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        _any: Vec<OsString>,
    },
}

#[derive(Debug, clap::Args)]
struct DynamicsArgs {
    #[command(flatten)]
    games: Choice,
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
    games: Choice,
    /// The setting along the horizontal axis.
    #[arg(long, default_value = "num_agents")]
    across: String,
    /// The setting that distinguishes the lines.
    #[arg(long, default_value = "view_size")]
    lines: String,
}

fn scale(text: &str) -> Result<f64, String> {
    let scale = text.parse::<f64>().ok().filter(|scale| (0.1..=20.0).contains(scale));
    scale.ok_or_else(|| "must be a number from 0.1 to 20".to_owned())
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { figure, out, data, scale } = args;
    if matches!(figure, Kind::Correlations { .. }) {
        bail!(
            "charts of correlations are drawn by the Python package: pip install './clients/python[analysis]' in a \
             checkout; swarmseat-analysis report GAMES --out FOLDER; docs/evaluate/figures.md shows more"
        );
    }
    let out = out.context("name the file with --out, such as --out figure.svg")?;
    let format = Format::of(&out)?;
    let figure: Box<dyn Figure> = match figure {
        Kind::Trends(games) => Box::new(trends(&games).await?),
        Kind::Dynamics(args) => Box::new(dynamics(args).await?),
        Kind::Frame(args) => Box::new(frames(args).await?),
        Kind::Sensitivity(args) => Box::new(sensitivity(&args).await?),
        Kind::Board(args) => Box::new(board::figure(args).await?),
        Kind::Correlations { .. } => unreachable!("it was refused above"),
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

/// Selects games with a score, and adds sentences about their settings. The games may differ in the columns `apart`.
async fn select(choice: &Choice, apart: &[&str]) -> anyhow::Result<Selected> {
    let Selected { games, chosen, mut notes } = choice.select().await?;
    let apart: Vec<String> = apart.iter().map(|&name| name.to_owned()).collect();
    let axes = Axes { apart: &apart, ignored: &choice.ignore, option: None };
    notes.extend(games.shared(&chosen, &axes)?);
    games.check_numbers("score", &chosen)?;
    Ok(Selected { games, chosen, notes })
}

/// Games grouped by the values of a column, in order.
fn groups(games: &Games, column: &str, chosen: &[usize]) -> Vec<(String, Vec<usize>)> {
    let groups = games.groups(column, chosen).into_iter();
    groups.map(|(place, games)| (place.1.to_string(), games)).collect()
}

fn scores(games: &Games, chosen: &[usize]) -> Vec<f64> {
    chosen.iter().filter_map(|&game| games.number("score", game)).collect()
}

/// A sentence about how the metrics of these games were computed.
///
/// # Errors
/// If they were computed in different ways, or the games lack one of them.
fn method(Selected { games, chosen, .. }: &Selected, metrics: &[Metric]) -> anyhow::Result<String> {
    for metric in metrics {
        games.check_numbers(metric.name(), chosen)?;
    }
    let of = |column| games.text(column, chosen[0]);
    let (revision, embedder) = (of("metrics_revision"), of("embedder"));
    Ok(format!(
        "definition {}, metrics revision {revision}, embedder {embedder}",
        Definition::Paper.name()
    ))
}

/// Largest possible number of rounds of these games.
fn max_round(Selected { games, chosen, .. }: &Selected) -> anyhow::Result<usize> {
    let rounds = games.number("max_round", chosen[0]).filter(|rounds| (1.0..=1e6).contains(rounds));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
    rounds.map(|rounds| rounds as usize).context("the games have no column max_round")
}

/// Scores of all states, continued to `rounds` for a game that ended early.
fn whole(episode: &str, scores: &[Option<f64>], rounds: usize) -> anyhow::Result<Vec<Option<f64>>> {
    let scores: Option<Vec<f64>> = scores.iter().copied().collect();
    let scores = scores.with_context(|| format!("{episode} has states without a score"))?;
    whole_score(&scores, rounds).with_context(|| format!("{episode} cannot be drawn"))
}

/// Columns of the rounds of selected games. The first is the score, continued after an early end.
async fn series(
    choice: &Choice,
    selected: &Selected,
    metrics: &[Metric],
    rounds: usize,
) -> anyhow::Result<Vec<Series>> {
    let columns = ["score"].into_iter().chain(metrics.iter().map(|metric| metric.name()));
    let mut series = choice.series(selected, columns.collect()).await?;
    for (&game, series) in selected.chosen.iter().zip(&mut series) {
        series[0] = whole(&selected.games.text("episode", game), &series[0], rounds)?;
    }
    Ok(series)
}

async fn trends(choice: &Choice) -> anyhow::Result<trends::Trends> {
    let selected = select(choice, &["task", "model"]).await?;
    let Selected { games, chosen, notes } = &selected;
    let rounds = max_round(&selected)?;
    let models: Vec<String> =
        groups(games, "model", chosen).into_iter().map(|(model, _)| model).collect();
    ensure!(
        models.len() <= STYLES,
        "{} models are more than the {STYLES} that a figure can tell apart: select some with --where model=…",
        models.len()
    );
    let series = series(choice, &selected, &[], rounds).await?;
    let places: BTreeMap<usize, usize> = chosen.iter().copied().zip(0..).collect();
    let panel = |(task, of_task): (String, Vec<usize>)| {
        let of_models = groups(games, "model", &of_task).into_iter();
        let lines = of_models.filter_map(|(name, of_model)| {
            let scores: Vec<_> =
                of_model.iter().map(|game| series[places[game]][0].as_slice()).collect();
            let model = models.iter().position(|model| *model == name)?;
            Some(trends::Line { model, score: Band::of(&scores) })
        });
        trends::Panel { rounds, lines: lines.collect(), task }
    };
    let panels = groups(games, "task", chosen).into_iter().map(panel).collect();
    Ok(trends::Trends { notes: notes.clone(), panels, models })
}

/// Metrics that the paper draws in three panels. The sum of all steps replaces the step of each round.
fn drawn() -> Vec<(Metric, Panel)> {
    let drawn = Metric::ALL.into_iter().filter_map(|metric| Some((metric, metric.about().panel?)));
    let instead = |metric| if metric == Metric::StepLength { Metric::PathLength } else { metric };
    drawn.map(|(metric, panel)| (instead(metric), panel)).collect()
}

async fn dynamics(args: DynamicsArgs) -> anyhow::Result<Dynamics> {
    let DynamicsArgs { games: choice, task, model } = args;
    let choice = choice.with("task", task.name()).with("model", &model);
    let selected = select(&choice, &[]).await?;
    let Selected { games, chosen, notes } = &selected;
    let (metrics, panels): (Vec<Metric>, Vec<Panel>) = drawn().into_iter().unzip();
    let mut notes = notes.clone();
    notes.push(method(&selected, &metrics)?);
    let rounds = max_round(&selected)?;
    let series = series(&choice, &selected, &metrics, rounds).await?;
    let best = (0..chosen.len()).max_by(|&a, &b| {
        let score = |place: usize| games.number("score", chosen[place]).unwrap_or_default();
        // The first of equal games wins.
        score(a).total_cmp(&score(b)).then(b.cmp(&a))
    });
    let best = best.context("there is a game")?;
    let curve = |number: usize, name: &str, divisor: f64| {
        let all: Vec<_> = series.iter().map(|columns| columns[number].as_slice()).collect();
        let best = series[best][number].clone();
        Curve { name: name.to_owned(), divisor, band: Band::of(&all), best }
    };
    let curves = metrics.iter().zip(panels).enumerate().map(|(number, (metric, panel))| {
        let about = metric.about();
        (panel, curve(number + 1, about.title, about.divisor))
    });
    Ok(Dynamics {
        title: format!("{model}, {}", task.name()),
        notes,
        games: chosen.len(),
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

async fn sensitivity(args: &SensitivityArgs) -> anyhow::Result<Sensitivity> {
    let SensitivityArgs { games: choice, across, lines } = args;
    let Selected { games, chosen, notes } = select(choice, &["task", across, lines]).await?;
    let number = |column: &str, game: usize| {
        let number = games.number(column, game);
        number.with_context(|| {
            format!("{} has no number in the column {column}", games.text("episode", game))
        })
    };
    let mut values = Vec::new();
    for column in [across, lines] {
        games.check_numbers(column, &chosen)?;
    }
    for (_, of_line) in groups(&games, lines, &chosen) {
        values.push(number(lines, of_line[0])?);
    }
    ensure!(
        values.len() <= STYLES,
        "{} lines are more than the {STYLES} that a figure can tell apart",
        values.len()
    );
    let mut panels = Vec::new();
    for (task, of_task) in groups(&games, "task", &chosen) {
        let mut points = Vec::new();
        for (_, of_line) in groups(&games, lines, &of_task) {
            let value = number(lines, of_line[0])?;
            let line = values.partition_point(|&other| other < value);
            for (_, of_point) in groups(&games, across, &of_line) {
                let across = number(across, of_point[0])?;
                let score = Summary::of(&scores(&games, &of_point));
                points.extend(score.map(|score| Point { line, across, score }));
            }
        }
        panels.push((task, points));
    }
    let name = |column: &str| column.replace('_', " ");
    Ok(Sensitivity { notes, across: name(across), line: name(lines), values, panels })
}
