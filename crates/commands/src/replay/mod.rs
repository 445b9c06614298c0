//! `swarmbench replay`

mod page;

use std::io::BufWriter;
use std::ops::{ControlFlow, RangeInclusive};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use swarmbench_engine::Control;
use swarmbench_replay::draw::frame::{Layout, Shown, Stage};
use swarmbench_replay::draw::moments::{MOMENTS_MAX, Moments};
use swarmbench_replay::draw::{Canvas, FRAMES_PER_SECOND_MAX, Film, Gif, Scene, Y4m, png, svg};
use tokio_util::sync::CancellationToken;

use super::journals::{self, Journal, Outline};
use super::options::ServerArgs;
use super::output::{self, progress_bar, set};
use super::partial::Partial;
use crate::stop::asked_to_stop;
use page::GamePage;

/// Maximum frames of a replay.
const REPLAY_FRAMES_MAX: u64 = 10_000;
/// Maximum pixels of all frames of a replay together. A thousand million take about ten seconds.
const REPLAY_PIXELS_MAX: u64 = 5_000_000_000;

/// Pixels per unit of a picture.
const PNG_SCALE: f64 = 2.0;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Frame s shows state s, the agents' choices in round s, and with --messages their messages in round s. An \
    arrow is a chosen move; an empty arrow with a bar is a blocked move; ? is an agent without an action, S an agent that \
    switches its light.\n\nExamples:\n  \
    swarmbench replay EPISODE --gif game.gif --messages\n  \
    swarmbench replay game.jsonl --gif start.gif --rounds 0..20 --scale 48\n  \
    swarmbench replay game.jsonl --png moment.png --round 37 --views\n  \
    swarmbench replay game.jsonl --picture moments.svg --moments 0,10,20\n  \
    swarmbench replay game.jsonl --y4m - | ffmpeg -i - game.mp4\n  \
    swarmbench replay game.jsonl --html game.html"
)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of the command")]
pub struct Args {
    /// A journal file, or the id of an episode on the server.
    game: String,
    #[command(flatten)]
    output: Output,
    /// The frame to draw, with --svg or --png.
    #[arg(long, conflicts_with_all = ["rounds", "gif", "y4m", "picture"])]
    round: Option<u32>,
    /// The first and the last frame, such as 10..60; either may be left out.
    #[arg(long, value_parser = rounds, conflicts_with = "picture")]
    rounds: Option<RangeInclusive<u32>>,
    /// The states that the picture of --picture shows, such as 0,10,20.
    #[arg(long, value_name = "ROUND,…", value_delimiter = ',', requires = "picture")]
    moments: Vec<u32>,
    /// Show all messages of the round below the map.
    #[arg(long)]
    messages: bool,
    /// Show the windows of all agents.
    #[arg(long, conflicts_with = "picture")]
    views: bool,
    /// Include the prompts in the page of --html, most of whose size they are.
    #[arg(long, requires = "html")]
    prompts: bool,
    /// Include in the page of --html what could still be scored, and what decisions lost: up to a minute of computing.
    #[arg(long, requires = "html")]
    losses: bool,
    /// The side of a cell of the map, in pixels. Default: 4 to 32, so that the map has about 400 pixels.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=256), conflicts_with = "picture")]
    scale: Option<u16>,
    /// The number of frames per second.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=i64::from(FRAMES_PER_SECOND_MAX)))]
    fps: u16,
    #[command(flatten)]
    server: ServerArgs,
}

#[derive(Clone, Debug, clap::Args)]
#[group(required = true, multiple = false)]
struct Output {
    /// Write an animated GIF.
    #[arg(long)]
    gif: Option<PathBuf>,
    /// Write uncompressed video, a format that ffmpeg reads; - for the standard output.
    #[arg(long)]
    y4m: Option<PathBuf>,
    /// Write each frame as an SVG into this folder, which must not exist.
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Write one frame as a PNG.
    #[arg(long, requires = "round")]
    png: Option<PathBuf>,
    /// Write the moments of --moments side by side, as one SVG or PNG.
    #[arg(long, requires = "moments")]
    picture: Option<PathBuf>,
    /// Write a page that shows the game in a browser, without a server or a network.
    #[arg(long)]
    html: Option<PathBuf>,
}

/// Parses `a..b`, `a..` or `..b`; both ends are inclusive.
fn rounds(text: &str) -> Result<RangeInclusive<u32>, String> {
    let wrong = || format!("{text:?} is no range of rounds such as 10..60");
    let (from, to) = text.split_once("..").ok_or_else(wrong)?;
    let parse = |end: &str, open| {
        if end.is_empty() { Ok(open) } else { end.parse().map_err(|_| wrong()) }
    };
    let range = parse(from, 0)?..=parse(to, u32::MAX)?;
    if range.is_empty() { Err(format!("{text:?} ends before it begins")) } else { Ok(range) }
}

