//! The tables of docs/measured/baselines.md for both rule sets and for other sizes, as Markdown.
//!
//! ```sh
//! cargo bench -p swarmbench-players --bench tables -- rules
//! cargo bench -p swarmbench-players --bench tables -- sizes
//! ```
//!
//! Both tables are made if none is named. `.ci/baselines` writes them into the page.

use swarmbench_engine::{Config, RuleSet, Settings, TaskName};
use swarmbench_players::{default_for, game};

/// The swarm's own seed, as in examples/eval/baselines.toml.
const PLAYER_SEED: u64 = 1;

/// Number of layouts played in the standard setting.
const SEEDS: u64 = 100;

/// Number of layouts played of each size.
const SEEDS_OF_SIZES: u64 = 20;

/// Side lengths of the square maps, in cells.
const SIZES: [i64; 5] = [8, 10, 12, 15, 20];

const AGENTS: [i64; 6] = [8, 12, 16, 20, 24, 30];

/// Tasks whose scores depend on more than the layout.
const TASKS_OF_SIZES: [TaskName; 3] = [TaskName::Pursuit, TaskName::Foraging, TaskName::Transport];

/// The scores of a task's best player, one for each seed; `None` if the agents do not fit on the map.
fn scores(settings: &Settings, task: TaskName, seeds: u64) -> Option<Vec<f64>> {
    let of_seed = |seed| {
        let Settings { task, seed, .. } = Settings::standard(task, seed);
        Settings { task, seed, ..settings.clone() }
    };
    Config::check(&of_seed(0)).ok()?;
    let score = |seed| Some(game::play(default_for(task), &of_seed(seed), PLAYER_SEED).ok()?.0);
    (0..seeds).map(score).collect()
}

/// The mean and its standard error.
#[expect(clippy::cast_precision_loss, reason = "a few games")]
fn mean_and_error(scores: &[f64]) -> (f64, f64) {
    let count = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / count;
    let squares: f64 = scores.iter().map(|score| (score - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0) / count).sqrt())
}

fn of_rules(rules: RuleSet) -> Settings {
    Settings { rules: rules.name().to_owned(), ..Settings::default() }
}

/// The standard setting: a row for each task, a column for each rule set.
fn print_rules() {
    println!("| task | player | `paper` | least | `reference` | least |");
    println!("| --- | --- | ---: | ---: | ---: | ---: |");
    for task in TaskName::ALL {
        let cell = |rules| {
            let scores = scores(&of_rules(rules), task, SEEDS).expect("a playable setting");
            let (mean, error) = mean_and_error(&scores);
            let least = scores.iter().copied().fold(f64::INFINITY, f64::min);
            format!("{mean:.2} ± {error:.2} | {least:.2}")
        };
        let cells = RuleSet::ALL.map(cell).join(" | ");
        println!("| {} | `{}` | {cells} |", task.name(), default_for(task).name);
    }
}

/// A table for each task and rule set: a row for each map, a column for each number of agents.
fn print_sizes() {
    for task in TASKS_OF_SIZES {
        for rules in RuleSet::ALL {
            println!("\n{}, `{}`:\n", task.name(), rules.name());
            println!("| map | {} |", AGENTS.map(|agents| format!("{agents} agents")).join(" | "));
            println!("| --- |{}", " ---: |".repeat(AGENTS.len()));
            for size in SIZES {
                let cell = |num_agents| {
                    let (width, height) = (size, size);
                    let settings = Settings { num_agents, width, height, ..of_rules(rules) };
                    scores(&settings, task, SEEDS_OF_SIZES).map_or(String::new(), |scores| {
                        let (mean, error) = mean_and_error(&scores);
                        format!("{mean:.1} ± {error:.1}")
                    })
                };
                println!("| {size} × {size} | {} |", AGENTS.map(cell).join(" | "));
            }
        }
    }
    println!();
}

#[expect(clippy::disallowed_methods, reason = "what is asked for comes from the command line")]
fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let is_asked = |word: &str| words.is_empty() || words.iter().any(|asked| asked == word);
    if is_asked("rules") {
        print_rules();
    }
    if is_asked("sizes") {
        print_sizes();
    }
}
