//! Physics: which bodies move when agents push (rules: *Physics, one pass in direction d*).
//!
//! A round has one pass for each direction. A pass is four steps, one file each: which bodies touch
//! ([`contact`]), which of them can only move together ([`components`]), and which of those do
//! move, found by the exact flow ([`flow`]) or by the integer linear program that specifies it
//! ([`ilp`]). The two are proven equal by tests; the flow is the default because it is faster.
//! Mostly it has nothing to decide: where no wide body is pushed, contacts are lines (`lines.rs`).

pub mod components;
pub mod contact;
pub mod flow;
pub mod ilp;
mod lines;

use crate::body::Board;
use crate::grid::{BodyId, Direction};
use components::Components;
use contact::Contacts;

/// How the moving bodies of a pass are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    /// By a maximum flow: exact and fast. Contacts that are only lines need none.
    #[default]
    Flow,
    /// By the integer linear program of the paper: the specification, slower.
    Ilp,
    /// By both, and it is an error where they differ.
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
    /// Which nodes move: the largest set that the rules allow, which is unique.
    ///
    /// # Errors
    /// The ILP fails where its solver does not prove an optimum, both together where they disagree;
    /// the flow alone cannot fail.
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

/// Memory that [`resolve`] uses again in each round.
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
/// See [`Solver::movers`]. After an error the board is between two passes and of no further use.
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

/// The force with which a body pushes in `direction`: an agent's 2, for or against.
fn force(wishes: &[Option<Direction>], body: BodyId, direction: Direction) -> i32 {
    match wishes.get(body.index()).copied().flatten() {
        Some(wish) if wish == direction => 2,
        Some(wish) if wish == direction.opposite() => -2,
        Some(_) | None => 0,
    }
}

#[cfg(test)]
mod tests;
