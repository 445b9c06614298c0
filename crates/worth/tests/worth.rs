//! Worth against plain rollouts, and what follows from its definition.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::Arc;

use swarmbench_engine::{Act, Action, AgentId, Config, RuleSet, Settings, TaskName, World};
use swarmbench_players::{BuiltIn, Player, Seat, default_for, find};
use swarmbench_worth::{Appraiser, Decided, Game, Liner, WORTH_REVISION, Worth, sent};

/// Seeds of each task; `.ci/full` sets 100.
fn seeds() -> u64 {
    std::env::var("SWARMBENCH_WORTH_SEEDS").map_or(4, |seeds| seeds.parse().expect("a number"))
}

fn layout(task: TaskName, rules: RuleSet, seed: u64) -> Arc<World> {
    layout_of(task, rules, seed, 100)
}

fn layout_of(task: TaskName, rules: RuleSet, seed: u64, rounds: i64) -> Arc<World> {
    let mut settings = Settings::standard(task, seed);
    settings.max_round = rounds;
    rules.name().clone_into(&mut settings.rules);
    Arc::new(World::new(Arc::new(Config::check(&settings).expect("good settings"))))
}

fn hosted(layout: &World, player: &BuiltIn) -> Vec<Box<dyn Player>> {
    let seat = |agent| player.make(&Seat::hosted(layout.config(), agent, b""));
    layout.agents().map(seat).collect()
}

fn decide(world: &World, players: &mut [Box<dyn Player>]) -> Vec<Act> {
    let decide = |(agent, player): (AgentId, &mut Box<dyn Player>)| {
        if !world.is_alive(agent) {
            return Act::default();
        }
        let mut act = player.decide(&world.observe(agent));
        act.action.get_or_insert(Action::Stay);
        act
    };
    world.agents().zip(players).map(decide).collect()
}

fn decided(acts: Vec<Act>) -> Vec<Decided> {
    acts.into_iter().map(|act| Decided { act, ..Decided::default() }).collect()
}

/// A game of a player; `change` may replace its acts.
fn game(
    layout: Arc<World>,
    player: &BuiltIn,
    mut change: impl FnMut(&World, &mut Vec<Act>),
) -> Game {
    let (mut world, mut players) = (World::clone(&layout), hosted(&layout, player));
    let mut rounds = Vec::new();
    while !world.is_over() {
        let mut acts = decide(&world, &mut players);
        change(&world, &mut acts);
        world.step(&acts);
        rounds.push(decided(acts));
    }
    Game { layout, rounds }
}

fn acts(round: &[Decided]) -> Vec<Act> {
    round.iter().map(|decided| decided.act.clone()).collect()
}

/// The score that the reference reaches if it sees the first `shown` states of a game and plays on from there, once `first` was
/// done, as a fork does: all is played from the beginning.
fn played_on(game: &Game, shown: usize, first: Option<Vec<Act>>) -> f64 {
    let mut world = World::clone(&game.layout);
    let mut players = hosted(&world, default_for(world.config().task()));
    for round in &game.rounds[..shown] {
        decide(&world, &mut players);
        world.step(&acts(round));
    }
    if let Some(first) = first {
        decide(&world, &mut players);
        world.step(&first);
    }
    while !world.is_over() {
        let acts = decide(&world, &mut players);
        world.step(&acts);
    }
    world.score()
}

fn random() -> &'static BuiltIn {
    find("random", TaskName::Pursuit).expect("it plays all tasks")
}

fn worth(game: &Game, with_seats: bool) -> Worth {
    Appraiser::new(game.clone(), with_seats).finish_on(1, |_| {})
}

fn losses(worth: &Worth) -> Vec<f64> {
    sent(worth, true).losses.expect("they are computed").iter().map(|round| round.loss).collect()
}

fn score(worth: &Worth) -> f64 {
    *worth.scores.last().expect("the score of the layout")
}

