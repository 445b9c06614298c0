//! Figures of made-up numbers of different sizes, and frames of games of built-in players.

use std::sync::Arc;

use swarmbench_analysis::game::{Decision, Setup, State};
use swarmbench_analysis::metric::Panel as Group;
use swarmbench_analysis::{Meter, Options};
use swarmbench_engine::{Act, Config, Message, Settings, TaskName};
use swarmbench_figures::board::{Board, Row, Score};
use swarmbench_figures::dynamics::{Curve, Dynamics};
use swarmbench_figures::frame::{Frames, Moment};
use swarmbench_figures::sensitivity::{Point, Sensitivity};
use swarmbench_figures::series::{Band, Summary};
use swarmbench_figures::trends::{Line, Panel, Trends};
use swarmbench_figures::{Figure, Scene};
use swarmbench_players::default_for;
use swarmbench_players::game::Game;

/// Names that would break a document that does not escape them.
pub(crate) const HOSTILE: [&str; 6] = [
    "<script>alert(1)</script>",
    "\"/><text onload='x'>&amp;",
    "]]><!--<![CDATA[",
    "\u{0}\u{1}\u{8}\u{1b}[31m\u{7f}\u{202e}evil\u{2066}\n\t",
    "語 한 🦀 عربى e\u{301}",
    "%s ${x} {{y}} \\u0000",
];

/// Numbers that look like those of a game, the same on every machine.
fn wave(seed: usize, length: usize) -> Vec<Option<f64>> {
    let mut state = seed as u64 * 2_654_435_761 + 1;
    let mut value = 0.3;
    (0..length)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            value += ((state >> 33) % 100) as f64 / 1000.0 - 0.047;
            value = f64::clamp(value, 0.0, 1.0);
            (state >> 40 & 31 > 0).then_some(value)
        })
        .collect()
}

fn rising(seed: usize, length: usize, most: f64) -> Vec<Option<f64>> {
    let mut score = 0.0;
    let scores = wave(seed, length).into_iter().map(|value| {
        if value.is_some_and(|value| value > 0.5) {
            score += most / 40.0;
        }
        Some(score)
    });
    scores.collect()
}

