//! The moving nodes, found by an exact maximum flow.
//!
//! A node with more force than mass has a *surplus*, one with less a *deficit*; force travels along contacts. The
//! largest set that can move is found by dropping two kinds of nodes:
//!
//! 1. nodes that are fixed, or point (through others) at a fixed one; they are dropped first, as they pass no force on;
//! 2. nodes from which, once as much force as possible has been routed, an unmet deficit can still be reached in the
//!    residual graph.
//!
//! One maximum flow is enough. Let X be the nodes of the second kind. Whatever points at X is in X, so no node outside
//! sends force into X; no node of X has surplus left, and none sends force out of X (the receiver could give it back,
//! so it would be in X too). A set that moves and shares nodes with X would have to feed its part of X from that part
//! alone, which the flow shows to be impossible. Outside X every deficit is met, so all of it moves, with the flow as
//! it stands.

use super::components::Components;

/// The largest set of nodes that can move: true for each node that moves.
#[must_use]
pub fn movers(components: &Components) -> Vec<bool> {
    let mut routing = Routing::default();
    routing.find(components);
    routing.dropped.iter().map(|dropped| !dropped).collect()
}

/// The search for the flow, with memory that the next one reuses.
#[derive(Debug, Default)]
pub(crate) struct Routing {
    edges: Vec<(usize, usize)>,
    /// Force that travels along each edge.
    flow: Vec<i32>,
    /// Edges by the node at which they end, and by the node from which they start.
    into: Incidence,
    out_of: Incidence,
    /// The remaining surplus (positive) or deficit (negative) of each node.
    balance: Vec<i32>,
    dropped: Vec<bool>,
    /// The last search that visited each node, and the edge by which force would leave it.
    seen_by: Vec<usize>,
    leaves_by: Vec<usize>,
    searches: usize,
    queue: Vec<usize>,
}

impl Routing {
    /// Finds the largest set of nodes that can move.
    pub(crate) fn find(&mut self, components: &Components) {
        self.begin(components);
        let fixed = (0..components.nodes.len()).filter(|&node| components.nodes[node].fixed);
        for node in fixed {
            self.drop_all_behind(node);
        }
        for node in 0..components.nodes.len() {
            while !self.dropped[node] && self.balance[node] < 0 {
                self.feed(node);
            }
        }
    }

    /// True if a node moves, by the last call of [`Routing::find`].
    pub(crate) fn moves(&self, node: usize) -> bool {
        !self.dropped[node]
    }

    fn begin(&mut self, components: &Components) {
        fn fill<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
            values.clear();
            values.resize(count, value);
        }
        let count = components.nodes.len();
        self.edges.clone_from(&components.points_at);
        fill(&mut self.flow, self.edges.len(), 0);
        self.into.group(count, self.edges.iter().map(|edge| edge.1));
        self.out_of.group(count, self.edges.iter().map(|edge| edge.0));
        self.balance.clear();
        self.balance.extend(components.nodes.iter().map(|node| node.balance()));
        fill(&mut self.dropped, count, false);
        fill(&mut self.seen_by, count, 0);
        fill(&mut self.leaves_by, count, 0);
        self.searches = 0;
    }

    /// Drops a node and everything that points at it through others.
    fn drop_all_behind(&mut self, node: usize) {
        if self.dropped[node] {
            return;
        }
        self.dropped[node] = true;
        self.queue.clear();
        self.queue.push(node);
        while let Some(node) = self.queue.pop() {
            for place in self.into.places(node) {
                let behind = self.edges[self.into.edges[place]].0;
                if !self.dropped[behind] {
                    self.dropped[behind] = true;
                    self.queue.push(behind);
                }
            }
        }
    }

    /// Routes force to a node in deficit from the nearest surplus. If none can reach it, drops the node with all nodes
    /// that could send it force: no later routing can touch these, as none of them has surplus and nothing outside
    /// points at them.
    fn feed(&mut self, sink: usize) {
        self.searches += 1;
        self.queue.clear();
        self.queue.push(sink);
        self.seen_by[sink] = self.searches;
        let mut next = 0;
        while let Some(&node) = self.queue.get(next) {
            next += 1;
            if self.balance[node] > 0 {
                self.augment(node, sink);
                return;
            }
            for place in self.into.places(node) {
                let edge = self.into.edges[place];
                self.visit(self.edges[edge].0, edge);
            }
            for place in self.out_of.places(node) {
                let edge = self.out_of.edges[place];
                if self.flow[edge] > 0 {
                    self.visit(self.edges[edge].1, edge);
                }
            }
        }
        for &node in &self.queue {
            self.dropped[node] = true;
        }
    }

    /// Records that force at `node` could continue along `edge`, unless this search was here before or the node was
    /// dropped: a node that does not move passes no force on.
    fn visit(&mut self, node: usize, edge: usize) {
        if !self.dropped[node] && self.seen_by[node] != self.searches {
            self.seen_by[node] = self.searches;
            self.leaves_by[node] = edge;
            self.queue.push(node);
        }
    }

    /// Moves as much force as the path found by [`Routing::feed`] carries.
    fn augment(&mut self, source: usize, sink: usize) {
        let mut amount = self.balance[source].min(-self.balance[sink]);
        let mut node = source;
        while node != sink {
            let edge = self.leaves_by[node];
            node = if self.edges[edge].0 == node {
                self.edges[edge].1
            } else {
                amount = amount.min(self.flow[edge]);
                self.edges[edge].0
            };
        }
        self.balance[source] -= amount;
        self.balance[sink] += amount;
        let mut node = source;
        while node != sink {
            let edge = self.leaves_by[node];
            node = if self.edges[edge].0 == node {
                self.flow[edge] += amount;
                self.edges[edge].1
            } else {
                self.flow[edge] -= amount;
                self.edges[edge].0
            };
        }
    }
}

/// Edges grouped by one of their ends.
#[derive(Debug, Default)]
struct Incidence {
    starts: Vec<usize>,
    edges: Vec<usize>,
    free: Vec<usize>,
}

impl Incidence {
    fn group(&mut self, nodes: usize, ends: impl Iterator<Item = usize> + Clone) {
        let Self { starts, edges, free } = self;
        starts.clear();
        starts.resize(nodes + 1, 0);
        let mut count = 0;
        for end in ends.clone() {
            starts[end + 1] += 1;
            count += 1;
        }
        for node in 0..nodes {
            starts[node + 1] += starts[node];
        }
        free.clone_from(starts);
        edges.clear();
        edges.resize(count, 0);
        for (edge, end) in ends.enumerate() {
            edges[free[end]] = edge;
            free[end] += 1;
        }
    }

    /// The range of a node's edges in [`Incidence::edges`].
    fn places(&self, node: usize) -> std::ops::Range<usize> {
        self.starts[node]..self.starts[node + 1]
    }
}
