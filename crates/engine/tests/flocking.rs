//! The cost of a flock is exact: it equals the result of a search through all translations.

use proptest::collection::vec;
use proptest::prelude::*;
use swarmbench_engine::tasks::flocking::{distance, target};
use swarmbench_engine::{Pos, Settings, TaskName};
use swarmbench_testkit::worlds::{Dice, world};

/// The least cost over all translations, each by `assignment`.
fn search(agents: &[Pos], target: &[Pos], assignment: fn(&[Vec<i32>]) -> i32) -> i32 {
    let (few, many) = if agents.len() < target.len() { (agents, target) } else { (target, agents) };
    let mut translations: Vec<(i32, i32)> =
        few.iter().flat_map(|a| many.iter().map(|b| (b.i - a.i, b.j - a.j))).collect();
    translations.sort_unstable();
    translations.dedup();
    let costs = translations.iter().map(|(i, j)| {
        let apart = |a: &Pos, b: &Pos| (a.i + i - b.i).abs() + (a.j + j - b.j).abs();
        let rows: Vec<Vec<i32>> =
            few.iter().map(|a| many.iter().map(|b| apart(a, b)).collect()).collect();
        assignment(&rows)
    });
    costs.min().expect("nothing is empty")
}

/// The best assignment of all rows, by trying all sets of columns.
fn by_subsets(costs: &[Vec<i32>]) -> i32 {
    let columns = costs[0].len();
    let mut best = vec![i32::MAX; 1 << columns];
    best[0] = 0;
    for set in 0..best.len() {
        let row = usize::try_from(set.count_ones()).expect("few");
        if row == costs.len() || best[set] == i32::MAX {
            continue;
        }
        for column in (0..columns).filter(|column| set >> column & 1 == 0) {
            let with = set | 1 << column;
            best[with] = best[with].min(best[set] + costs[row][column]);
        }
    }
    let full = |set: &usize| set.count_ones() as usize == costs.len();
    (0..best.len()).filter(full).map(|set| best[set]).min().expect("as many columns as rows")
}

/// The best assignment of all rows, by the plain Hungarian method.
fn by_potentials(costs: &[Vec<i32>]) -> i32 {
    let (rows, columns) = (costs.len(), costs[0].len());
    // Row and column 0 stand for "none".
    let (mut u, mut v) = (vec![0; rows + 1], vec![0; columns + 1]);
    let mut row_of = vec![0; columns + 1];
    for row in 1..=rows {
        let mut slack = vec![i32::MAX; columns + 1];
        let mut way = vec![0; columns + 1];
        let mut used = vec![false; columns + 1];
        let mut at = 0;
        row_of[0] = row;
        while row_of[at] != 0 {
            used[at] = true;
            let (mut least, mut next) = (i32::MAX, 0);
            for column in (1..=columns).filter(|&column| !used[column]) {
                let reduced = costs[row_of[at] - 1][column - 1] - u[row_of[at]] - v[column];
                if reduced < slack[column] {
                    (slack[column], way[column]) = (reduced, at);
                }
                if slack[column] < least {
                    (least, next) = (slack[column], column);
                }
            }
            for column in 0..=columns {
                if used[column] {
                    u[row_of[column]] += least;
                    v[column] -= least;
                } else if slack[column] < i32::MAX {
                    slack[column] -= least;
                }
            }
            at = next;
        }
        while at != 0 {
            row_of[at] = row_of[way[at]];
            at = way[at];
        }
    }
    (1..=columns).filter(|&c| row_of[c] != 0).map(|c| costs[row_of[c] - 1][c - 1]).sum()
}

/// Different cells on a map of this size.
fn cells(count: std::ops::Range<usize>, size: i32) -> impl Strategy<Value = Vec<Pos>> {
    vec((0..size, 0..size), count).prop_map(|cells| {
        let mut cells: Vec<Pos> = cells.into_iter().map(|(i, j)| Pos::new(i, j)).collect();
        cells.sort_unstable();
        cells.dedup();
        cells
    })
}

/// Two crowds in opposite corners: rows, columns and diagonals contradict each other.
fn crowds(count: usize, size: i32) -> impl Strategy<Value = Vec<Pos>> {
    (cells(1..count, size / 3), cells(1..count, size / 3)).prop_map(move |(mut one, other)| {
        one.extend(other.into_iter().map(|at| Pos::new(size - at.i, size - at.j)));
        one
    })
}

fn outline(agents: &[Pos]) -> Vec<Pos> {
    target(u16::try_from(agents.len()).expect("few"))
}

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases) }
}

proptest! {
    #![proptest_config(config(1_500))]

    #[test]
    fn small_flocks_cost_what_a_search_finds(
        agents in prop_oneof![cells(1..10, 8), cells(1..10, 30), crowds(5, 12)]
    ) {
        let target = outline(&agents);
        prop_assert_eq!(distance(&agents, &target), search(&agents, &target, by_subsets));
    }

    #[test]
    fn any_two_sets_of_cells_can_be_compared(a in cells(1..9, 12), b in cells(1..9, 12)) {
        let expected = search(&a, &b, by_subsets);
        prop_assert_eq!(distance(&a, &b), expected);
        prop_assert_eq!(distance(&b, &a), expected);
    }
}

proptest! {
    #![proptest_config(config(40))]

    #[test]
    fn flocks_cost_what_a_search_finds(
        agents in prop_oneof![cells(10..26, 12), cells(10..26, 20), crowds(14, 20)]
    ) {
        let target = outline(&agents);
        prop_assert_eq!(distance(&agents, &target), search(&agents, &target, by_potentials));
    }
}

#[test]
fn both_assignments_of_this_test_agree() {
    let costs = [vec![4, 1, 3, 2], vec![2, 0, 5, 3], vec![3, 2, 2, 1]];
    assert_eq!((by_subsets(&costs), by_potentials(&costs)), (4, 4));
}

#[test]
fn a_formed_target_costs_nothing_and_a_step_away_from_it_one() {
    for agents in [12, 30, 100, 255, 256] {
        let target = target(agents);
        let mut placed: Vec<Pos> = target.iter().map(|at| at.plus(Pos::new(17, 3))).collect();
        for steps in 0..4 {
            assert_eq!(distance(&placed, &target), steps);
            let corner = placed.pop().expect("not empty");
            placed.push(corner.plus(Pos::new(1, 0)));
        }
    }
}

/// A round that starts from the result of the one before finds the same cost as a search from scratch.
#[test]
fn the_cost_of_a_round_is_that_of_its_placement() {
    for (num_agents, size, rounds) in [(12, 10, 600), (13, 9, 300), (3, 8, 100), (31, 14, 100)] {
        for seed in 0..4 {
            let mut world = world(&Settings {
                num_agents,
                width: size,
                height: size,
                max_round: rounds,
                ..Settings::standard(TaskName::Flocking, seed)
            });
            let target = target(u16::try_from(num_agents).expect("few"));
            let mut dice = Dice(seed);
            while !world.is_over() {
                let acts = dice.acts(&world);
                world.step(&acts);
                let agents: Vec<Pos> = world.agent_states().map(|agent| agent.at).collect();
                let expected = f64::from(distance(&agents, &target)) / 2.0;
                let found = world.landmarks().distance;
                assert_eq!(found, Some(expected), "{num_agents} agents, seed {seed}, {agents:?}");
            }
        }
    }
}