const RULES: [RuleSet; 2] = [RuleSet::Paper, RuleSet::Reference];

#[test]
fn a_worth_is_what_the_reference_scores_from_there() {
    for (task, rules) in TaskName::ALL.into_iter().flat_map(|task| RULES.map(|rules| (task, rules)))
    {
        let game = game(layout(task, rules, 31), random(), |_, _| {});
        let worth = worth(&game, false);
        assert_eq!(worth.values.len(), game.rounds.len() + 1);
        assert_eq!(worth.values.last(), worth.scores.last());
        for shown in (0..game.rounds.len()).step_by(9) {
            let expected = played_on(&game, shown, None);
            assert_eq!(
                worth.values[shown].to_bits(),
                expected.to_bits(),
                "{task:?} {rules:?} {shown}"
            );
        }
    }
}

/// Sums of the worth of all states of 30 rounds of `random`, with seed 31: a reference that decides otherwise has another revision.
const SUMS: [(TaskName, [f64; 2]); 5] = [
    (TaskName::Pursuit, [255.0, 183.0]),
    (TaskName::Synchronization, [465.0, 465.0]),
    (TaskName::Foraging, [108.0, 108.0]),
    (TaskName::Flocking, [267.0, 622.0]),
    (TaskName::Transport, [61.300_000_000_000_004, 62.600_000_000_000_01]),
];

#[test]
fn another_reference_has_another_revision() {
    let sums = SUMS.map(|(task, _)| {
        let game = |rules| game(layout_of(task, rules, 31, 30), random(), |_, _| {});
        (task, RULES.map(|rules| worth(&game(rules), false).values.iter().sum()))
    });
    assert_eq!((WORTH_REVISION, sums), (1, SUMS), "raise WORTH_REVISION, and note these sums");
}

#[test]
fn the_loss_of_a_seat_is_what_its_act_alone_would_have_changed() {
    for task in TaskName::ALL {
        let mut game = game(layout(task, RuleSet::Paper, 7), random(), |_, _| {});
        game.rounds.truncate(12);
        let worth = worth(&game, true);
        let losses = worth.seats.as_ref().expect("they were asked for");
        for round in [0, 5, 11] {
            for (seat, loss) in losses[round].iter().enumerate() {
                let mut changed = acts(&game.rounds[round]);
                changed[seat] = worth.reference_acts[round][seat].clone();
                let expected = played_on(&game, round, Some(changed)) - worth.values[round + 1];
                assert_eq!(
                    loss.to_bits(),
                    expected.to_bits(),
                    "{task:?} round {round} seat {seat}"
                );
            }
        }
    }
}

#[test]
fn a_game_of_the_reference_loses_nothing() {
    for (task, rules) in TaskName::ALL.into_iter().flat_map(|task| RULES.map(|rules| (task, rules)))
    {
        for seed in 0..seeds() {
            let game = game(layout(task, rules, seed), default_for(task), |_, _| {});
            let worth = worth(&game, true);
            assert!(
                worth.values.iter().all(|value| value.to_bits() == score(&worth).to_bits()),
                "{task:?} {seed}"
            );
            assert!(worth.seats.iter().flatten().flatten().all(|loss| *loss == 0.0));
        }
    }
}

#[test]
fn losses_sum_to_what_could_be_scored_and_was_not() {
    for task in TaskName::ALL {
        for seed in 0..seeds() {
            let game = game(layout_of(task, RuleSet::Paper, seed, 30), random(), |_, _| {});
            let worth = worth(&game, false);
            let sum: f64 = losses(&worth).iter().sum();
            assert!((sum - (worth.values[0] - score(&worth))).abs() < 1e-9, "{task:?} {seed}");
        }
    }
}

