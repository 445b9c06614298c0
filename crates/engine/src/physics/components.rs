//! Bodies that point at each other in a ring can only move together: the strongly connected
//! components of the contact graph become the nodes of an acyclic one.

use petgraph::algo::TarjanScc;
use petgraph::graph::{DiGraph, NodeIndex};

use super::{contact::Contacts, force};
use crate::body::Board;
use crate::grid::Direction;

/// The condensed contact graph: the input of both solvers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Components {
    /// The nodes, in no promised order.
    pub nodes: Vec<Node>,
    /// `(v, u)`: node `v` points at node `u`; never a node at itself, and never in a ring.
    pub points_at: Vec<(usize, usize)>,
    /// The node of every body of the contact graph.
    pub of_body: Vec<usize>,
}

/// Bodies that move together or not at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Node {
    /// The force of its agents in the direction of the pass; never negative.
    pub force: i32,
    /// The weight: masses, and the pushes against the pass.
    pub mass: i32,
    /// True if one of its bodies cannot move.
    pub fixed: bool,
}

impl Node {
    /// The force that it can pass on (positive) or needs from others (negative) in order to move.
    #[must_use]
    pub const fn balance(self) -> i32 {
        self.force - self.mass
    }
}

/// Memory for [`Components::condense`], reused by each pass.
#[derive(Default)]
pub(crate) struct Scratch {
    graph: DiGraph<(), (), usize>,
    search: TarjanScc<NodeIndex<usize>>,
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

impl Components {
    /// Sums up bodies to nodes (rules: *Physics*, steps 3 and 4).
    pub(crate) fn condense(
        &mut self,
        board: &Board,
        wishes: &[Option<Direction>],
        direction: Direction,
        contacts: &Contacts,
        scratch: &mut Scratch,
    ) {
        let count = contacts.bodies.len();
        let Self { nodes, points_at, of_body } = self;
        let components = strongly_connected(count, &contacts.points_at, of_body, scratch);
        nodes.clear();
        nodes.resize(components, Node::default());
        for (&body, &node) in contacts.bodies.iter().zip(&*of_body) {
            let node = &mut nodes[node];
            node.force += force(wishes, body, direction);
            node.mass += board.body(body).mass;
            node.fixed |= board.body(body).fixed;
        }
        for node in nodes {
            if node.force < 0 {
                node.mass -= node.force;
                node.force = 0;
            }
        }
        points_at.clear();
        for &(v, u) in &contacts.points_at {
            let edge = (of_body[v], of_body[u]);
            if edge.0 != edge.1 {
                points_at.push(edge);
            }
        }
    }
}

/// Finds the component of every vertex; returns the number of components.
fn strongly_connected(
    count: usize,
    edges: &[(usize, usize)],
    of_vertex: &mut Vec<usize>,
    scratch: &mut Scratch,
) -> usize {
    let Scratch { graph, search } = scratch;
    graph.clear();
    for _ in 0..count {
        graph.add_node(());
    }
    graph.extend_with_edges(edges);
    of_vertex.clear();
    of_vertex.resize(count, 0);
    let mut components = 0;
    search.run(&*graph, |members| {
        for member in members {
            of_vertex[member.index()] = components;
        }
        components += 1;
    });
    components
}
