//! The contact graph: the bodies that each body would run into.

use crate::body::Board;
use crate::grid::{BodyId, Direction};

/// The bodies that a pass may move, and the contacts between them.
#[derive(Clone, Debug, Default)]
pub struct Contacts {
    /// The bodies that some push can reach, in the order of discovery.
    pub bodies: Vec<BodyId>,
    /// `(v, u)`: shifting body `v` by one cell would make it overlap body `u`; both are places in
    /// [`Contacts::bodies`]. Sorted by `v`.
    pub points_at: Vec<(usize, usize)>,
}

/// Marker for a body that was not found yet.
const UNSEEN: usize = usize::MAX;

impl Contacts {
    /// Finds all contacts that matter in a pass. `place` is reused memory.
    ///
    /// Every mass is positive, so nothing moves without a pushing agent behind it: it is enough to follow the contacts
    /// from the agents that push in `direction`. A fixed body never moves, so its contacts do not matter.
    pub(crate) fn find(
        &mut self,
        board: &Board,
        wishes: &[Option<Direction>],
        direction: Direction,
        place: &mut Vec<usize>,
    ) {
        let Self { bodies, points_at } = self;
        bodies.clear();
        points_at.clear();
        let pushing = board.agents().iter().zip(wishes).zip(0..);
        for ((agent, wish), id) in pushing {
            if *wish == Some(direction) && !agent.gone {
                bodies.push(BodyId(id));
            }
        }
        if bodies.is_empty() {
            return;
        }
        place.clear();
        place.resize(board.bodies().len(), UNSEEN);
        for (index, body) in bodies.iter().enumerate() {
            place[body.index()] = index;
        }
        let mut next = 0;
        while let Some(&body) = bodies.get(next) {
            let first = points_at.len();
            if !board.body(body).fixed {
                for cell in board.body(body).cells() {
                    let Some(other) = board.grid().get(cell.toward(direction)) else { continue };
                    if other == body {
                        continue;
                    }
                    if place[other.index()] == UNSEEN {
                        place[other.index()] = bodies.len();
                        bodies.push(other);
                    }
                    let edge = (next, place[other.index()]);
                    if !points_at[first..].contains(&edge) {
                        points_at.push(edge);
                    }
                }
            }
            next += 1;
        }
    }
}
