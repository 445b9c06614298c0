//! Worked examples. The public toolkit computed most of their values.

use swarmbench_analysis::game::Decision;
use swarmbench_analysis::{Definition, Metric};
use swarmbench_engine::Action::{self, Down, Left, Right, Stay, Switch, Up};
use swarmbench_engine::Control;

use crate::played::{Played, does, says};

const ROW: [(i32, i32); 4] = [(1, 1), (1, 4), (1, 7), (5, 5)];

/// A round in which distant agents choose these actions without moving.
fn choices(actions: &[Action]) -> Played {
    let decisions: Vec<Decision> = actions.iter().copied().map(does).collect();
    Played::at(&ROW[..actions.len()]).chose(&decisions)
}

fn messages(texts: &[&str]) -> Played {
    let cells: Vec<_> = (0..10).zip(texts).map(|(i, _)| (i, i)).collect();
    let decisions: Vec<Decision> = texts.iter().map(|text| says(text)).collect();
    Played::at(&cells).chose(&decisions)
}

#[test]
fn the_entropy_is_that_of_chosen_directions() {
    let entropy = |actions: &[Action]| choices(actions).value(Metric::DirectionEntropy);
    assert_eq!(entropy(&[Up, Up]), Some(0.0));
    assert_eq!(entropy(&[Up, Down, Left, Right]), Some(2.0));
    assert_eq!(entropy(&[Stay, Stay]), None);
    assert_eq!(choices(&[Stay, Stay]).toolkit(Metric::DirectionEntropy), Some(0.0));
}

#[test]
fn a_switch_is_not_still_and_not_coordinated() {
    let game = choices(&[Stay, Switch, Switch, Up]);
    assert_eq!(game.value(Metric::Stillness), Some(0.25));
    assert_eq!(game.value(Metric::DominantAction), Some(0.5));
    assert_eq!(game.value(Metric::Polarization), Some(0.5));
}

#[test]
fn the_polarization_is_the_length_of_the_mean_direction() {
    let game = choices(&[Up, Up, Left, Stay]);
    assert_eq!(game.value(Metric::DominantAction), Some(0.5));
    assert_eq!(game.value(Metric::Polarization), Some(0.559_016_994_374_947_5));
}

#[test]
fn lengths_are_in_characters_and_deviations_those_of_a_population() {
    let two = messages(&["a", "abc"]);
    assert_eq!(two.value(Metric::MessageLength), Some(2.0));
    assert_eq!(two.value(Metric::MessageLengthStd), Some(1.0));
    let one = messages(&["abc"]);
    assert_eq!(one.value(Metric::MessageLength), Some(3.0));
    assert_eq!(one.value(Metric::MessageLengthStd), Some(0.0));
    assert_eq!(messages(&["über", "é"]).value(Metric::MessageLength), Some(2.5));
}

#[test]
fn identical_messages_are_homogeneous_but_not_in_the_toolkits_figures() {
    let same = messages(&["hold (3,4)"; 5]);
    assert_eq!(same.value(Metric::Homogeneity), Some(1.0));
    assert_eq!(same.value(Metric::HomogeneityAll), Some(1.0));
    assert_eq!(same.value(Metric::EditConsistency), Some(1.0));
    assert_eq!(same.toolkit(Metric::Homogeneity), Some(0.0));
    let one = messages(&["hold (3,4)"]);
    assert_eq!(one.value(Metric::Homogeneity), None);
    assert_eq!(one.value(Metric::EditConsistency), None);
    assert_eq!(one.toolkit(Metric::Homogeneity), Some(0.0));
}

#[test]
fn repeats_count_in_the_homogeneity_of_all_messages_only() {
    // Texts without letters have one feature each, and these two share no entry.
    let mut texts = vec!["!!!"; 9];
    texts.push("...");
    let game = messages(&texts);
    assert_eq!(game.value(Metric::Homogeneity), Some(0.0));
    let all = game.value(Metric::HomogeneityAll).expect("two messages");
    assert!((all - 36.0 / 45.0).abs() < 1e-12, "{all}");
}

#[test]
fn a_follower_in_a_convoy_pushes_but_not_strictly() {
    let pushes = |second: Action| {
        let game =
            Played::at(&[(1, 1), (1, 2)]).then(&[does(Right), does(second)], &[(1, 2), (1, 3)]);
        (game.value(Metric::Pushes), game.value(Metric::PushesStrict))
    };
    assert_eq!(pushes(Right), (Some(1.0), Some(0.0)));
    assert_eq!(pushes(Stay), (Some(1.0), Some(1.0)));
    assert_eq!(pushes(Left), (Some(1.0), Some(1.0)));
}

