//! The edges of definitions: no rounds, one agent, silence, and the like.

use swarmbench_analysis::game::Decision;
use swarmbench_analysis::{Counts, Definition, Metric};
use swarmbench_engine::Action::{Down, Left, Right, Stay, Switch, Up};
use swarmbench_engine::Pos;

use crate::played::{Played, does, says};

const OF_MESSAGES: [Metric; 5] = [
    Metric::QuestionShare,
    Metric::DigitShare,
    Metric::MessageLength,
    Metric::MessageLengthStd,
    Metric::Homogeneity,
];

#[test]
fn without_rounds_nothing_is_defined() {
    let metrics = Played::at(&[(1, 1), (1, 2)]).metrics();
    for (key, run) in &metrics.values {
        assert_eq!((run.value, run.rounds), (None, 0), "{key:?}");
    }
    assert_eq!(metrics.counts, [Counts { explored: 2, ..Counts::default() }]);
    assert_eq!(metrics.series[&(Definition::Paper, Metric::Explored)], [Some(2.0)]);
    assert_eq!(metrics.series[&(Definition::Paper, Metric::Stillness)], [None]);
    assert_eq!(metrics.series[&(Definition::Toolkit, Metric::Stillness)], [Some(0.0)]);
}

#[test]
fn values_are_those_of_each_definition_and_series_those_of_rounds() {
    let metrics = Played::at(&[(1, 1)]).chose(&[does(Stay)]).metrics();
    let of = |definition| move |&&(own, _): &&(Definition, Metric)| own == definition;
    let named = |keys: Vec<&(Definition, Metric)>| keys.iter().map(|key| key.1).collect::<Vec<_>>();
    let paper = named(metrics.values.keys().filter(of(Definition::Paper)).collect());
    assert_eq!(paper, Metric::ALL);
    let toolkit = named(metrics.values.keys().filter(of(Definition::Toolkit)).collect());
    assert_eq!(toolkit, Metric::ALL[..13]);
    for (&(_, metric), series) in &metrics.series {
        assert!(metric.about().by_round && series.len() == 2, "{metric:?}");
    }
}

#[test]
fn one_round_has_no_trend() {
    let game = Played::at(&[(1, 1), (5, 5)]).chose(&[says("a b"), says("a c")]);
    assert!(game.value(Metric::Homogeneity).is_some());
    for metric in [
        Metric::HomogeneityIncrease,
        Metric::HomogeneitySlope,
        Metric::EditConsistencyIncrease,
        Metric::EditConsistencySlope,
    ] {
        let run = game.run_value(metric);
        assert_eq!((run.value, run.rounds), (None, 1), "{metric:?}");
    }
}

#[test]
fn one_agent_has_no_neighbours_and_nobody_to_agree_with() {
    let game =
        Played::at(&[(1, 1)]).then(&[says("alone?")], &[(1, 1)]).then(&[does(Right)], &[(1, 2)]);
    assert_eq!(game.value(Metric::Homogeneity), None);
    assert_eq!(game.value(Metric::KeptPairs), Some(0.0));
    assert_eq!(game.value(Metric::Pushes), Some(0.0));
    assert_eq!(game.value(Metric::DominantAction), Some(1.0));
    assert_eq!(game.value(Metric::Components), Some(1.0));
    assert_eq!(game.value(Metric::ComponentsNorm), None);
    assert_eq!(game.value(Metric::Separation), Some(0.0));
    assert_eq!(game.value(Metric::QuestionShare), Some(1.0));
}

#[test]
fn silence_leaves_metrics_of_messages_undefined() {
    let game = Played::at(&[(1, 1), (1, 2)]).chose(&[does(Stay), does(Up)]);
    for metric in OF_MESSAGES {
        let run = game.run_value(metric);
        assert_eq!((run.value, run.rounds), (None, 0), "{metric:?}");
        assert_eq!(game.toolkit(metric), Some(0.0), "{metric:?}");
    }
}

#[test]
fn rounds_without_messages_are_no_part_of_a_mean() {
    let game = Played::at(&[(1, 1)]).chose(&[says("1?")]).chose(&[does(Stay)]);
    let run = game.run_value(Metric::DigitShare);
    assert_eq!((run.value, run.rounds), (Some(0.5), 1));
    assert_eq!(game.toolkit(Metric::DigitShare), Some(0.25));
}

#[test]
fn when_all_stand_still_nothing_is_a_direction() {
    let game = Played::at(&[(1, 1), (1, 2), (2, 2)]);
    let nothing = Decision::default();
    let game = game.chose(&[does(Stay), nothing.clone(), does(Stay)]);
    let game = game.chose(&[nothing.clone(), nothing, does(Stay)]);
    let value = |metric| game.value(metric);
    assert_eq!(value(Metric::DirectionEntropy), None);
    assert_eq!(value(Metric::Stillness), Some(1.0));
    assert_eq!(value(Metric::DominantAction), Some(1.0));
    assert_eq!(value(Metric::Polarization), Some(0.0));
    assert_eq!(value(Metric::StepLength), Some(0.0));
    assert_eq!(value(Metric::Explored), Some(3.0));
    assert_eq!(value(Metric::KeptPairs), Some(2.0));
    assert_eq!(value(Metric::Pushes), Some(0.0));
    assert_eq!(value(Metric::NoActionShare), Some(0.5));
    assert_eq!(value(Metric::BlockedShare), None);
    assert_eq!(value(Metric::DirectionImbalance), None);
    assert_eq!(value(Metric::RevisitShare), None);
}

