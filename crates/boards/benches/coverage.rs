//! Coverage of the interval of a difference: how often it contains the true difference.
//!
//! ```sh
//! cargo bench -p swarmbench-boards --bench coverage
//! ```
//!
//! Differences are drawn from distributions with a known mean, and from games of the built-in players: all pairs of
//! players of a task on the seeds 0 to 199, of which samples are drawn with replacement. The tables are in
//! `docs/measured/coverage.md`.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench_boards::Player;
use swarmbench_boards::interval::difference;
use swarmbench_boards::result::{RunResult, TaskResult};
use swarmbench_engine::{Config, Seed, Settings, TaskName};
use swarmbench_players::game::LocalGame;
use swarmbench_players::of_task;

/// Samples of each kind.
const SAMPLES: usize = 4000;

/// Seeds of a player's games from which differences are drawn.
const SEEDS: u64 = 200;

/// Tasks and seeds of a sample.
const SIZES: [(usize, usize); 6] = [(1, 3), (1, 5), (1, 10), (1, 20), (5, 5), (5, 10)];

/// A source of differences with a known mean.
struct Source<'a> {
    draw: Box<dyn FnMut() -> f64 + 'a>,
    mean: f64,
}

fn main() {
    println!(
        "| differences | {} |",
        SIZES.map(|(tasks, seeds)| format!("{tasks} × {seeds}")).join(" | ")
    );
    println!("| --- |{}", " ---: |".repeat(SIZES.len()));
    for (name, mean, draw) in shapes() {
        let cells = SIZES.map(|(tasks, seeds)| {
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let mut sources: Vec<ChaCha8Rng> =
                (0..tasks).map(|_| ChaCha8Rng::seed_from_u64(random.next_u64())).collect();
            let sources =
                sources.iter_mut().map(|own| Source { draw: Box::new(|| draw(own)), mean });
            percent(coverage(sources.collect(), seeds))
        });
        println!("| {name} | {} |", cells.join(" | "));
    }
    println!();
    real();
}

/// A distribution: name, mean, and a function that draws from it.
type Shape = (&'static str, f64, fn(&mut ChaCha8Rng) -> f64);

fn shapes() -> [Shape; 4] {
    [
        ("normal", 1.0, |random| 1.0 + normal(random)),
        ("skewed: exponential", 1.0, |random| -uniform(random).ln()),
        ("very skewed: log-normal", 0.5_f64.exp(), |random| normal(random).exp()),
        (
            "rare win: 10, once in ten games",
            1.0,
            |random| if uniform(random) < 0.1 { 10.0 } else { 0.0 },
        ),
    ]
}

/// A uniform number in (0, 1].
#[expect(clippy::cast_precision_loss, reason = "53 bits")]
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    ((random.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (radius, angle) =
        ((-2.0 * uniform(random).ln()).sqrt(), std::f64::consts::TAU * uniform(random));
    radius * angle.cos()
}

/// Share of samples whose interval contains the mean.
fn coverage(mut sources: Vec<Source<'_>>, seeds: usize) -> f64 {
    let tasks = &TaskName::ALL[..sources.len()];
    let mean: f64 = sources.iter().map(|source| source.mean).sum();
    let zeros = vec![vec![0.0; seeds]; tasks.len()];
    let below = result(tasks, &zeros);
    let covered = (0..SAMPLES).filter(|_| {
        let drawn: Vec<Vec<f64>> = sources
            .iter_mut()
            .map(|source| (0..seeds).map(|_| (source.draw)()).collect())
            .collect();
        let found = difference(&result(tasks, &drawn), &below, tasks).expect("scores");
        let (low, high) = found.interval.expect("three seeds and more");
        low <= mean + 1e-9 && mean - 1e-9 <= high
    });
    #[expect(clippy::cast_precision_loss, reason = "thousands")]
    let share = covered.count() as f64 / SAMPLES as f64;
    share
}

fn result(tasks: &[TaskName], scores: &[Vec<f64>]) -> RunResult {
    let of = |(task, scores): (&TaskName, &Vec<f64>)| TaskResult {
        scores: (0_u32..).map(Seed::from).zip(scores.iter().copied()).collect(),
        ..TaskResult::empty(*task)
    };
    let row = Player::default().row();
    RunResult {
        run: swarmbench_boards::PlayedRun::default(),
        row,
        tasks: tasks.iter().zip(scores).map(of).collect(),
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Prints the coverage for games of the built-in players.
fn real() {
    println!("| task | players | 5 seeds | 10 seeds | 20 seeds |");
    println!("| --- | --- | ---: | ---: | ---: |");
    let mut games: Vec<Vec<Vec<f64>>> = Vec::new();
    for task in TaskName::ALL {
        let players: Vec<_> = of_task(task).filter(|player| player.name != "random").collect();
        let scores: Vec<Vec<f64>> = players
            .iter()
            .map(|player| {
                (0..SEEDS)
                    .map(|seed| {
                        let config = Config::check(&Settings::standard(task, seed))
                            .expect("the standard setting");
                        let mut game = LocalGame::new(Arc::new(config), player, seed);
                        while !game.world().is_over() {
                            let acts =
                                game.decide_by(|player, observation| player.decide(observation));
                            game.step(&acts);
                        }
                        game.world().score()
                    })
                    .collect()
            })
            .collect();
        for (first, above) in scores.iter().enumerate() {
            for (second, below) in scores.iter().enumerate().skip(first + 1) {
                let differences: Vec<f64> = above.iter().zip(below).map(|(a, b)| a - b).collect();
                let cells = [5, 10, 20]
                    .map(|seeds| percent(coverage(vec![resampled(&differences, 1)], seeds)));
                println!(
                    "| {} | `{}`, `{}` | {} |",
                    task.name(),
                    players[first].name,
                    players[second].name,
                    cells.join(" | ")
                );
            }
        }
        games.push(scores);
    }
    for (first, second) in [(0, 1), (1, 2)] {
        let differences: Vec<Vec<f64>> = games
            .iter()
            .map(|of| of[first].iter().zip(&of[second]).map(|(a, b)| a - b).collect())
            .collect();
        let cells = [5, 10, 20].map(|seeds| {
            let sources =
                (1..).zip(&differences).map(|(number, of)| resampled(of, number)).collect();
            percent(coverage(sources, seeds))
        });
        println!(
            "| all five | the players {} and {} of each | {} |",
            first + 1,
            second + 1,
            cells.join(" | ")
        );
    }
}

/// Draws from these differences with replacement.
fn resampled(differences: &[f64], seed: u64) -> Source<'_> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    #[expect(clippy::cast_precision_loss, reason = "hundreds")]
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    #[expect(clippy::cast_possible_truncation, reason = "a place in the list")]
    let draw = move || differences[(random.next_u64() % differences.len() as u64) as usize];
    Source { draw: Box::new(draw), mean }
}