fn band(seed: usize, games: usize, make: impl Fn(usize) -> Vec<Option<f64>>) -> Band {
    let games: Vec<_> = (0..games).map(|game| make(seed * 31 + game)).collect();
    Band::of(&games.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

pub(crate) fn names(count: usize, length: usize) -> Vec<String> {
    (0..count)
        .map(|number| {
            let name = format!("vendor/model-{number}");
            name.clone() + &"-preview".repeat(length.saturating_sub(name.len()).div_ceil(8))
        })
        .collect()
}

pub(crate) fn trends(models: Vec<String>, rounds: usize) -> Trends {
    let lines = |task: usize| {
        let line = |model| {
            let make = |seed| rising(seed + task * 7, rounds + 1, 12.0);
            Line { model, score: band(model, 5, make) }
        };
        (0..models.len()).map(line).collect()
    };
    let panels = TaskName::ALL.iter().enumerate().map(|(task, name)| Panel {
        task: name.name().to_owned(),
        rounds,
        // A task without games must be shown as empty.
        lines: if task == 3 { Vec::new() } else { lines(task) },
    });
    Trends {
        panels: panels.collect(),
        notes: vec!["paper rules, 12 agents, 10×10, k = 5".to_owned()],
        models,
    }
}

pub(crate) fn dynamics(title: &str, rounds: usize, games: usize) -> Dynamics {
    let curve = |seed: usize, name: &str, divisor: f64| {
        let make = |seed| {
            let values = wave(seed, rounds).into_iter();
            values.map(|value| value.map(|value| value * divisor)).collect::<Vec<_>>()
        };
        let best = if games > 0 { make(seed * 31) } else { Vec::new() };
        Curve { name: name.to_owned(), divisor, band: band(seed, games, make), best }
    };
    let metrics = [
        (Group::Messages, "Proportion of question sentences", 1.0),
        (Group::Messages, "Proportion of digit characters", 1.0),
        (Group::Messages, "Mean message length", 200.0),
        (Group::Messages, "Information homogeneity", 2.0),
        (Group::Choices, "Directional entropy", 2.0),
        (Group::Choices, "Stillness proportion", 1.0),
        (Group::Choices, "Dominant action proportion", 1.0),
        (Group::Choices, "Polarization index", 1.0),
        (Group::Positions, "Path length", 50.0),
        (Group::Positions, "Exploration rate", 100.0),
        (Group::Positions, "Local structure preservation count", 10.0),
        (Group::Positions, "Agent push events", 4.0),
    ];
    let metrics = metrics.into_iter().enumerate();
    let metrics = metrics.map(|(n, (panel, name, divisor))| (panel, curve(n + 2, name, divisor)));
    let best = rising(31, rounds, 12.0);
    let score = Curve {
        name: "Score".to_owned(),
        divisor: 1.0,
        band: band(1, games, |seed| rising(seed, rounds, 12.0)),
        best: if games > 0 { best } else { Vec::new() },
    };
    Dynamics {
        title: title.to_owned(),
        notes: vec!["definition paper, metrics revision 1, embedder hash-1".to_owned()],
        games,
        rounds,
        score,
        metrics: metrics.collect(),
    }
}

pub(crate) fn sensitivity(lines: usize, places: usize) -> Sensitivity {
    let point = |task: usize, line: usize, place: usize| Point {
        line,
        across: 8.0 + 4.0 * place as f64,
        score: Summary {
            mean: 4.0 + ((task * 5 + line * 3 + place * 2) % 7) as f64,
            deviation: 0.8 + (place % 3) as f64 / 2.0,
            n: 5 - (line + place) % 2,
        },
    };
    let panel = |(task, name): (usize, &TaskName)| {
        let all = (0..lines).flat_map(|line| (0..places).map(move |place| (line, place)));
        let points = all.map(|(line, place)| point(task, line, place)).collect();
        (name.name().to_owned(), if task == 1 { Vec::new() } else { points })
    };
    Sensitivity {
        notes: vec!["paper rules, 10×10".to_owned()],
        across: "agents".to_owned(),
        line: "window".to_owned(),
        values: (0..lines).map(|line| 3.0 + 2.0 * line as f64).collect(),
        panels: TaskName::ALL.iter().enumerate().map(panel).collect(),
    }
}

pub(crate) fn board(models: Vec<String>) -> Board {
    let rows = models.into_iter().enumerate().map(|(number, model)| {
        let score = |task: usize| {
            let mean = [0.65, 9.8, 12.0, 4.2, 8.39][task] / (1.0 + number as f64 / 3.0);
            let n = (number % 4 > 0).then_some(5);
            (number + task != 4).then_some(Score { mean, deviation: Some(mean / 5.0), n })
        };
        Row { reference: number % 4 == 0, scores: (0..5).map(score).collect(), model }
    });
    Board {
        title: "Board of the suite standard".to_owned(),
        notes: vec!["rules paper, best run of each".to_owned()],
        tasks: TaskName::ALL.iter().map(|task| task.name().to_owned()).collect(),
        rows: rows.collect(),
    }
}

/// All moments of a game of a built-in player whose agents say something now and then.
pub(crate) fn moments(
    settings: &Settings,
    task: TaskName,
    rounds: u32,
    windows: bool,
) -> Vec<Moment> {
    let config = Config::check(settings).expect("settings that can be played");
    let mut game = Game::new(Arc::new(config), default_for(task), 1);
    let mut moments = Vec::new();
    let options = Options { series: false, vectors: false, edits: false };
    let layout = State::of(game.world());
    let mut meter = Meter::new(Setup::of(game.world()), layout, options);
    while !game.world().is_over() && game.world().round() < rounds {
        let mut moment = Moment::of(game.world(), windows);
        let mut acts = game.decide();
        for (number, act) in acts.iter_mut().enumerate() {
            match (number + moments.len()) % 5 {
                0 => act.message = Message::new(HOSTILE[number % HOSTILE.len()]),
                1 => {
                    act.message = Message::new(
                        "I go to (3,4) and wait there for the others, who comes with me?",
                    );
                }
                2 if number == 2 => act.action = None,
                _ => {}
            }
        }
        game.step(&acts);
        let decision = |act: &Act| Decision {
            action: act.action,
            message: act.message.as_ref().map(|message| message.as_str().to_owned()),
            ..Decision::default()
        };
        let decisions: Vec<Decision> = acts.iter().map(decision).collect();
        meter.round(&decisions, State::of(game.world()), None);
        let numbered: Vec<(u16, Act)> = (0..).zip(acts).collect();
        moment.decided(&numbered, game.world(), *meter.now().0);
        moments.push(moment);
    }
    moments.push(Moment::of(game.world(), windows));
    moments
}

pub(crate) fn frames(task: TaskName, places: &[usize], messages: bool) -> Frames {
    let moments = moments(&Settings::standard(task, 27), task, 60, false);
    let chosen = places.iter().map(|&place| moments[place.min(moments.len() - 1)].clone());
    Frames { title: task.name().to_owned(), moments: chosen.collect(), messages }
}

/// Every figure with its name, with little data and with much.
pub(crate) fn all() -> Vec<(String, Scene)> {
    let hostile = HOSTILE.map(str::to_owned).to_vec();
    let figures: Vec<(&str, Box<dyn Figure>)> = vec![
        ("trends-none", Box::new(trends(Vec::new(), 100))),
        ("trends-one", Box::new(trends(names(1, 0), 100))),
        ("trends-13", Box::new(trends(names(13, 40), 100))),
        ("trends-long", Box::new(trends(names(5, 200), 3))),
        ("trends-hostile", Box::new(trends(hostile, 20))),
        ("dynamics-one", Box::new(dynamics("vendor/model-1, Pursuit", 100, 1))),
        ("dynamics-five", Box::new(dynamics("vendor/model-1, Pursuit", 100, 5))),
        ("dynamics-none", Box::new(dynamics(&names(1, 200)[0], 100, 0))),
        ("dynamics-short", Box::new(dynamics(HOSTILE[0], 2, 2))),
        ("sensitivity-3", Box::new(sensitivity(3, 3))),
        ("sensitivity-one", Box::new(sensitivity(1, 1))),
        ("sensitivity-9", Box::new(sensitivity(9, 12))),
        ("sensitivity-none", Box::new(sensitivity(0, 0))),
        ("board-3", Box::new(board(names(3, 0)))),
        ("board-13", Box::new(board(names(13, 200)))),
        ("board-none", Box::new(board(Vec::new()))),
        ("frames-transport", Box::new(frames(TaskName::Transport, &[0, 5, 20, 60], false))),
        ("frames-messages", Box::new(frames(TaskName::Foraging, &[3, 10], true))),
        ("frames-lights", Box::new(frames(TaskName::Synchronization, &[2], true))),
        ("frames-pursuit", Box::new(frames(TaskName::Pursuit, &[4, 9, 15], false))),
    ];
    figures.into_iter().map(|(name, figure)| (name.to_owned(), figure.scene())).collect()
}