/// A mistake of one seat in one round of a game of the reference is the decision that lost most, where it cost anything. Each game lasts as
/// long as the reference needs, so that no time is left to mend the mistake.
#[test]
fn a_planted_mistake_is_found() {
    for task in TaskName::ALL {
        let (mut cost, mut found) = (0, 0);
        for seed in 0..seeds().min(50) {
            let of_reference = |layout| game(layout, default_for(task), |_, _| {});
            let whole = of_reference(layout(task, RuleSet::Paper, seed)).rounds.len();
            let layout = layout_of(task, RuleSet::Paper, seed, i64::try_from(whole).expect("few"));
            let best = scored(&of_reference(Arc::clone(&layout)));
            let planted = (0..whole).find_map(|again| {
                let at = (whole / 3 + again) % whole;
                let seat =
                    (usize::try_from(seed).expect("small") + again) % layout.agents().count();
                let game = with_a_mistake(&layout, at, seat);
                (scored(&game) < best).then_some((at, seat, game))
            });
            let Some((at, seat, game)) = planted else { continue };
            cost += 1;
            let dearest = sent(&worth(&game, true), true).dearest.expect("with seats");
            found += usize::from(dearest.first().is_some_and(|dear| {
                dear.round as usize == at && dear.agent == format!("Agent_{seat}")
            }));
        }
        assert!(cost > 0 && found * 10 >= cost * 9, "{task:?}: {found} of {cost}");
    }
}

fn scored(game: &Game) -> f64 {
    let mut world = World::clone(&game.layout);
    game.rounds.iter().for_each(|round| world.step(&acts(round)));
    world.score()
}

/// A game of the reference in which a seat does the opposite in a round.
fn with_a_mistake(layout: &Arc<World>, at: usize, seat: usize) -> Game {
    let task = layout.config().task();
    game(Arc::clone(layout), default_for(task), |world, acts| {
        let agent = AgentId(u16::try_from(seat).expect("few"));
        if world.round() as usize == at && world.is_alive(agent) {
            let wrong = acts[seat].action.map(opposite);
            acts[seat].action = Action::of_task(task).iter().copied().find(|a| Some(*a) == wrong);
        }
    })
}

fn opposite(action: Action) -> Action {
    match action {
        Action::Up => Action::Down,
        Action::Left => Action::Right,
        Action::Right => Action::Left,
        Action::Switch => Action::Stay,
        Action::Down | Action::Stay => Action::Up,
    }
}

#[test]
fn threads_and_pieces_change_nothing() {
    // Copies of players who remember so large a map take longer than a piece.
    let mut settings = Settings::standard(TaskName::Foraging, 5);
    (settings.width, settings.height, settings.max_round) = (40, 40, 30);
    let layout = Arc::new(World::new(Arc::new(Config::check(&settings).expect("good settings"))));
    let mut game = game(layout, random(), |_, _| {});
    // A game that is not over.
    game.rounds.truncate(20);
    let expected = sent(&worth(&game, true), false);
    for threads in [1, 2, 3, 7] {
        let appraiser = Appraiser::new(game.clone(), true);
        assert_eq!(sent(&appraiser.finish_on(threads, |_| {}), false), expected);
    }
    let mut pieces = Box::new(Appraiser::new(game, true));
    let worth = loop {
        // The time is up at each third question.
        let asked = Cell::new(0);
        let is_time_up = || asked.replace(asked.get() + 1) % 3 == 2;
        match pieces.work(&is_time_up) {
            ControlFlow::Continue(unfinished) => pieces = unfinished,
            ControlFlow::Break(worth) => break worth,
        }
    };
    assert_eq!(sent(&worth, false), expected);
}

#[test]
fn the_line_is_what_a_fork_plays() {
    let game = game(layout(TaskName::Pursuit, RuleSet::Paper, 3), random(), |_, _| {});
    let ControlFlow::Break(line) = Box::new(Liner::new(game.clone(), 20, 1000)).work(&|| false)
    else {
        panic!("its work is bounded");
    };
    let last = line.rounds.last().expect("it plays on");
    assert_eq!(last.score.to_bits(), played_on(&game, 20, None).to_bits());
}
