//! Transport: pushes of the block.

use swarmbench_engine::{Direction, Pos};

use super::cells::Cells;
use super::counts::{place, real};
use crate::game::{Decision, Setup, State};

/// Measures of one round's pushes; undefined without a block on the map.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pushed {
    pub(super) alignment: Option<f64>,
    pub(super) force: Option<f64>,
}

impl Pushed {
    /// Measures decisions in the state in which they were made.
    pub(super) fn of(setup: &Setup, state: &State, decisions: &[Decision]) -> Self {
        if !state.block.iter().any(|&cell| setup.contains(cell)) {
            return Self::default();
        }
        let cells = Cells::of_living(state);
        let mut touching = Vec::new();
        let mut forces = [0_u32; 4];
        for &cell in &state.block {
            for direction in Direction::ALL {
                let behind = cell.toward(direction.opposite());
                touching.extend(cells.at(behind));
                forces[place(direction)] += pushers(&cells, decisions, behind, direction);
            }
        }
        touching.sort_unstable();
        touching.dedup();
        Self {
            alignment: alignment(&touching, decisions),
            force: forces.into_iter().max().map(f64::from),
        }
    }
}

/// The number of agents in a line behind each other, beginning at `first`, that all chose one direction.
fn pushers(cells: &Cells, decisions: &[Decision], first: Pos, direction: Direction) -> u32 {
    let line = std::iter::successors(Some(first), |cell| Some(cell.toward(direction.opposite())));
    let pushes =
        |cell: &Pos| cells.at(*cell).any(|agent| decisions[agent].direction() == Some(direction));
    line.take_while(pushes).map(|_| 1).sum()
}

/// The length of the sum of directions, divided by the number of agents.
fn alignment(touching: &[usize], decisions: &[Decision]) -> Option<f64> {
    let directions = touching.iter().filter_map(|&agent| decisions[agent].direction());
    let sum =
        directions.map(Direction::offset).fold((0, 0), |sum, by| (sum.0 + by.0, sum.1 + by.1));
    let (down, across) = (f64::from(sum.0), f64::from(sum.1));
    let count = real(touching.len() as u64);
    (count > 0.0).then(|| (down * down + across * across).sqrt() / count)
}