/// A page that contains a game, of its title and the game's data.
pub type SinglePage = fn(&str, &serde_json::Value) -> String;

pub async fn run(args: Args, single_page: SinglePage) -> anyhow::Result<()> {
    let journal = Journal::find(&args.game, args.server.clone()).await?;
    let stop = CancellationToken::new();
    let (told, stopping) = (stop.clone(), asked_to_stop());
    tokio::spawn(async move {
        stopping.await;
        told.cancel();
    });
    tokio::task::spawn_blocking(move || write(&args, single_page, &journal, &stop)).await?
}

fn write(
    args: &Args,
    single_page: SinglePage,
    journal: &Journal,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let outline = Outline::of(journal)?;
    if let Some(path) = &args.output.picture {
        return write_moments(args, path, &outline, journal, stop);
    }
    let range = args.round.map(|round| round..=round).or_else(|| args.rounds.clone());
    let (first, last) = range.unwrap_or(0..=u32::MAX).into_inner();
    ensure!(
        first <= outline.last(),
        "there is no state {first}: the game has the states 0 to {}",
        outline.last()
    );
    let last = last.min(outline.last());
    if let Some(path) = &args.output.html {
        let worth = args.losses.then(|| crate::worth::of(journal, true)).transpose()?;
        let page = GamePage::new(outline, first..=last, args.prompts, worth, single_page);
        return write_page(page, path, last, journal, stop);
    }
    let mut layout = layout(args, &outline)?;
    check_size(&layout, u64::from(last - first) + 1)?;

    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let mut target = Target::open(&args.output, args.fps)?;
    let states = (last, args.views);
    let show = |round: u32| set(&bar, round.into(), last.into());
    // The curves show all states, from the layout on.
    let replayed = journals::replay(
        journal,
        states,
        |_| true,
        stop,
        show,
        |moment| {
            if moment.round < first {
                layout.skip(moment);
                return Ok(());
            }
            target.add(&layout.frame(moment), moment.round)
        },
    );
    bar.finish_and_clear();
    replayed?;
    target.finish()
}

/// Writes a picture of some states.
fn write_moments(
    args: &Args,
    path: &Path,
    outline: &Outline,
    journal: &Journal,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let Args { moments: wanted, messages, .. } = args;
    ensure!(wanted.len() <= MOMENTS_MAX, "a picture has at most {MOMENTS_MAX} moments");
    let last = wanted.iter().copied().max().unwrap_or_default();
    ensure!(
        last <= outline.last(),
        "there is no state {last}: the game has the states 0 to {}",
        outline.last()
    );
    let format = Format::of(path)?;
    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let mut seen = Vec::new();
    let replayed = journals::replay(
        journal,
        (last, false),
        |round| wanted.contains(&round),
        stop,
        |round| set(&bar, round.into(), last.into()),
        |moment| {
            seen.push(moment.clone());
            Ok(())
        },
    );
    bar.finish_and_clear();
    replayed?;
    let config = &outline.opening.config;
    let title = format!("{}, {}, seed {}", config.task, config.model, config.seed);
    let scene = Moments { title, moments: seen, messages: *messages }.scene();
    match format {
        Format::Svg => Partial::write(path, svg(&scene).as_bytes()),
        Format::Png => Partial::write(path, &png(&scene, PNG_SCALE)?),
    }
}

#[derive(Clone, Copy)]
enum Format {
    Svg,
    Png,
}

impl Format {
    /// The format that the end of a name says.
    fn of(path: &Path) -> anyhow::Result<Self> {
        match path.extension().and_then(|end| end.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => bail!("{} must end in .svg or .png", path.display()),
        }
    }
}

