//! Metrics beyond the paper's.

use swarmbench_analysis::game::Decision;
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::Action::{Down, Left, Right, Stay, Up};
use swarmbench_engine::Pos;

use crate::played::{Played, does, says};

#[test]
fn a_step_is_a_revisit_if_the_cell_was_left_longer_ago_than_is_remembered() {
    // To and fro between two cells: each is entered in the round after it was left.
    let to_and_fro = |memory| {
        let mut game = Played::at(&[(1, 1)]);
        game.setup.memory = memory;
        let game = game.then(&[does(Right)], &[(1, 2)]).then(&[does(Left)], &[(1, 1)]);
        game.then(&[does(Right)], &[(1, 2)]).then(&[does(Left)], &[(1, 1)])
    };
    assert_eq!(to_and_fro(Some(0)).value(Metric::RevisitShare), Some(0.75));
    assert_eq!(to_and_fro(Some(1)).value(Metric::RevisitShare), Some(0.0));
    assert_eq!(to_and_fro(None).value(Metric::RevisitShare), None);
    // A cell is entered again after a longer way, and then one round of standing on it.
    let cells = [(1, 2), (2, 2), (2, 1), (1, 1), (1, 1), (1, 2)];
    let around = |memory| {
        let mut game = Played::at(&[(1, 1)]);
        game.setup.memory = Some(memory);
        let game = cells.iter().fold(game, |game, &cell| game.then(&[does(Stay)], &[cell]));
        game.value(Metric::RevisitShare)
    };
    assert_eq!([around(2), around(3), around(4)], [Some(0.4), Some(0.2), Some(0.0)]);
}

#[test]
fn messages_are_delivered_to_others_or_unheard() {
    let game = Played::at(&[(1, 1), (1, 2), (9, 9)])
        .chose(&[says("a"), says("b"), says("c")])
        .delivering(&[
            (0, 0, 0, "a"),
            (0, 1, 0, "b"),
            (1, 0, 0, "a"),
            (2, 2, 0, "c"),
            (2, 0, 0, "a"),
        ])
        .chose(&[does(Stay), does(Stay), does(Stay)]);
    assert_eq!(game.value(Metric::Delivered), Some(1.0));
    assert_eq!(game.value(Metric::UnheardShare), Some(1.0 / 3.0));
    assert_eq!(game.run_value(Metric::Delivered).rounds, 1);
    let mut unknown = game;
    unknown.rounds[1].heard = None;
    assert_eq!(unknown.value(Metric::Delivered), None);
    assert_eq!(unknown.value(Metric::Echo), None);
}

#[test]
fn an_echo_repeats_what_another_agent_was_just_heard_to_say() {
    let game = Played::at(&[(1, 1), (1, 2), (1, 3)])
        .chose(&[says("hold (3,4) now"), says("mine"), does(Stay)])
        .delivering(&[(0, 1, 0, "mine"), (1, 0, 0, "hold (3,4) now"), (1, 1, 0, "mine")])
        // Agent 1 changes one of 14 characters, and its own message does not count; agent 2 heard nothing.
        .chose(&[says("mine"), says("hold (3,5) now"), says("mine")])
        .chose(&[says("mine"), does(Stay), does(Stay)]);
    let series = game.metrics().series[&(Definition::Paper, Metric::Echo)].clone();
    assert_eq!(series, [None, None, Some(2.0 / 3.0), Some(0.0)]);
    let own = Played::at(&[(1, 1)]).chose(&[says("mine")]).delivering(&[(0, 0, 0, "mine")]);
    assert_eq!(own.chose(&[says("mine")]).value(Metric::Echo), Some(0.0));
}

#[test]
fn self_repetition_skips_rounds_of_silence() {
    let game = Played::at(&[(1, 1)]).chose(&[says("kitten")]).chose(&[does(Stay)]);
    let run = game.chose(&[says("sitting")]).run_value(Metric::SelfRepeat);
    assert_eq!((run.value, run.rounds), (Some(1.0 - 3.0 / 7.0), 1));
}

