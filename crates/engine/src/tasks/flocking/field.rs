//! Lower bounds for all translations at once, from the prices of one of them.
//!
//! For any prices of the agents, a target cell at x can be given the price ψ(x) = min (|x − a| − price of a) over all
//! agents a, wherever it lies; so the sum of ψ over the cells of a moved target and of the agents' prices is never more
//! than the cost of that translation. ψ is drawn on the map as a distance transform, in four passes. Prefix sums along
//! its rows and columns then give the sum over a run of cells by two look-ups, and an outline is four runs.

use wide::{i16x8, i32x8};

use super::cells::{CellRun, Cells, Shape, Step};

/// Number of rows, and of columns, processed together: a block of cells that is transposed.
const BLOCK: usize = 8;

/// A number greater than any value.
const FAR: i16 = 16_000;

/// ψ over a rectangle.
#[derive(Debug, Default)]
pub(super) struct Field {
    top: i16,
    left: i16,
    /// Number of cells of a row, with at least one after the last that matters.
    stride: usize,
    values: Vec<i16>,
    /// Eight rows of the values, by column.
    columns: Vec<i16x8>,
    /// The sum of a cell's value and those after it in its row. Sums are stored by column in vectors of eight rows.
    across: Vec<i32x8>,
    /// The sum of the values above a cell in its column, by cell.
    down: Vec<i32>,
    /// The part of the bound that does not depend on the translation.
    base: i32,
}

impl Field {
    /// Draws the field for all translations of `few` from the first row and column to the last.
    pub(super) fn draw(
        &mut self,
        few: &Shape,
        many: &Cells,
        prices: impl Iterator<Item = i16>,
        (first, last): (Step, Step),
    ) {
        let length = |first: i16, last: i16| usize::from((last - first).unsigned_abs()) + 1;
        let (top, left) = first;
        let (bottom, right) = (last.0 + few.cells.last.0, last.1 + few.cells.last.1);
        let height = length(top, bottom);
        let stride = (length(left, right) + 1).next_multiple_of(BLOCK);
        (self.top, self.left, self.stride) = (top, left, stride);
        let spare = many.all.len() - few.cells.all.len();
        let (mut sum, mut highest) = (0, i16::MIN);
        self.values.clear();
        self.values.resize(height.next_multiple_of(BLOCK) * stride, FAR);
        for (&(i, j), price) in many.all.iter().zip(prices) {
            sum += i32::from(price);
            highest = highest.max(price);
            // The distance from a cell outside to any cell inside is the distance to the nearest edge cell plus the
            // distance from there.
            let (near_i, near_j) = (i.clamp(top, bottom), j.clamp(left, right));
            let value = (i - near_i).abs() + (j - near_j).abs() - price;
            let (row, column) = self.row_and_column((near_i, near_j));
            let nearest = &mut self.values[row * stride + column];
            *nearest = value.min(*nearest);
        }
        self.base = sum - i32::try_from(spare).expect("few") * i32::from(highest);
        self.spread_down();
        self.spread_across();
        self.sum_down(height);
    }

    /// The least cost that the prices allow for a translation.
    pub(super) fn bound(&self, few: &Shape, by: Step) -> i32 {
        let sum = |run: &CellRun| {
            let (row, column) = self.row_and_column((by.0 + run.first.0, by.1 + run.first.1));
            let length = usize::from(run.length.unsigned_abs());
            if run.is_column {
                let at = row * self.stride + column;
                self.down[at + length * self.stride] - self.down[at]
            } else {
                let at = row / BLOCK * self.stride + column;
                let sum = |at: usize| self.across[at].as_array()[row % BLOCK];
                sum(at) - sum(at + length)
            }
        };
        self.base + few.runs.iter().map(sum).sum::<i32>()
    }

    fn row_and_column(&self, (i, j): Step) -> (usize, usize) {
        let inside = |at: i16| usize::from(at.unsigned_abs());
        (inside(i - self.top), inside(j - self.left))
    }

    /// Spreads values down and up: they may differ by at most 1 from row to row.
    fn spread_down(&mut self) {
        let rows = self.values.len() / self.stride;
        let spread = |from: &[i16], to: &mut [i16]| {
            for (to, from) in to.iter_mut().zip(from) {
                *to = (*to).min(from + 1);
            }
        };
        for row in 1..rows {
            let (above, here) = self.values.split_at_mut(row * self.stride);
            spread(&above[(row - 1) * self.stride..], &mut here[..self.stride]);
        }
        for row in (1..rows).rev() {
            let (above, here) = self.values.split_at_mut(row * self.stride);
            spread(&here[..self.stride], &mut above[(row - 1) * self.stride..]);
        }
    }

    /// Spreads values across columns likewise, eight rows at once; sums up rows on the way back.
    fn spread_across(&mut self) {
        let Self { stride, values, columns, across, .. } = self;
        across.resize(values.len() / BLOCK, i32x8::ZERO);
        let one = i16x8::splat(1);
        for (rows, sums) in
            values.chunks_exact_mut(BLOCK * *stride).zip(across.chunks_exact_mut(*stride))
        {
            columns.clear();
            let mut most = i16x8::splat(FAR);
            for first in (0..*stride).step_by(BLOCK) {
                for column in turned(rows, *stride, first) {
                    most = column.min(most + one);
                    columns.push(most);
                }
            }
            let (mut most, mut total) = (i16x8::splat(FAR), i32x8::ZERO);
            for (column, sum) in columns.iter_mut().zip(sums).rev() {
                most = (*column).min(most + one);
                *column = most;
                total += i32x8::from_i16x8(most);
                *sum = total;
            }
            for (block, first) in columns.as_chunks::<BLOCK>().0.iter().zip((0..).step_by(BLOCK)) {
                let block = i16x8::transpose(*block);
                for (row, values) in rows.chunks_exact_mut(*stride).zip(&block) {
                    row[first..first + BLOCK].copy_from_slice(values.as_array());
                }
            }
        }
    }

    fn sum_down(&mut self, height: usize) {
        let stride = self.stride;
        self.down.resize((height + 1) * stride, 0);
        self.down[..stride].fill(0);
        for (row, values) in self.values.chunks_exact(stride).take(height).enumerate() {
            let (above, below) = self.down.split_at_mut((row + 1) * stride);
            let sums = below[..stride].iter_mut().zip(&above[row * stride..]);
            for ((below, above), value) in sums.zip(values) {
                *below = above + i32::from(*value);
            }
        }
    }
}

/// Transposes eight columns of eight rows.
fn turned(rows: &[i16], stride: usize, first: usize) -> [i16x8; BLOCK] {
    let row = |row: usize| {
        let at = row * stride + first;
        i16x8::from(rows[at..at + BLOCK].as_chunks().0[0])
    };
    i16x8::transpose(std::array::from_fn(row))
}
