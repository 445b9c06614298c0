//! Physics: which bodies move when agents push (rules: *Physics, one pass in direction d*).
//!
//! A round has one pass for each direction. A pass has four steps, the first three one file each: the bodies that touch
//! ([`contact`]), the groups that can only move together ([`components`]), and the groups that do move, found by the
//! exact flow ([`flow`]) or by the integer linear program that specifies it ([`ilp`]). Tests show that the two agree;
//! the flow is the default because it is faster. A pass that pushes no wide body needs neither: its contacts are lines
//! (`lines.rs`).

pub mod components;
pub mod contact;
pub mod flow;
pub mod ilp;
mod lines;

use crate::body::Board;
use crate::grid::{BodyId, Direction};
use components::Components;
use contact::Contacts;

/// The method that finds the moving bodies of a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// A maximum flow: exact and fast. Contacts that are only lines need none.
    #[default]
    Flow,
    /// The integer linear program of the paper: the specification, slower.
    Ilp,
    /// Both; a difference between them is an error.
    Both,
}

/// The moving bodies were not found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SolverError {
    /// The program was not solved.
    #[error(transparent)]
    Ilp(#[from] ilp::IlpError),
    /// The flow and the program disagree: one of them is wrong.
    #[error("the flow and the integer linear program disagree on who moves: {0:?}")]
    Disagree(Box<Components>),
}

impl Solver {
    /// The nodes that move: the largest set that the rules allow, which is unique.
    ///
    /// # Errors
    /// The ILP fails if its solver does not prove an optimum, both together if they disagree; the flow alone cannot
    /// fail.
    pub fn movers(self, components: &Components) -> Result<Vec<bool>, SolverError> {
        match self {
            Self::Flow => Ok(flow::movers(components)),
            Self::Ilp => Ok(ilp::movers(components)?),
            Self::Both => {
                let moves = flow::movers(components);
                if ilp::movers(components)? == moves {
                    Ok(moves)
                } else {
                    Err(SolverError::Disagree(Box::new(components.clone())))
                }
            }
        }
    }
}

/// Memory that [`resolve`] reuses in each round.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    lines: lines::Scratch,
    moving: Vec<BodyId>,
    graphs: Graphs,
}

/// Memory for contacts that are more than lines.
#[derive(Debug, Default)]
struct Graphs {
    place: Vec<usize>,
    contacts: Contacts,
    components: Components,
    connected: components::Scratch,
    routing: flow::Routing,
}

/// Resolves one round of pushes on the board: `wishes[n]` is the direction in which agent `n`
/// tries to move.
///
/// # Errors
/// See [`Solver::movers`]. After an error the board is between two passes and unusable.
pub(crate) fn resolve(
    board: &mut Board,
    wishes: &[Option<Direction>],
    solver: Solver,
    scratch: &mut Scratch,
) -> Result<(), SolverError> {
    for direction in Direction::ALL {
        if !wishes.contains(&Some(direction)) {
            continue;
        }
        let Scratch { lines, moving, graphs } = scratch;
        moving.clear();
        let found =
            solver == Solver::Flow && lines::movers(board, wishes, direction, lines, moving);
        if !found {
            moving.clear();
            search(board, wishes, direction, solver, graphs, moving)?;
        }
        board.shift(moving, direction);
    }
    Ok(())
}

/// Adds to `moving` the bodies that a pass in `direction` moves, whatever their shapes.
fn search(
    board: &Board,
    wishes: &[Option<Direction>],
    direction: Direction,
    solver: Solver,
    graphs: &mut Graphs,
    moving: &mut Vec<BodyId>,
) -> Result<(), SolverError> {
    let Graphs { place, contacts, components, connected, routing } = graphs;
    contacts.find(board, wishes, direction, place);
    if contacts.bodies.is_empty() {
        return Ok(());
    }
    components.condense(board, wishes, direction, contacts, connected);
    let bodies = contacts.bodies.iter().zip(&components.of_body);
    if solver == Solver::Flow {
        routing.find(components);
        moving.extend(bodies.filter(|&(_, &node)| routing.moves(node)).map(|(&body, _)| body));
    } else {
        let moves = solver.movers(components)?;
        moving.extend(bodies.filter(|&(_, &node)| moves[node]).map(|(&body, _)| body));
    }
    Ok(())
}

/// The force with which a body pushes in `direction`: 2 for an agent that pushes this way, −2 for one that pushes
/// against it.
fn force(wishes: &[Option<Direction>], body: BodyId, direction: Direction) -> i32 {
    match wishes.get(body.index()).copied().flatten() {
        Some(wish) if wish == direction => 2,
        Some(wish) if wish == direction.opposite() => -2,
        Some(_) | None => 0,
    }
}

#[cfg(test)]
mod tests;
