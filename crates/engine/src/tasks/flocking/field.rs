//! Lower bounds for all translations at once, from the prices that one of them has.
//!
//! Whatever prices the agents have, a target cell at x can be given the price ψ(x) = min (|x − a| − price of a) over all
//! agents a, wherever it lies; so the sum of ψ over the cells of a moved target and of the agents' prices is never more
//! than the cost of that translation. ψ is drawn on the map as a transform of distances, four passes over it. Sums along
//! rows and columns of it then give the sum over a run of cells by two look-ups, and an outline is four runs.

use super::assignment::Lanes;
use super::cells::{Cells, Run, Shape, Step};

/// More than any value.
const FAR: i16 = 16_000;

/// ψ over a rectangle.
#[derive(Debug, Default)]
pub(super) struct Field {
    top: i16,
    left: i16,
    /// Cells of a row, with at least one after the last that matters.
    stride: usize,
    values: Vec<i16>,
    /// By cell, the sum of its value and those after it in its row.
    across: Vec<i32>,
    /// By cell, the sum of the values above it in its column.
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
        prices: &Lanes,
        (first, last): (Step, Step),
    ) {
        let length = |first: i16, last: i16| usize::from((last - first).unsigned_abs()) + 1;
        let (top, left) = first;
        let (bottom, right) = (last.0 + few.cells.last.0, last.1 + few.cells.last.1);
        let height = length(top, bottom);
        let stride = (length(left, right) + 1).next_multiple_of(8);
        (self.top, self.left, self.stride) = (top, left, stride);
        let spare = many.all.len() - few.cells.all.len();
        let (mut sum, mut highest) = (0, i16::MIN);
        self.values.clear();
        self.values.resize(height * stride, FAR);
        for (&(i, j), price) in many.all.iter().zip(prices.iter()) {
            sum += i32::from(price);
            highest = highest.max(price);
            // What lies outside is as far from every cell inside as the cell of the edge that is nearest to it, and more.
            let (near_i, near_j) = (i.clamp(top, bottom), j.clamp(left, right));
            let value = (i - near_i).abs() + (j - near_j).abs() - price;
            let place = self.place((near_i, near_j));
            self.values[place] = self.values[place].min(value);
        }
        self.base = sum - i32::try_from(spare).expect("few") * i32::from(highest);
        self.spread_down();
        self.spread_across();
        self.sum_down(height);
    }

    /// The least cost that the prices allow for a translation.
    pub(super) fn bound(&self, few: &Shape, by: Step) -> i32 {
        let sum = |run: &Run| {
            let at = self.place((by.0 + run.first.0, by.1 + run.first.1));
            let length = usize::from(run.length.unsigned_abs());
            if run.is_column {
                self.down[at + length * self.stride] - self.down[at]
            } else {
                self.across[at] - self.across[at + length]
            }
        };
        self.base + few.runs.iter().map(sum).sum::<i32>()
    }

    fn place(&self, (i, j): Step) -> usize {
        let inside = |at: i16| usize::from(at.unsigned_abs());
        inside(i - self.top) * self.stride + inside(j - self.left)
    }

    /// Values may differ by at most 1 from row to row.
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

    /// The same from column to column; sums up rows on the way back.
    fn spread_across(&mut self) {
        self.across.resize(self.values.len(), 0);
        let sums = self.across.chunks_exact_mut(self.stride);
        for (row, sums) in self.values.chunks_exact_mut(self.stride).zip(sums) {
            let mut most = FAR;
            for value in &mut *row {
                most = (*value).min(most + 1);
                *value = most;
            }
            let (mut most, mut total) = (FAR, 0);
            for (value, sum) in row.iter_mut().zip(sums).rev() {
                most = (*value).min(most + 1);
                *value = most;
                total += i32::from(most);
                *sum = total;
            }
        }
    }

    fn sum_down(&mut self, height: usize) {
        let stride = self.stride;
        self.down.resize((height + 1) * stride, 0);
        self.down[..stride].fill(0);
        for (row, values) in self.values.chunks_exact(stride).enumerate() {
            let (above, below) = self.down.split_at_mut((row + 1) * stride);
            let sums = below[..stride].iter_mut().zip(&above[row * stride..]);
            for ((below, above), value) in sums.zip(values) {
                *below = above + i32::from(*value);
            }
        }
    }
}
