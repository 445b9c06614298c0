//! `swarmbench metrics`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use swarmbench_analysis::metric::Panel;
use swarmbench_analysis::{Definition, Metric, Options};
use swarmbench_client::client::Client;
use swarmbench_protocol::metrics::{GameMetrics, MetricMean, MetricsMethod, RunMetrics};

use super::output::{self, fields, mean, progress_bar, set, table};
use crate::measure::{means, method, series, values};
use crate::store::metrics::Measured;
use swarmbench_commands::journals::open_lines;
use swarmbench_commands::options::ServerArgs;

/// States of a series that a server sends in one page.
const STATES: u32 = 1000;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "docs/evaluate/metrics.md defines every metric. Values are comparable only if their embedder, definition and \
    revision are the same.\n\nExamples:\n  \
    swarmbench metrics ep_0123…                        (on a server on this machine)\n  \
    swarmbench metrics run_0123…                       (of all games of a run, with means by task)\n  \
    swarmbench metrics game.jsonl                      (a journal file, without a server)\n  \
    swarmbench metrics game.jsonl --series --format csv > states.csv"
)]
pub(super) struct Args {
    /// The id of an episode, of a run or of an imported game, or a journal file.
    game: String,
    #[command(flatten)]
    server: ServerArgs,
    /// The definition of metrics: paper follows the words of the paper, toolkit computes what its published scripts compute.
    #[arg(long, default_value = "paper", value_parser = definition)]
    definition: Definition,
    /// Also show the values of every state.
    #[arg(long)]
    series: bool,
    /// The format of the output.
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
    /// Print JSON: the same as --format json.
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// Tables for a terminal.
    Table,
    /// JSON, in the shape of the API.
    Json,
    /// CSV: one row per metric and game; with --series one row per state.
    Csv,
}

fn definition(name: &str) -> Result<Definition, String> {
    Definition::parse(name).ok_or_else(|| "must be paper or toolkit".to_owned())
}

pub(super) async fn run(mut args: Args) -> anyhow::Result<()> {
    if args.json {
        args.format = Format::Json;
    }
    let path = PathBuf::from(&args.game);
    if path.is_file() {
        let (definition, wants_series) = (args.definition, args.series);
        let work = move || {
            let game = measured(&path, definition, wants_series);
            game.with_context(|| format!("{}", path.display()))
        };
        return show(&args, &tokio::task::spawn_blocking(work).await??);
    }
    let is_known = ["run_", "ep_", "imp_"].iter().any(|prefix| args.game.starts_with(prefix));
    if !is_known {
        bail!(
            "{} is no file, and no id of an episode (ep_…), a run (run_…) or an imported game (imp_…)",
            args.game
        );
    }
    let client = args.server.clone().client().await?;
    if args.game.starts_with("run_") {
        return show_run(&args, &of_run(&args, &client).await?);
    }
    show(&args, &of_server(&args, &client).await?)
}

/// Measures a journal on this machine.
fn measured(
    journal: &Path,
    definition: Definition,
    wants_series: bool,
) -> anyhow::Result<GameMetrics> {
    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let options = Options::all(wants_series);
    let read = swarmbench_analysis::journal::measure(open_lines(journal)?, options, |round, of| {
        set(&bar, round.into(), of.into());
    });
    bar.finish_and_clear();
    let (report, metrics) = read?;
    let measured = Measured::of(&metrics);
    Ok(GameMetrics {
        episode: report.opening.episode.clone(),
        task: report.opening.config.task.clone(),
        status: report.end.map_or_else(|| "running".to_owned(), |end| end.status),
        rounds: report.rounds,
        score: report.score,
        method: method(definition),
        sampled: measured.sampled(),
        values: values(&measured, definition),
        series: wants_series
            .then(|| series(&metrics, definition, 0..metrics.rounds + 1, metrics.rounds)),
    })
}

/// Metrics of an episode or an imported game on a server.
async fn of_server(args: &Args, client: &Client) -> anyhow::Result<GameMetrics> {
    let kind = if args.game.starts_with("imp_") { "imports" } else { "episodes" };
    let path = format!("/api/v1/{kind}/{}/metrics", args.game);
    let states = STATES.to_string();
    let mut query = vec![("definition", args.definition.name())];
    if !args.series {
        return Ok(client.get_with(&path, &query).await?);
    }
    query.extend([("series", "true"), ("states", &states)]);
    let mut game: GameMetrics = client.get_with(&path, &query).await?;
    while let Some(all) = &mut game.series
        && let Some(next) = all.next
    {
        let next = next.to_string();
        let page: Vec<_> = query.iter().copied().chain([("from", &*next)]).collect();
        let more: GameMetrics = client.get_with(&path, &page).await?;
        let more = more.series.context("the server sent no series")?;
        all.next = more.next;
        all.length += more.length;
        for (name, values) in more.values {
            all.values.entry(name).or_default().extend(values);
        }
        for (name, counts) in more.counts {
            all.counts.entry(name).or_default().extend(counts);
        }
    }
    Ok(game)
}

