//! Scores and decision times of the built-in players, in games in the process.
//!
//! ```sh
//! cargo bench -p swarmbench-players --bench scores -- --task Pursuit --player close-in --seeds 1000..1100
//! ```
//!
//! Every option may be left out: the defaults are all tasks, all their players and the seeds 0..20. `--centralized`
//! plays under centralized control, `--each` shows the score of every game. The standard setting is changed by
//! `--agents`, `--height`, `--width`, `--view`, `--noise`, `--delay` and `--rules`; tasks that cannot be played with
//! these settings are skipped. The benchmark `decisions` measures the slowest decisions: the longest time here is
//! mostly that of the system's other work.

use std::ops::Range;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use swarmbench_engine::{Config, Settings, TaskName};
use swarmbench_players::game::Game;
use swarmbench_players::{BuiltIn, of_task};

const USAGE: &str = "options: --task NAME, --player NAME, --seeds FROM..TO, --centralized, --each, \
    --agents N, --height N, --width N, --view N, --noise P, --delay N, --rules NAME";

/// Options of the command line.
struct Asked {
    task: Option<String>,
    player: Option<String>,
    seeds: Range<u64>,
    is_each: bool,
    /// All other settings of the games.
    settings: Settings,
}

impl Asked {
    fn parse(mut words: impl Iterator<Item = String>) -> Option<Self> {
        let settings = Settings::default();
        let mut asked = Self { task: None, player: None, seeds: 0..20, is_each: false, settings };
        while let Some(word) = words.next() {
            match word.as_str() {
                "--task" => asked.task = Some(words.next()?),
                "--player" => asked.player = Some(words.next()?),
                "--seeds" => {
                    let range = words.next()?;
                    let (from, to) = range.split_once("..")?;
                    asked.seeds = from.parse().ok()?..to.parse().ok()?;
                }
                "--centralized" => "centralized".clone_into(&mut asked.settings.control),
                "--each" => asked.is_each = true,
                "--agents" => asked.settings.num_agents = words.next()?.parse().ok()?,
                "--height" => asked.settings.height = words.next()?.parse().ok()?,
                "--width" => asked.settings.width = words.next()?.parse().ok()?,
                "--view" => asked.settings.view_size = words.next()?.parse().ok()?,
                "--noise" => asked.settings.noise = words.next()?.parse().ok()?,
                "--delay" => asked.settings.max_delay = words.next()?.parse().ok()?,
                "--rules" => asked.settings.rules = words.next()?,
                // Cargo passes this option.
                "--bench" => {}
                _ => return None,
            }
        }
        Some(asked)
    }

    /// The settings of one game.
    fn settings(&self, task: TaskName, seed: u64) -> Settings {
        let Settings { task, seed, .. } = Settings::standard(task, seed);
        Settings { task, seed, ..self.settings.clone() }
    }
}

/// Games of one player.
#[derive(Default)]
struct Played {
    /// Seed and score of each game.
    scores: Vec<(u64, f64)>,
    /// The time of each decision.
    decisions: Vec<Duration>,
}

#[expect(clippy::disallowed_methods, reason = "a benchmark measures time")]
fn play(built_in: &BuiltIn, settings: &Settings, seed: u64, played: &Mutex<Played>) {
    let config = Config::check(settings).expect("checked settings");
    let mut game = Game::new(Arc::new(config), built_in, seed);
    let mut decisions = Vec::new();
    while !game.world().is_over() {
        let acts = game.decide_by(|player, observation| {
            let start = Instant::now();
            let act = player.decide(observation);
            decisions.push(start.elapsed());
            act
        });
        game.step(&acts);
    }
    let mut played = played.lock().expect("no game panics");
    played.scores.push((seed, game.world().score()));
    played.decisions.append(&mut decisions);
}

/// Plays all games on all processors.
fn play_all(built_in: &BuiltIn, task: TaskName, asked: &Asked) -> Played {
    let played = Mutex::default();
    let next = AtomicU64::new(asked.seeds.start);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= asked.seeds.end {
                        break;
                    }
                    play(built_in, &asked.settings(task, seed), seed, &played);
                }
            });
        }
    });
    let mut played = played.into_inner().expect("no game panics");
    played.scores.sort_by_key(|(seed, _)| *seed);
    played.decisions.sort();
    played
}

#[expect(clippy::cast_precision_loss, reason = "a few games")]
fn mean_and_deviation(scores: &[f64]) -> (f64, f64) {
    let count = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / count;
    let squares: f64 = scores.iter().map(|score| (score - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0)).sqrt())
}

#[expect(clippy::disallowed_methods, reason = "what is asked for comes from the command line")]
fn main() -> ExitCode {
    let Some(asked) = Asked::parse(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::FAILURE;
    };
    println!(
        "{:16} {:22} mean ± deviation   least   most  decision: median, 99 %, most",
        "task", "player"
    );
    let is_asked =
        |asked: &Option<String>, name: &str| asked.as_deref().is_none_or(|word| word == name);
    for task in TaskName::ALL.into_iter().filter(|task| is_asked(&asked.task, task.name())) {
        if let Err(errors) = Config::check(&asked.settings(task, asked.seeds.start)) {
            eprintln!("{}: {errors}", task.name());
            continue;
        }
        for player in of_task(task).filter(|player| is_asked(&asked.player, player.name)) {
            let played = play_all(player, task, &asked);
            let scores: Vec<f64> = played.scores.iter().map(|(_, score)| *score).collect();
            let (mean, deviation) = mean_and_deviation(&scores);
            let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
            let most = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let time = |share: usize| played.decisions[(played.decisions.len() - 1) * share / 100];
            println!(
                "{:16} {:22} {mean:6.2} ± {deviation:5.2}   {least:7.2} {most:7.2}  {:.1?}, {:.1?}, {:.1?}",
                task.name(),
                player.name,
                time(50),
                time(99),
                time(100),
            );
            if asked.is_each {
                for (seed, score) in &played.scores {
                    println!("    seed {seed:5} {score:6.2}");
                }
            }
        }
    }
    ExitCode::SUCCESS
}
