//! The contact graph: which body would run into which.

use crate::body::Board;
use crate::grid::{BodyId, Direction};

/// The bodies that a pass may move, and which of them points at which.
#[derive(Clone, Debug, Default)]
pub struct Contacts {
    /// The bodies that some push can reach, in the order in which they were found.
    pub bodies: Vec<BodyId>,
    /// `(v, u)`: shifting body `v` by one cell would make it overlap body `u`; both are places in
    /// [`Contacts::bodies`]. Sorted by `v`.
    pub points_at: Vec<(usize, usize)>,
}

/// Finds all contacts that matter in a pass.
///
/// Every mass is positive, so nothing moves that no pushing agent stands behind: it is enough to
/// follow the contacts from the agents that push in `direction`. A fixed body never moves, so what
/// it points at does not matter.
pub(crate) fn find(board: &Board, wishes: &[Option<Direction>], direction: Direction) -> Contacts {
    const UNSEEN: usize = usize::MAX;
    let mut found = Contacts::default();
    let pushing = board.agents().iter().zip(wishes).zip(0..);
    for ((agent, wish), id) in pushing {
        if *wish == Some(direction) && !agent.gone {
            found.bodies.push(BodyId(id));
        }
    }
    if found.bodies.is_empty() {
        return found;
    }
    let mut place = vec![UNSEEN; board.bodies().len()];
    for (index, body) in found.bodies.iter().enumerate() {
        place[body.index()] = index;
    }
    let mut next = 0;
    while let Some(&body) = found.bodies.get(next) {
        let first = found.points_at.len();
        if !board.body(body).fixed {
            for cell in board.body(body).cells() {
                let Some(other) = board.grid().get(cell.toward(direction)) else { continue };
                if other == body {
                    continue;
                }
                if place[other.index()] == UNSEEN {
                    place[other.index()] = found.bodies.len();
                    found.bodies.push(other);
                }
                let edge = (next, place[other.index()]);
                if !found.points_at[first..].contains(&edge) {
                    found.points_at.push(edge);
                }
            }
        }
        next += 1;
    }
    found
}
