//! Transport: push the block out of the gap in the wall, then escape through it.

use super::{Plan, Region, Stage, Terrain, place_wall};
use crate::body::{Board, Body, Kind};
use crate::config::Config;
use crate::grid::BodyId;
use crate::grid::Pos;
use crate::rng::LayoutRng;

/// The mass of the block, whatever its area.
const BLOCK_MASS: i32 = 5;

/// The length of the gap in the ring.
const GAP: i32 = 4;

/// The state of Transport beside the board (rules: *Transport*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Transport {
    pub(crate) block: BodyId,
}

/// One of the eight layouts: the block's shape and the side and end of the ring that are open.
struct Layout {
    /// Rows of the block's bounding box; a space is no part of it.
    shape: &'static [&'static str],
    /// True if the bounding box touches the last row (not the first), and the last column.
    at_last: (bool, bool),
    /// The side of the ring that is open, at the end where the block lies.
    side: Side,
}

enum Side {
    Row,
    Column,
}

/// The layouts in the order of the draw (rules: *Layouts*, Transport).
const LAYOUTS: [Layout; 8] = [
    Layout { shape: &["BBB  ", "BBB  ", "BBB  ", " BBBB"], at_last: (true, true), side: Side::Row },
    Layout {
        shape: &["  BBB", "  BBB", "  BBB", "BBBB "],
        at_last: (true, false),
        side: Side::Row,
    },
    Layout {
        shape: &["   B", "   B", "BBBB", "BBBB", "BBB "],
        at_last: (false, true),
        side: Side::Column,
    },
    Layout {
        shape: &["BBB ", "BBBB", "BBBB", "   B", "   B"],
        at_last: (true, true),
        side: Side::Column,
    },
    Layout {
        shape: &["B   ", "B   ", "BBBB", "BBBB", " BBB"],
        at_last: (false, false),
        side: Side::Column,
    },
    Layout {
        shape: &[" BBB", "BBBB", "BBBB", "B   ", "B   "],
        at_last: (true, false),
        side: Side::Column,
    },
    Layout {
        shape: &["BBBB ", "  BBB", "  BBB", "  BBB"],
        at_last: (false, false),
        side: Side::Row,
    },
    Layout {
        shape: &[" BBBB", "BBB  ", "BBB  ", "BBB  "],
        at_last: (false, true),
        side: Side::Row,
    },
];

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let mut rng = LayoutRng::new(config.seed.get());
    let layout = Layout::draw(&mut rng);
    let (height, width) = (config.height, config.width);
    let (low, right) = layout.at_last;
    let gap = |cell: Pos| match layout.side {
        Side::Row => {
            cell.i == (if low { height - 1 } else { 0 })
                && (if right { cell.j >= width - GAP } else { cell.j < GAP })
        }
        Side::Column => {
            cell.j == (if right { width - 1 } else { 0 })
                && (if low { cell.i >= height - GAP } else { cell.i < GAP })
        }
    };
    place_wall(&mut board, gap, |_| false);
    let (at, cells) = (layout.at(config), layout.cells().collect());
    let block = Body { mass: BLOCK_MASS, ..Body::of_cells(Kind::Block, at, cells, false) };
    let block = board.place(block);
    Plan { board, rng, region: Region::interior(config), task: Terrain::Transport { block } }
}

/// Number of cells of a region that the block takes.
pub(super) fn cells_taken(config: &Config, region: Region) -> i64 {
    let layout = Layout::draw(&mut LayoutRng::new(config.seed.get()));
    let at = layout.at(config);
    layout.cells().map(|cell| i64::from(region.contains(at.plus(cell)))).sum()
}

impl Layout {
    /// The first draw of the task.
    fn draw(rng: &mut LayoutRng) -> &'static Self {
        &LAYOUTS[rng.below(8) as usize]
    }

    /// The top-left cell of the block's bounding box.
    fn at(&self, config: &Config) -> Pos {
        let (rows, columns) = (length(self.shape.len()), length(self.shape[0].len()));
        let (low, right) = self.at_last;
        Pos::new(
            if low { config.height - rows } else { 0 },
            if right { config.width - columns } else { 0 },
        )
    }

    /// The cells of the block, in its bounding box.
    fn cells(&self) -> impl Iterator<Item = Pos> {
        (self.shape.iter().zip(0..))
            .flat_map(|(row, i)| row.bytes().zip(0..).map(move |(of, j)| (of, Pos::new(i, j))))
            .filter(|&(symbol, _)| symbol == b'B')
            .map(|(_, cell)| cell)
    }
}

/// The extent of a shape as a number of cells on the map.
fn length(cells: usize) -> i32 {
    i32::try_from(cells).expect("a shape is small")
}

impl Transport {
    /// Adds the share of the remaining rounds to the score for every agent that left the map in this round.
    #[expect(clippy::unused_self, reason = "every task has the same shape")]
    pub(super) fn update(&self, stage: &Stage<'_>, board: &Board, mut score: f64) -> f64 {
        let limit = stage.config.max_round;
        let agents = board.agents().iter().zip(stage.had_gone);
        let newly = agents.filter(|&(agent, &had_gone)| agent.gone && !had_gone);
        for _ in newly {
            score += f64::from(limit - stage.round) / f64::from(limit);
        }
        score
    }
}