#[test]
fn a_train_of_three_has_two_pushes_and_keeps_its_pairs() {
    let train = Played::at(&[(1, 1), (1, 2), (1, 3)])
        .then(&[does(Right), does(Right), does(Right)], &[(1, 2), (1, 3), (1, 4)]);
    assert_eq!(train.value(Metric::Pushes), Some(2.0));
    assert_eq!(train.value(Metric::PushesStrict), Some(0.0));
    assert_eq!(train.value(Metric::KeptPairs), Some(2.0));
    assert_eq!(train.value(Metric::StepLength), Some(1.0));
    assert_eq!(train.value(Metric::Explored), Some(4.0));
    assert_eq!(train.value(Metric::ExploredShare), Some(0.04));
}

#[test]
fn the_imbalance_is_a_gini_coefficient() {
    let imbalance = |counts: [usize; 4]| {
        let actions = [Up, Down, Left, Right].into_iter().zip(counts);
        let actions = actions.flat_map(|(action, count)| vec![action; count]);
        let game = actions.fold(Played::at(&[(5, 5)]), |game, action| game.chose(&[does(action)]));
        game.metrics()
    };
    let of = |counts, metric| imbalance(counts).value(Definition::Paper, metric).value;
    assert_eq!(of([10, 0, 0, 0], Metric::DirectionImbalance), Some(0.75));
    assert_eq!(of([10, 0, 0, 0], Metric::DirectionImbalanceNorm), Some(1.0));
    assert_eq!(of([5, 5, 5, 5], Metric::DirectionImbalance), Some(0.0));
    assert_eq!(of([6, 2, 1, 1], Metric::DirectionImbalance), Some(0.4));
}

#[test]
fn agents_that_move_opposite_ways_are_imbalanced_but_not_pooled() {
    let game = Played::at(&[(1, 1), (5, 5), (8, 8)]).chose(&[does(Up), does(Down), does(Stay)]);
    assert_eq!(game.value(Metric::DirectionImbalance), Some(0.75));
    assert_eq!(game.value(Metric::DirectionImbalancePooled), Some(0.5));
}

#[test]
fn neighbours_are_separated_unless_their_forces_cancel() {
    let pair = Played::at(&[(1, 1), (1, 2)]).chose(&[does(Stay), does(Stay)]);
    assert_eq!(pair.value(Metric::Separation), Some(1.0));
    assert_eq!(pair.value(Metric::Crowding), Some(1.0));
    // In a window of 3 × 3 the ends do not see each other, and the forces on the middle cancel.
    let mut three = Played::at(&[(1, 1), (1, 2), (1, 3)]);
    three.setup.view_size = 3;
    let three = three.chose(&[does(Stay), does(Stay), does(Stay)]);
    assert_eq!(three.value(Metric::Separation), Some(2.0 / 3.0));
    assert_eq!(three.value(Metric::Crowding), Some(4.0 / 3.0));
}

#[test]
fn edit_similarity_is_one_minus_the_distance_over_the_longer_length() {
    let similarity = messages(&["kitten", "sitting"]).value(Metric::EditConsistency);
    let similarity = similarity.expect("two messages");
    assert!((similarity - (1.0 - 3.0 / 7.0)).abs() < 1e-15, "{similarity}");
}

#[test]
fn components_are_those_of_the_graph_of_who_sees_whom() {
    let cells = [(1, 1), (3, 3), (5, 5), (9, 9)];
    let mut game = Played::at(&cells).chose(&vec![Decision::default(); 4]);
    assert_eq!(game.value(Metric::Components), Some(2.0));
    assert_eq!(game.value(Metric::ComponentsNorm), Some(1.0 / 3.0));
    game.setup.control = Control::Centralized;
    assert_eq!(game.value(Metric::Components), Some(1.0));
    assert_eq!(game.value(Metric::ComponentsNorm), Some(0.0));
}

#[test]
fn the_increase_compares_the_last_fifth_with_the_first() {
    // Homogeneity is 0 in the first four rounds, 1 in the last four, and undefined between them.
    let apart = [says("!!!"), says("...")];
    let alike = [says("!!!"), says("!!!")];
    let silent = [does(Stay), does(Stay)];
    let rounds = [&apart, &apart, &apart, &apart, &silent, &silent, &alike, &alike, &alike, &alike];
    let game = rounds.iter().fold(Played::at(&[(1, 1), (5, 5)]), |game, round| game.chose(*round));
    let increase = game.run_value(Metric::HomogeneityIncrease);
    assert_eq!((increase.value, increase.rounds), (Some(1.0), 8));
    // Least squares by hand: Σxy/Σxx = 12/82 for x = 0 … 9 without 4 and 5, times 9 rounds.
    let slope = game.value(Metric::HomogeneitySlope).expect("eight values");
    assert!((slope - 9.0 * 12.0 / 82.0).abs() < 1e-12, "{slope}");
}
