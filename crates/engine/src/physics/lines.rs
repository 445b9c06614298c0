//! The moving bodies of a pass in which no movable body is wider than a cell.
//!
//! A body of one cell touches at most one body before it and is touched by at most one that can move, so contacts form
//! lines, and no force can choose its way. Number a line from its front, and let a body's balance be the force that it
//! adds less its weight. The first k bodies move together exactly if the balances of bodies j to k have no negative sum
//! for any j: that sum is the most that can reach body j − 1. With the sums P of the first balances this says that P(k)
//! is not less than any P before it; and the rules ask for the largest such k.
//!
//! The result is the same set that [`flow`](super::flow) finds, without a graph.

use super::force;
use crate::body::Board;
use crate::grid::{BodyId, Direction};

/// Memory for [`movers`], reused by each pass.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// The last pass that found an agent in a line, by agent.
    seen: Vec<u32>,
    pass: u32,
    line: Vec<BodyId>,
}

impl Scratch {
    fn begin(&mut self, agents: usize) {
        self.pass = self.pass.wrapping_add(1);
        if self.seen.len() != agents || self.pass == 0 {
            self.seen.clear();
            self.seen.resize(agents, 0);
            self.pass = 1;
        }
    }
}

/// Adds to `moving` the bodies that a pass in `direction` moves. Returns false, and leaves `moving` unusable, if a push
/// reaches a wider body that can move.
pub(crate) fn movers(
    board: &Board,
    wishes: &[Option<Direction>],
    direction: Direction,
    scratch: &mut Scratch,
    moving: &mut Vec<BodyId>,
) -> bool {
    scratch.begin(wishes.len());
    for (index, (agent, wish)) in board.agents().iter().zip(wishes).enumerate() {
        if *wish != Some(direction) || agent.gone || scratch.seen[index] == scratch.pass {
            continue;
        }
        let Some(rear) = rear_of(board, agent.at, direction) else { return false };
        scratch.line.clear();
        let mut at = rear;
        let mut blocked = false;
        while let Some(id) = board.grid().get(at) {
            let body = board.body(id);
            if body.fixed {
                blocked = true;
                break;
            }
            if !body.is_single() {
                return false;
            }
            if let Some(seen) = scratch.seen.get_mut(id.index()) {
                *seen = scratch.pass;
            }
            scratch.line.push(id);
            at = at.toward(direction);
        }
        if !blocked {
            scratch.line.reverse();
            let count = moved(board, wishes, direction, &scratch.line);
            moving.extend_from_slice(&scratch.line[..count]);
        }
    }
    true
}

/// The cell of the hindmost body of the line through `at`; `None` if a wider body stands in it.
fn rear_of(
    board: &Board,
    mut at: crate::grid::Pos,
    direction: Direction,
) -> Option<crate::grid::Pos> {
    loop {
        let behind = at.toward(direction.opposite());
        let Some(id) = board.grid().get(behind) else { return Some(at) };
        let body = board.body(id);
        if body.fixed {
            return Some(at);
        }
        if !body.is_single() {
            return None;
        }
        at = behind;
    }
}

/// Number of bodies of a line that move, counted from its front.
fn moved(
    board: &Board,
    wishes: &[Option<Direction>],
    direction: Direction,
    line: &[BodyId],
) -> usize {
    let (mut sum, mut most, mut count) = (0, 0, 0);
    for (&id, place) in line.iter().zip(1..) {
        sum += force(wishes, id, direction) - board.body(id).mass;
        if sum >= most {
            (most, count) = (sum, place);
        }
    }
    count
}