#[test]
fn when_all_switch_nobody_is_still_or_coordinated() {
    let game = Played::at(&[(1, 1), (1, 2)]).chose(&[does(Switch), does(Switch)]);
    assert_eq!(game.value(Metric::DominantAction), None);
    assert_eq!(game.value(Metric::Polarization), None);
    assert_eq!(game.value(Metric::Stillness), Some(0.0));
    assert_eq!(game.toolkit(Metric::DominantAction), Some(0.0));
}

/// A game of two neighbours; the first leaves the map in round 0, the second in round 2.
fn escape() -> Played {
    let mut game = Played::at(&[(0, 3), (0, 4)]).then(&[does(Up), does(Down)], &[(-1, 3), (1, 4)]);
    game.last().agents[0].alive = false;
    let gone = Decision::default();
    let mut game = game.then(&[gone.clone(), does(Up)], &[(-1, 3), (0, 4)]);
    game.last().agents[0].alive = false;
    let mut game = game.then(&[gone, does(Up)], &[(-1, 3), (-1, 4)]);
    game.last().agents.iter_mut().for_each(|agent| agent.alive = false);
    game
}

#[test]
fn an_agent_that_escaped_takes_its_last_step_and_is_counted_no_more() {
    let metrics = escape().metrics();
    let of = |count: fn(&Counts) -> u32| metrics.counts.iter().map(count).collect::<Vec<_>>();
    assert_eq!(of(|counts| counts.alive), [0, 2, 1, 1]);
    assert_eq!(of(|counts| counts.no_actions), [0, 0, 0, 0]);
    assert_eq!(of(|counts| counts.distance), [0, 2, 1, 1]);
    assert_eq!(of(|counts| counts.explored), [2, 3, 3, 3]);
    assert_eq!(of(|counts| counts.kept_pairs), [0, 0, 0, 0]);
    let series = |metric| metrics.series[&(Definition::Paper, metric)].clone();
    assert_eq!(series(Metric::PathLength), [Some(0.0), Some(1.0), Some(1.5), Some(2.0)]);
    assert_eq!(series(Metric::StepLength), [None, Some(1.0), Some(1.0), Some(1.0)]);
}

#[test]
fn the_toolkit_counts_escaped_agents_for_ever() {
    let metrics = escape().metrics();
    let series = |metric| {
        let of = &metrics.series[&(Definition::Toolkit, metric)];
        of.iter().map(|value| value.expect("0 where undefined")).collect::<Vec<_>>()
    };
    assert_eq!(series(Metric::Stillness), [0.0, 0.5, 0.5, 0.0]);
    assert_eq!(series(Metric::Explored), [2.0, 4.0, 4.0, 5.0]);
    assert_eq!(series(Metric::StepLength), [0.0, 1.0, 1.5, 2.0]);
    assert_eq!(series(Metric::DominantAction), [0.5, 0.5, 0.5, 0.0]);
    // The pair is adjacent in the layout, and outside the map at the end, but never in two successive states.
    assert_eq!(series(Metric::KeptPairs), [0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn the_toolkit_keeps_pairs_of_agents_that_left_together() {
    let mut game = Played::at(&[(0, 3), (0, 4)]).then(&[does(Up), does(Up)], &[(-1, 3), (-1, 4)]);
    game.last().agents.iter_mut().for_each(|agent| agent.alive = false);
    let metrics = game.metrics();
    assert_eq!(metrics.series[&(Definition::Toolkit, Metric::KeptPairs)], [Some(0.0), Some(1.0)]);
    assert_eq!(metrics.counts[1].kept_pairs, 0);
}

#[test]
fn a_move_is_blocked_unless_it_gets_its_agent_somewhere_in_its_direction() {
    let game = Played::at(&[(1, 1), (3, 3), (5, 5), (7, 7)]).then(
        &[does(Up), does(Right), does(Left), does(Stay)],
        // The agents: one does not move; one moves and is pushed aside; one is only pushed aside; one is pushed.
        &[(1, 1), (4, 4), (6, 5), (7, 8)],
    );
    assert_eq!(game.metrics().counts[1].blocked, 2);
    assert_eq!(game.value(Metric::BlockedShare), Some(2.0 / 3.0));
}

#[test]
fn cells_outside_the_map_are_not_explored() {
    let mut game = Played::at(&[(0, 0)]).then(&[does(Left)], &[(0, -1)]);
    game.last().agents[0].alive = false;
    assert_eq!(game.last().agents[0].at, Pos::new(0, -1));
    assert_eq!(game.value(Metric::ExploredFinal), Some(1.0));
    assert_eq!(game.toolkit(Metric::Explored), Some(1.0));
}
