//! Foraging: take food at the source, bring it to the nest, around inner walls.

use super::{Plan, Region, Terrain, place_wall};
use crate::body::{Board, Body, Kind};
use crate::config::Config;
use crate::grid::{Direction, Pos};
use crate::rng::LayoutRng;

/// Inner walls lie in every fourth row (or column).
const WALL_SPACING: i32 = 4;

/// What Foraging keeps beside the board.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Foraging {
    /// By agent, whether it carries food.
    pub(crate) carrying: Vec<bool>,
}

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let mut rng = LayoutRng::new(config.seed);
    let (height, width) = (config.height, config.width);
    let mut food = Pos::new(rng.choice([1, height - 3]), 0);
    food.j = rng.choice([1, width - 3]);
    let across = |food: i32, size: i32| if food == 1 { size - 3 } else { 1 };
    let mut nest = Pos::new(across(food.i, height), across(food.j, width));
    let columns = rng.randint(0, 1) == 1;
    // Walls lie along lines (rows, or columns where `columns`), each `length` cells long.
    let (lines, length) = if columns { (width, height) } else { (height, width) };
    let walls = (lines - WALL_SPACING - 1) / WALL_SPACING;
    if walls % 2 == 1 {
        if columns {
            (nest.i, food.i) = (1, 1);
        } else {
            (nest.j, food.j) = (1, 1);
        }
    }
    let is_wall = |cell: Pos| {
        let (line, along) = if columns { (cell.j, cell.i) } else { (cell.i, cell.j) };
        let number = line / WALL_SPACING - 1;
        line % WALL_SPACING == 0
            && (0..walls).contains(&number)
            && (if number % 2 == 0 {
                along <= length - (length + 2) / 3
            } else {
                along >= length / 3
            })
    };
    place_wall(&mut board, |_| false, is_wall);
    board.place(square(Kind::Nest, nest));
    board.place(square(Kind::Food, food));
    Plan { board, rng, region: Region::interior(config), task: Terrain::Foraging }
}

/// A fixed body of 2 × 2 cells.
fn square(kind: Kind, at: Pos) -> Body {
    let cells = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| Pos::new(i, j));
    Body::of_cells(kind, at, cells.to_vec(), true)
}

impl Foraging {
    pub(super) fn new(config: &Config) -> Self {
        Self { carrying: vec![false; config.num_agents.into()] }
    }

    pub(super) fn update(&mut self, board: &Board, mut score: f64) -> f64 {
        for (agent, carrying) in board.agents().iter().zip(&mut self.carrying) {
            let is_beside = |kind| {
                (Direction::ALL.iter())
                    .any(|&side| board.kind_at(agent.at.toward(side)) == Some(kind))
            };
            if !*carrying && is_beside(Kind::Food) {
                *carrying = true;
            } else if *carrying && is_beside(Kind::Nest) {
                *carrying = false;
                score += 1.0;
            }
        }
        score
    }
}
