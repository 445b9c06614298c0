//! Pictures of games of built-in players.

use std::sync::Arc;

use swarmbench_analysis::game::{Decision, Setup, State};
use swarmbench_analysis::{Meter, Options};
use swarmbench_engine::{Act, Config, Message, Settings, TaskName};
use swarmbench_players::default_for;
use swarmbench_players::game::LocalGame;
use swarmbench_replay::draw::Scene;
use swarmbench_replay::draw::frame::Moment;
use swarmbench_replay::draw::moments::Moments;

/// Names that would break a document that does not escape them.
pub(crate) const HOSTILE: [&str; 6] = [
    "<script>alert(1)</script>",
    "\"/><text onload='x'>&amp;",
    "]]><!--<![CDATA[",
    "\u{0}\u{1}\u{8}\u{1b}[31m\u{7f}\u{202e}evil\u{2066}\n\t",
    "語 한 🦀 عربى e\u{301}",
    "%s ${x} {{y}} \\u0000",
];

/// All moments of a game of a built-in player whose agents say something now and then.
pub(crate) fn moments(
    settings: &Settings,
    task: TaskName,
    rounds: u32,
    windows: bool,
) -> Vec<Moment> {
    let config = Config::check(settings).expect("settings that can be played");
    let mut game = LocalGame::new(Arc::new(config), default_for(task), 1);
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

/// Moments of a standard game side by side.
pub(crate) fn moments_of(task: TaskName, places: &[usize], messages: bool) -> Moments {
    let all = moments(&Settings::standard(task, 27), task, 60, false);
    let chosen = places.iter().map(|&place| all[place.min(all.len() - 1)].clone());
    Moments { title: task.name().to_owned(), moments: chosen.collect(), messages }
}

/// Pictures with their names: small and large ones, and one for each hostile title.
pub(crate) fn all() -> Vec<(String, Scene)> {
    let transport = moments_of(TaskName::Transport, &[0, 5, 20, 60], false);
    let hostile = HOSTILE.map(|title| Moments {
        title: title.to_owned(),
        moments: transport.moments[..1].to_vec(),
        messages: false,
    });
    let named = [
        ("transport", transport),
        ("messages", moments_of(TaskName::Foraging, &[3, 10], true)),
        ("lights", moments_of(TaskName::Synchronization, &[2], true)),
        ("pursuit", moments_of(TaskName::Pursuit, &[4, 9, 15], false)),
    ];
    let hostile =
        (0..).zip(hostile).map(|(number, moments)| (format!("hostile-{number}"), moments));
    let named = named.into_iter().map(|(name, moments)| (name.to_owned(), moments));
    named.chain(hostile).map(|(name, moments)| (name, moments.scene())).collect()
}