/// Metrics of all games of a run.
async fn of_run(args: &Args, client: &Client) -> anyhow::Result<RunMetrics> {
    if args.series {
        bail!("--series is for one game: name an episode");
    }
    let path = format!("/api/v1/runs/{}/metrics", args.game);
    let query = [("definition", args.definition.name())];
    let bar = progress_bar("{spinner} {pos} games");
    let mut run: RunMetrics = client.get_with(&path, &query).await?;
    while let Some(cursor) = run.next_cursor.take() {
        bar.set_position(run.items.len() as u64);
        let page: Vec<_> = query.iter().copied().chain([("cursor", &*cursor)]).collect();
        let more: RunMetrics = client.get_with(&path, &page).await?;
        run.items.extend(more.items);
        run.next_cursor = more.next_cursor;
    }
    bar.finish_and_clear();
    run.tasks = means(&run.items);
    Ok(run)
}

fn show(args: &Args, game: &GameMetrics) -> anyhow::Result<()> {
    match args.format {
        Format::Json => output::json(game),
        Format::Csv if args.series => series_csv(game),
        Format::Csv => values_csv(std::slice::from_ref(game)),
        Format::Table => {
            out!("{}", heading(game));
            for (panel, title) in PANELS {
                let mut shown = table(&[title, "value", "rounds"]);
                for metric in of_panel(panel) {
                    if let Some(of) = game.values.get(metric.name()) {
                        shown.add_row([title_of(metric), number(of.value), of.rounds.to_string()]);
                    }
                }
                if shown.row_iter().next().is_some() {
                    out!("{shown}");
                }
            }
            if game.sampled {
                out!(
                    "sampled: a round had too many different texts, and some were left out of their comparison"
                );
            }
            if args.series {
                out!("the values of all states are in --format csv and json");
            }
            Ok(())
        }
    }
}

fn show_run(args: &Args, run: &RunMetrics) -> anyhow::Result<()> {
    match args.format {
        Format::Json => return output::json(run),
        Format::Csv => return values_csv(&run.items),
        Format::Table => {}
    }
    if run.items.is_empty() {
        out!("{}: no game has ended yet", run.run);
        return Ok(());
    }
    for (task, of_task) in &run.tasks {
        let games = run.items.iter().filter(|game| game.task == *task).count();
        out!("{task}: {games} games, mean ± deviation over those with a value");
        for (panel, title) in PANELS {
            let mut shown = table(&[title, "value", "games"]);
            for metric in of_panel(panel) {
                if let Some(MetricMean { mean: value, deviation, games }) =
                    of_task.get(metric.name())
                {
                    let value = mean(Some(*value), Some(*deviation));
                    shown.add_row([title_of(metric), value, games.to_string()]);
                }
            }
            if shown.row_iter().next().is_some() {
                out!("{shown}");
            }
        }
    }
    Ok(())
}

/// Sections of a table of metrics.
const PANELS: [(Option<Panel>, &str); 4] = [
    (Some(Panel::Messages), "messages"),
    (Some(Panel::Choices), "choices"),
    (Some(Panel::Positions), "positions"),
    (None, "further metrics"),
];

fn of_panel(panel: Option<Panel>) -> impl Iterator<Item = Metric> {
    Metric::ALL.into_iter().filter(move |metric| metric.about().panel == panel)
}

fn title_of(metric: Metric) -> String {
    metric.about().title.to_owned()
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.4}"))
}

fn heading(game: &GameMetrics) -> impl std::fmt::Display {
    let MetricsMethod { definition, metrics_revision, embedder } = &game.method;
    fields([
        ("game", game.episode.clone()),
        ("task", game.task.clone()),
        ("rounds", format!("{} ({})", game.rounds, game.status)),
        ("score", game.score.to_string()),
        ("definition", format!("{definition}, revision {metrics_revision}")),
        ("embedder", embedder.clone()),
    ])
}

/// Writes a row for each game and metric.
fn values_csv(games: &[GameMetrics]) -> anyhow::Result<()> {
    let mut out = csv::Writer::from_writer(output::stream());
    out.write_record([
        "episode",
        "task",
        "score",
        "definition",
        "metrics_revision",
        "embedder",
        "metric",
        "value",
        "rounds",
    ])?;
    for game in games {
        let method = &game.method;
        for (metric, of) in &game.values {
            out.write_record([
                &game.episode,
                &game.task,
                &game.score.to_string(),
                &method.definition,
                &method.metrics_revision.to_string(),
                &method.embedder,
                metric,
                &exact(of.value),
                &of.rounds.to_string(),
            ])?;
        }
    }
    Ok(out.flush()?)
}

/// Writes a row for each state.
fn series_csv(game: &GameMetrics) -> anyhow::Result<()> {
    let all = game.series.as_ref().context("the server sent no series")?;
    let mut out = csv::Writer::from_writer(output::stream());
    // A count that is also a metric is written once.
    let values: BTreeMap<_, _> =
        all.values.iter().filter(|(name, _)| !all.counts.contains_key(*name)).collect();
    let names = all.counts.keys().chain(values.keys().copied());
    out.write_record(["round"].into_iter().chain(names.map(String::as_str)))?;
    for state in 0..all.length as usize {
        let counts = all.counts.values().map(|counts| exact(counts[state]));
        let values = values.values().map(|values| exact(values[state]));
        let round = (all.from as usize + state).to_string();
        out.write_record([round].into_iter().chain(counts).chain(values))?;
    }
    Ok(out.flush()?)
}

fn exact(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
