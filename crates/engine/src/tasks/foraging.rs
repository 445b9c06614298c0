//! Foraging: take food at the source, bring it to the nest, around inner walls.

use super::{Plan, Region, Terrain, place_wall};
use crate::body::{Board, Body, Kind};
use crate::config::Config;
use crate::grid::{Direction, Pos};
use crate::rng::LayoutRng;

/// Inner walls lie in every fourth row (or column).
const WALL_SPACING: i32 = 4;

/// The state of Foraging beside the board (rules: *Foraging*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Foraging {
    /// Agents that carry food, by agent.
    pub(crate) carrying: Vec<bool>,
}

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let mut rng = LayoutRng::new(config.seed.get());
    let ground = Ground::draw(config, &mut rng);
    place_wall(&mut board, |_| false, |cell| ground.is_wall(cell));
    board.place(square(Kind::Nest, ground.nest));
    board.place(square(Kind::Food, ground.food));
    Plan { board, rng, region: Region::interior(config), task: Terrain::Foraging }
}

/// Number of cells inside the wall ring that the source, the nest and inner walls take.
pub(super) fn cells_taken(config: &Config) -> i64 {
    let ground = Ground::draw(config, &mut LayoutRng::new(config.seed.get()));
    let walls = (0..ground.walls).map(|number| {
        let (first, last) = ground.reach(number);
        i64::from(last.min(ground.length - 2) - first.max(1) + 1)
    });
    2 * SQUARE_CELLS + walls.sum::<i64>()
}

/// The drawn parts of a map. Source, nest and inner walls do not touch each other.
struct Ground {
    food: Pos,
    nest: Pos,
    /// True if the inner walls lie in columns rather than in rows.
    columns: bool,
    /// Number of inner walls.
    walls: i32,
    /// Number of cells of a line of an inner wall (a row, or a column).
    length: i32,
}

impl Ground {
    fn draw(config: &Config, rng: &mut LayoutRng) -> Self {
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
        Self { food, nest, columns, walls, length }
    }

    /// The first and the last cell of an inner wall in its line, both included.
    const fn reach(&self, number: i32) -> (i32, i32) {
        if number % 2 == 0 {
            (0, self.length - (self.length + 2) / 3)
        } else {
            (self.length / 3, self.length - 1)
        }
    }

    fn is_wall(&self, cell: Pos) -> bool {
        let (line, along) = if self.columns { (cell.j, cell.i) } else { (cell.i, cell.j) };
        let number = line / WALL_SPACING - 1;
        let (first, last) = self.reach(number);
        line % WALL_SPACING == 0
            && (0..self.walls).contains(&number)
            && (first..=last).contains(&along)
    }
}

/// Number of cells of the source, and of the nest.
const SQUARE_CELLS: i64 = 4;

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