/// Writes a page with the states up to `last`.
fn write_page(
    mut page: GamePage,
    path: &Path,
    last: u32,
    journal: &Journal,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let visited = journals::visit(journal, stop, |world, acts| {
        set(&bar, world.round().into(), last.into());
        page.add(world, acts)?;
        let is_last = world.round() >= last;
        Ok(if is_last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    });
    bar.finish_and_clear();
    visited?;
    Partial::write(path, page.finish()?.as_bytes())
}

fn layout(args: &Args, outline: &Outline) -> anyhow::Result<Layout> {
    let config = &outline.opening.config;
    let side = |cells: i64| usize::try_from(cells).unwrap_or_default();
    let map = (side(config.height), side(config.width));
    let window = match Control::parse(&config.control) {
        Some(Control::Centralized) => map,
        Some(Control::Decentralized) | None => (side(config.view_size), side(config.view_size)),
    };
    let scores = outline.scores.iter().copied();
    let stage = Stage {
        task: config.task.clone(),
        model: config.model.clone(),
        map,
        agents: config.num_agents.into(),
        window,
        max_round: config.max_round,
        scores: scores.fold((0.0, 0.0), |(low, high), score| (low.min(score), high.max(score))),
    };
    let Args { scale: cell, messages, views, output, .. } = args;
    let cut = output.gif.is_none() && output.y4m.is_none();
    let shown = Shown { cell: *cell, messages: *messages, views: *views, cut };
    Ok(Layout::new(stage, shown)?)
}

fn check_size(layout: &Layout, frames: u64) -> anyhow::Result<()> {
    ensure!(
        frames <= REPLAY_FRAMES_MAX,
        "{frames} frames are more than the limit replay_frames_max = {REPLAY_FRAMES_MAX}: select some with --rounds"
    );
    let pixels = frames * layout.pixels();
    ensure!(
        pixels <= REPLAY_PIXELS_MAX,
        "{pixels} pixels in {frames} frames are more than the limit replay_pixels_max = {REPLAY_PIXELS_MAX}: select \
         frames with --rounds, or take a smaller --scale"
    );
    Ok(())
}

/// Destination of frames.
enum Target {
    /// A moving picture, and the file for it.
    Film(Moving, Option<Partial>),
    /// A folder of pictures.
    Folder(Partial, PathBuf),
    /// One picture.
    Picture(PathBuf),
}

/// A moving picture, which begins with its first frame.
struct Moving {
    /// Constructor of the film, until the first frame.
    begin: Option<Begin>,
    film: Option<(Box<dyn Film>, Canvas)>,
}

type Begin = Box<dyn FnOnce(&Canvas) -> anyhow::Result<Box<dyn Film>>>;

impl Target {
    fn open(output: &Output, fps: u16) -> anyhow::Result<Self> {
        let film = |begin, partial| Self::Film(Moving { begin: Some(begin), film: None }, partial);
        match output {
            Output { gif: Some(path), .. } => {
                let (partial, file) = Partial::file(path)?;
                let begin: Begin = Box::new(move |canvas| {
                    Ok(Box::new(Gif::new(BufWriter::new(file), canvas, fps)?))
                });
                Ok(film(begin, Some(partial)))
            }
            Output { y4m: Some(path), .. } if path.as_os_str() == "-" => {
                let begin: Begin = Box::new(move |canvas| {
                    Ok(Box::new(Y4m::new(BufWriter::new(output::stream()), canvas, fps)?))
                });
                Ok(film(begin, None))
            }
            Output { y4m: Some(path), .. } => {
                let (partial, file) = Partial::file(path)?;
                let begin: Begin = Box::new(move |canvas| {
                    Ok(Box::new(Y4m::new(BufWriter::new(file), canvas, fps)?))
                });
                Ok(film(begin, Some(partial)))
            }
            Output { svg: Some(path), .. } => {
                let (partial, folder) = Partial::folder(path)?;
                Ok(Self::Folder(partial, folder))
            }
            Output { png: Some(path), .. } => Ok(Self::Picture(path.clone())),
            Output { gif: None, y4m: None, svg: None, png: None, .. } => bail!("name an output"),
        }
    }

    fn add(&mut self, scene: &Scene, round: u32) -> anyhow::Result<()> {
        match self {
            Self::Film(moving, _) => moving.add(scene),
            Self::Folder(_, folder) => {
                let file = folder.join(format!("frame-{round:05}.svg"));
                std::fs::write(&file, svg(scene)).with_context(|| format!("{}", file.display()))
            }
            Self::Picture(path) => Partial::write(path, &png(scene, PNG_SCALE)?),
        }
    }

    fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Film(moving, partial) => {
                if let Some((film, _)) = moving.film {
                    film.finish()?;
                }
                partial.map_or(Ok(()), Partial::keep)
            }
            Self::Folder(partial, _) => partial.keep(),
            Self::Picture(_) => Ok(()),
        }
    }
}

impl Moving {
    fn add(&mut self, scene: &Scene) -> anyhow::Result<()> {
        if let Some(begin) = self.begin.take() {
            let canvas = Canvas::new(scene);
            self.film = Some((begin(&canvas)?, canvas));
        }
        if let Some((film, canvas)) = &mut self.film {
            canvas.draw(scene);
            film.frame(canvas)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_rounds_have_two_ends_that_may_be_open() {
        assert_eq!(rounds("3..7"), Ok(3..=7));
        assert_eq!(rounds("..7"), Ok(0..=7));
        assert_eq!(rounds("3.."), Ok(3..=u32::MAX));
        for wrong in ["", "3", "a..b", "7..3", "-1..2"] {
            assert!(rounds(wrong).is_err(), "{wrong}");
        }
    }
}
