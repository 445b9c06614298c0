//! The integer linear program that specifies the physics and the flow that computes it agree: on generated contact
//! graphs, where a search through all sets judges both if the graph is small, and on crowded boards. (`vectors.rs`
//! plays the recorded games with both; hand-made situations stand beside the code.)

use proptest::collection::vec;
use proptest::prelude::*;
use swarmbench_engine::physics::components::{Components, Node};
use swarmbench_engine::physics::{Solver, flow, ilp};
use swarmbench_engine::{Scratch, Settings, TaskName};
use swarmbench_testkit::worlds::{Dice, world};

/// A node as it may come from a board: agents that push, rest or push back, blocks, groups.
fn node() -> impl Strategy<Value = Node> {
    prop_oneof![
        6 => Just(Node { force: 2, mass: 1, fixed: false }),
        3 => Just(Node { force: 0, mass: 1, fixed: false }),
        2 => Just(Node { force: 0, mass: 3, fixed: false }),
        3 => (0..9_i32, 1..9_i32).prop_map(|(force, mass)| Node { force, mass, fixed: false }),
        1 => (0..9_i32, 1..20_i32).prop_map(|(force, mass)| Node { force, mass, fixed: true }),
    ]
}

fn graph(nodes: Vec<Node>, mut points_at: Vec<(usize, usize)>) -> Components {
    points_at.sort_unstable();
    points_at.dedup();
    let of_body = (0..nodes.len()).collect();
    Components { nodes, points_at, of_body }
}

/// Each node points at the next.
fn chain(most: usize) -> impl Strategy<Value = Components> {
    vec(node(), 1..=most).prop_map(|nodes| {
        let edges = (1..nodes.len()).map(|end| (end - 1, end)).collect();
        graph(nodes, edges)
    })
}

/// Each node but the first points at one before it, or is pointed at by it.
fn tree(most: usize) -> impl Strategy<Value = Components> {
    let link = (any::<prop::sample::Index>(), any::<bool>());
    (vec(node(), 1..=most), vec(link, most)).prop_map(|(nodes, links)| {
        let edges = (1..nodes.len())
            .zip(links)
            .map(|(node, (other, forward))| {
                let other = other.index(node);
                if forward { (node, other) } else { (other, node) }
            })
            .collect();
        graph(nodes, edges)
    })
}

/// Any contacts that form no ring.
fn acyclic(most: usize) -> impl Strategy<Value = Components> {
    let end = any::<prop::sample::Index>;
    (vec(node(), 1..=most), vec((end(), end()), 0..2 * most)).prop_map(|(nodes, ends)| {
        let edges = (ends.iter())
            .map(|(a, b)| (a.index(nodes.len()), b.index(nodes.len())))
            .filter(|(a, b)| a != b)
            .map(|(a, b)| (a.min(b), a.max(b)))
            .collect();
        graph(nodes, edges)
    })
}

/// The largest set that can move, by trying all sets.
///
/// A set that moves holds all nodes that its nodes point at. Its force can be routed exactly if no part of it is short:
/// a part that nothing else in the set points at has only its own force.
fn search(components: &Components) -> Vec<bool> {
    let count = components.nodes.len();
    let holds = |set: u32, node: usize| set >> node & 1 == 1;
    let closed =
        |set: u32| components.points_at.iter().all(|e| !holds(set, e.0) || holds(set, e.1));
    let loose = |set: u32| (0..count).all(|n| !holds(set, n) || !components.nodes[n].fixed);
    let spare = |set: u32| -> i32 {
        (0..count).filter(|&n| holds(set, n)).map(|n| components.nodes[n].balance()).sum()
    };
    let is_fed = |set: u32| {
        (0..=set).filter(|part| part & set == *part).all(|part| {
            let fed_from_outside = (components.points_at.iter())
                .any(|e| holds(part, e.1) && holds(set, e.0) && !holds(part, e.0));
            fed_from_outside || spare(part) >= 0
        })
    };
    let sets = (0..1_u32 << count).filter(|&set| closed(set) && loose(set) && is_fed(set));
    let best = sets.max_by_key(|set| set.count_ones()).expect("nobody moving is a set");
    (0..count).map(|node| holds(best, node)).collect()
}

/// A failure prints the smallest graph that shows it.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(cases) }
}

proptest! {
    #![proptest_config(cases(9_000))]

    #[test]
    fn solvers_agree_with_a_search_through_all_sets(
        graph in prop_oneof![chain(7), tree(7), acyclic(7)]
    ) {
        let expected = search(&graph);
        prop_assert_eq!(&flow::movers(&graph), &expected, "the flow");
        prop_assert_eq!(ilp::movers(&graph), Ok(expected), "the program");
    }
}

proptest! {
    #![proptest_config(cases(2_500))]

    #[test]
    fn solvers_agree_on_larger_graphs(
        graph in prop_oneof![chain(40), tree(24), acyclic(16)]
    ) {
        prop_assert_eq!(Ok(flow::movers(&graph)), ilp::movers(&graph));
    }
}

#[test]
fn a_long_chain_moves_exactly_if_its_force_suffices() {
    for pushers in 1..=300 {
        for (resting, moves) in [(pushers, true), (pushers + 1, false)] {
            let mut nodes = vec![Node { force: 2, mass: 1, fixed: false }; pushers];
            nodes.extend(vec![Node { force: 0, mass: 1, fixed: false }; resting]);
            let edges = (1..nodes.len()).map(|end| (end - 1, end)).collect();
            let moved = flow::movers(&graph(nodes, edges));
            assert!(moved.iter().all(|&one| one == moves), "{pushers} pushers, {resting} resting");
        }
    }
}

/// Random play on maps so full that blocks are pushed from all sides, with agents in their notches.
#[test]
fn solvers_agree_on_crowded_boards() {
    let boards = [(8, 8, 12), (8, 8, 24), (10, 10, 30), (10, 10, 45), (9, 14, 50)];
    for (height, width, num_agents) in boards {
        for seed in 0..8 {
            let settings = Settings {
                height,
                width,
                num_agents,
                max_round: 25,
                memory: 0,
                ..Settings::standard(TaskName::Transport, seed)
            };
            let mut by_flow = world(&settings);
            let mut by_program = by_flow.clone();
            let mut dice = Dice(seed);
            while !by_flow.is_over() {
                let acts = dice.acts(&by_flow);
                let title = format!("{settings:?}, round {}", by_flow.round());
                by_flow
                    .step_with(&acts, Solver::Flow, &mut Scratch::default())
                    .expect("the flow cannot fail");
                by_program.step_with(&acts, Solver::Ilp, &mut Scratch::default()).expect(&title);
                assert!(by_flow == by_program, "{title}: {:?}", by_flow.spectator_view().grid);
            }
        }
    }
}
