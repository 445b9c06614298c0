//! Cells as small numbers, and the parts of a shape that stay the same from search to search.

use crate::grid::Pos;

/// Maximum spread of cells in rows or columns: sums of distances and prices then fit 16 bits.
const SPREAD_MAX: i32 = 512;

/// A translation, or a cell: rows and columns.
pub(super) type Step = (i16, i16);

/// Cells relative to the top-left corner of their bounding rectangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Cells {
    pub(super) corner: (i32, i32),
    pub(super) all: Vec<Step>,
    /// The last row and the last column.
    pub(super) last: Step,
}

impl Cells {
    pub(super) fn set(&mut self, cells: &[Pos]) {
        let first = |corner: (i32, i32), cell: &Pos| (corner.0.min(cell.i), corner.1.min(cell.j));
        self.corner = cells.iter().fold((i32::MAX, i32::MAX), first);
        let from = |at: i32, first: i32| {
            let apart = at - first;
            assert!(apart < SPREAD_MAX, "cells of a flock lie less than {SPREAD_MAX} apart");
            i16::try_from(apart).expect("a small number")
        };
        self.all.clear();
        for cell in cells {
            self.all.push((from(cell.i, self.corner.0), from(cell.j, self.corner.1)));
        }
        let last = |last: Step, cell: &Step| (last.0.max(cell.0), last.1.max(cell.1));
        self.last = self.all.iter().fold((0, 0), last);
    }
}

/// Adjacent cells in a row, or in a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CellRun {
    pub(super) first: Step,
    pub(super) length: i16,
    pub(super) is_column: bool,
}

/// The cells that a translation moves together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    pub(super) cells: Cells,
    /// The same cells as few runs.
    pub(super) runs: Vec<CellRun>,
    /// The coordinates of the cells along each of [`ALONG`], sorted.
    pub(super) along: [Vec<i32>; 4],
}

/// The coordinate of a cell along rows, columns and both diagonals.
pub(super) const ALONG: [fn(i32, i32) -> i32; 4] = [|i, _| i, |_, j| j, |i, j| i + j, |i, j| i - j];

impl Shape {
    pub(super) fn new(of: &[Pos]) -> Self {
        let mut cells = Cells::default();
        cells.set(of);
        let mut rest = cells.all.clone();
        rest.sort_unstable();
        let mut runs = Vec::new();
        while let Some(&first) = rest.first() {
            let length = |step: Step| {
                let at = |n: i16| (first.0 + n * step.0, first.1 + n * step.1);
                (1..i16::MAX).find(|&n| !rest.contains(&at(n))).expect("cells are few")
            };
            let (across, down) = (length((0, 1)), length((1, 0)));
            let is_column = down > across;
            let length = across.max(down);
            // The first remaining cell has none above it or before it, so a run begins with it.
            rest.retain(|cell| {
                let (i, j) = (cell.0 - first.0, cell.1 - first.1);
                let (along, beside) = if is_column { (i, j) } else { (j, i) };
                beside != 0 || along < 0 || along >= length
            });
            runs.push(CellRun { first, length, is_column });
        }
        let along = ALONG.map(|along| {
            let places = cells.all.iter().map(|&(i, j)| along(i.into(), j.into()));
            let mut places: Vec<i32> = places.collect();
            places.sort_unstable();
            places
        });
        Self { cells, runs, along }
    }
}