#[test]
fn agents_keep_their_word_at_once_or_in_the_next_round() {
    let announced = |text: &str, then: [Decision; 2]| {
        let [at_once, next] = then;
        let first = Decision { message: Some(text.to_owned()), ..at_once };
        let game = Played::at(&[(5, 5)]).chose(&[first]).chose(&[next]).chose(&[does(Left)]);
        game.value(Metric::SayDo)
    };
    assert_eq!(announced("I go up", [does(Up), does(Stay)]), Some(1.0));
    assert_eq!(announced("I go up", [does(Stay), does(Up)]), Some(1.0));
    assert_eq!(announced("I go up", [does(Down), does(Down)]), Some(0.0));
    assert_eq!(announced("I go left", [does(Down), does(Down)]), Some(0.0));
    assert_eq!(announced("up or down", [does(Up), does(Up)]), None);
}

/// A block of 1 × 2 cells at (5,5), (5,6) with these agents.
fn transport(cells: &[(i32, i32)], decisions: &[Decision]) -> Played {
    let mut game = Played::at(cells);
    game.layout.block = vec![Pos::new(5, 5), Pos::new(5, 6)];
    game.chose(decisions)
}

#[test]
fn agents_push_the_block_alone_or_in_line() {
    // Two agents in line on the left, one above, one adjacent without pushing, one too far away.
    let cells = [(5, 4), (5, 3), (4, 6), (6, 5), (5, 1)];
    let game = transport(&cells, &[does(Right), does(Right), does(Down), does(Stay), does(Right)]);
    assert_eq!(game.value(Metric::ForcePeak), Some(2.0));
    // Of the three agents that touch the block one pushes right and one down.
    assert_eq!(game.value(Metric::PushAlignment), Some(2.0_f64.sqrt() / 3.0));
    let broken = transport(&cells[..2], &[does(Stay), does(Right)]);
    assert_eq!(broken.value(Metric::ForcePeak), Some(0.0));
    assert_eq!(broken.value(Metric::PushAlignment), Some(0.0));
}

#[test]
fn the_peak_of_a_game_is_that_of_its_strongest_round() {
    let game = transport(&[(5, 4), (5, 3)], &[does(Right), does(Right)]);
    let game = game.chose(&[does(Stay), does(Stay)]);
    assert_eq!(game.run_value(Metric::ForcePeak).value, Some(2.0));
}

#[test]
fn nobody_pushes_a_block_that_has_left_the_map() {
    let mut game = Played::at(&[(0, 0)]);
    game.layout.block = vec![Pos::new(-1, 0)];
    let game = game.chose(&[does(Up)]);
    assert_eq!(game.value(Metric::ForcePeak), None);
    assert_eq!(game.value(Metric::PushAlignment), None);
}

#[test]
fn lights_agree_as_far_as_most_have_the_same_state() {
    let mut game =
        Played::at(&[(1, 1), (1, 2), (1, 3)]).chose(&[does(Stay), does(Stay), does(Stay)]);
    for (agent, on) in game.last().agents.iter_mut().zip([true, false, false]) {
        agent.light_on = Some(on);
    }
    assert_eq!(game.value(Metric::LightAgreement), Some(2.0 / 3.0));
}

#[test]
fn scores_and_tokens_give_rounds_and_costs() {
    let spent = |tokens| Decision { tokens, ..does(Stay) };
    let mut game = Played::at(&[(1, 1)]).chose(&[spent(Some(100))]).chose(&[spent(None)]);
    assert_eq!(game.value(Metric::TimeToFirstScore), None);
    assert_eq!(game.value(Metric::TokensPerPoint), None);
    game.last().score = 4.0;
    assert_eq!(game.value(Metric::TimeToFirstScore), Some(2.0));
    assert_eq!(game.value(Metric::TokensPerPoint), Some(25.0));
}

#[test]
fn rounds_with_many_texts_are_sampled_by_their_hashes() {
    let cells: Vec<_> = (0..66).map(|n| (n / 10, n % 10)).collect();
    let said = |count: usize| {
        let texts = (0..66).map(|n| says(&format!("text number {}", n.min(count - 1))));
        Played::at(&cells).chose(&texts.collect::<Vec<_>>()).metrics()
    };
    let (all, some) = (said(64), said(66));
    assert_eq!((all.sampled, some.sampled), (false, true));
    let value = some.value(Definition::Paper, Metric::EditConsistency).value;
    assert!(value.is_some_and(|value| (0.0..1.0).contains(&value)), "{value:?}");
}
