//! The assignment problem of one translation, solved by shortest augmenting paths, eight columns at once.

use wide::i16x8;

use super::cells::{Cells, Step};

/// Number of columns processed together.
const LANES: usize = 8;

/// Twice the price of a column that no row should choose: one after the last, or one to which the shortest path is
/// known. Cells lie at most 1022 rows and columns apart and, since matched pairs fit their prices, all prices are
/// within 1022; so the shortest path to a free column is below 4096, and the way to such a column longer.
const FAR: i16 = -16_384;

/// Marker for no row and for no column.
const NONE: u16 = u16::MAX;

/// Numbers by column, in vectors; the last lanes may belong to no column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lanes(Vec<i16x8>);

impl Lanes {
    fn set(&mut self, values: impl Iterator<Item = i16>, after: i16) {
        self.0.clear();
        for (place, value) in values.enumerate() {
            if place % LANES == 0 {
                self.0.push(i16x8::splat(after));
            }
            *self.at_mut(place) = value;
        }
    }

    fn fill(&mut self, value: i16) {
        self.0.fill(i16x8::splat(value));
    }

    /// All numbers; those of lanes that belong to no column come last.
    fn iter(&self) -> impl Iterator<Item = i16> {
        self.0.iter().flat_map(|lanes| lanes.to_array())
    }

    fn at(&self, place: usize) -> i16 {
        self.0[place / LANES].as_array()[place % LANES]
    }

    fn at_mut(&mut self, place: usize) -> &mut i16 {
        &mut self.0[place / LANES].as_mut_array()[place % LANES]
    }
}

/// The start of an assignment: prices of the columns, and the column of each row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Start {
    prices: Lanes,
    columns: Vec<u16>,
}

/// A column to which the shortest path is known.
#[derive(Clone, Copy, Debug)]
struct Settled {
    column: u16,
    length: i16,
    /// The value of `column_price`, which is replaced during the search.
    price: i16,
}

/// The problem with its memory. Rows are the `few`, padded to the number of columns with rows of cost 0; columns are
/// the `many`.
#[derive(Debug, Default)]
pub(super) struct Assignment {
    rows: Vec<Step>,
    size: usize,
    /// Twice the row and twice the column number of each column's cell.
    column_i: Lanes,
    column_j: Lanes,
    /// Twice the price of each column, minus one once it has a row: so of two paths of equal length, the one that ends
    /// in a free column is the shorter.
    column_price: Lanes,
    row_price: Vec<i16>,
    /// The column with which a row was matched last, by row.
    column_of: Vec<u16>,
    row_of: Vec<u16>,
    unmatched: Vec<u16>,
    /// Twice the length of the shortest path so far (plus one, see `column_price`), by column.
    reach: Lanes,
    path: Vec<Settled>,
}

impl Assignment {
    /// Sets the problem up. `start` may come from an earlier problem with other cells; if its size differs, all prices
    /// are 0.
    pub(super) fn begin(&mut self, few: &Cells, many: &Cells, start: &Start) {
        self.size = many.all.len();
        self.rows.clear();
        self.rows.extend_from_slice(&few.all);
        self.column_i.set(many.all.iter().map(|cell| 2 * cell.0), 0);
        self.column_j.set(many.all.iter().map(|cell| 2 * cell.1), 0);
        let zeros = || std::iter::repeat_n(0, many.all.len());
        self.column_price.set(zeros(), FAR);
        self.column_of.clear();
        self.column_of.resize(self.size, NONE);
        if start.columns.len() == self.size {
            self.restore(start);
        }
        self.reach.set(zeros(), 0);
        self.row_price.clear();
        self.row_price.resize(self.size, 0);
        self.row_of.clear();
        self.row_of.resize(self.size, NONE);
    }

    /// The current prices of the columns; the greatest is 0.
    pub(super) fn prices(&self) -> impl Iterator<Item = i16> {
        self.column_price.iter().take(self.size).map(|double| double / 2)
    }

    /// Saves the current prices and pairs.
    pub(super) fn save(&self, to: &mut Start) {
        to.prices.0.clone_from(&self.column_price.0);
        to.columns.clone_from(&self.column_of);
    }

    /// Restores prices and pairs of a problem of the same size.
    pub(super) fn restore(&mut self, from: &Start) {
        self.column_price.0.copy_from_slice(&from.prices.0);
        self.column_of.copy_from_slice(&from.columns);
    }

    /// The cost of the best assignment of the few, moved by `by`, to the many if it is less than `limit`. The prices
    /// afterwards are good ones for this translation, even if there is no result.
    pub(super) fn below(&mut self, limit: i32, by: Step) -> Option<i32> {
        let mut value = self.set_prices(by);
        if value >= limit {
            return None;
        }
        self.match_at_once(by);
        for place in 0..self.unmatched.len() {
            value += i32::from(self.match_row(self.unmatched[place], by));
            if value >= limit {
                self.shift_prices();
                return None;
            }
        }
        self.shift_prices();
        Some(value)
    }

    /// Normalizes the prices of the columns, of which only the differences matter, to keep the numbers small. Leaves
    /// all columns free.
    fn shift_prices(&mut self) {
        let (one, mut highest) = (i16x8::splat(1), i16x8::splat(FAR));
        for lanes in &mut self.column_price.0 {
            *lanes = (*lanes + one) & !one;
            highest = highest.max(*lanes);
        }
        let highest = i16x8::splat(highest.reduce_max());
        for lanes in &mut self.column_price.0 {
            *lanes = (*lanes - highest).max(i16x8::splat(FAR));
        }
    }

    /// Gives each row the highest price that the columns' prices allow. Returns the sum of all prices: the initial dual
    /// value.
    fn set_prices(&mut self, by: Step) -> i32 {
        let mut sum = 0;
        let prices = &mut self.row_price;
        for (price, row) in prices.iter_mut().zip(&self.rows) {
            let (i, j) = place(*row, by);
            let mut least = i16x8::splat(i16::MAX);
            for ((column_i, column_j), column_price) in
                self.column_i.0.iter().zip(&self.column_j.0).zip(&self.column_price.0)
            {
                least = least.min(apart(i, *column_i) + apart(j, *column_j) - *column_price);
            }
            *price = least.reduce_min() / 2;
            sum += i32::from(*price);
        }
        // The highest price of a column is 0.
        prices[self.rows.len()..].fill(0);
        sum + self.prices().map(i32::from).sum::<i32>()
    }

    /// The reduced cost: the cost less the prices of its row and its column.
    fn reduced(&self, row: usize, column: usize, by: Step) -> i16 {
        let cost = self.rows.get(row).map_or(0, |cell| {
            let (i, j) = (self.column_i.at(column), self.column_j.at(column));
            (2 * (cell.0 + by.0) - i).abs() + (2 * (cell.1 + by.1) - j).abs()
        });
        (cost - self.column_price.at(column)) / 2 - self.row_price[row]
    }

    /// Matches rows to free columns of reduced cost 0, if possible to the same as last time; rows that find none are
    /// put into `unmatched`.
    fn match_at_once(&mut self, by: Step) {
        self.row_of.fill(NONE);
        self.unmatched.clear();
        for (row, number) in (0..self.size).zip(0..) {
            let column = usize::from(self.column_of[row]);
            if column < self.size && self.reduced(row, column, by) == 0 {
                self.row_of[column] = number;
                *self.column_price.at_mut(column) -= 1;
            } else {
                self.column_of[row] = NONE;
            }
        }
        for (row, number) in (0..self.size).zip(0..) {
            if self.column_of[row] != NONE {
                continue;
            }
            match self.free_column(row, by) {
                Some(column) => {
                    self.column_of[row] = column;
                    self.row_of[usize::from(column)] = number;
                    *self.column_price.at_mut(column.into()) -= 1;
                }
                None => self.unmatched.push(number),
            }
        }
    }

    /// A free column of reduced cost 0 for a row.
    fn free_column(&self, row: usize, by: Step) -> Option<u16> {
        let Some(cell) = self.rows.get(row) else {
            return (0..)
                .zip(&self.row_of)
                .filter(|&(_, &row)| row == NONE)
                .map(|(column, _)| column)
                .find(|&column| self.reduced(row, usize::from(column), by) == 0);
        };
        let price = i16x8::splat(2 * self.row_price[row]);
        let (i, j) = place(*cell, by);
        let columns = self.column_i.0.iter().zip(&self.column_j.0).zip(&self.column_price.0);
        for (first, ((column_i, column_j), column_price)) in (0..).step_by(LANES).zip(columns) {
            let reduced = apart(i, *column_i) + apart(j, *column_j) - *column_price;
            let fits = reduced.simd_eq(price).to_bitmask();
            if fits != 0 {
                return Some(first_of(first, fits));
            }
        }
        None
    }

    /// Matches one more row by a shortest augmenting path. Returns the growth of the optimum of the rows matched so
    /// far, which is also the growth of the dual value.
    fn match_row(&mut self, row: u16, by: Step) -> i16 {
        self.reach.fill(i16::MAX);
        self.path.clear();
        let (mut at, mut length) = (row, 0);
        let last = loop {
            let least = self.relax(at, 2 * (length - self.row_price[usize::from(at)]), by);
            let column = self.first_at(least);
            length = least / 2;
            if least % 2 == 0 {
                break column;
            }
            let price = std::mem::replace(self.column_price.at_mut(column.into()), FAR);
            *self.reach.at_mut(column.into()) = i16::MAX;
            self.path.push(Settled { column, length, price });
            at = self.row_of[usize::from(column)];
        };
        self.row_price[usize::from(row)] += length;
        for settled in &self.path {
            let slack = length - settled.length;
            *self.column_price.at_mut(settled.column.into()) = settled.price - 2 * slack;
            self.row_price[usize::from(self.row_of[usize::from(settled.column)])] += slack;
        }
        self.augment(row, last, by);
        *self.column_price.at_mut(last.into()) -= 1;
        length
    }

    /// Matches along the shortest path from a row to a free column. The path is reconstructed from its end: each column
    /// was reached from the first row whose reduced cost to it is 0 now.
    fn augment(&mut self, row: u16, last: u16, by: Step) {
        let (mut column, mut before) = (last, self.path.len());
        while self.reduced(row.into(), column.into(), by) != 0 {
            let fits = |settled: &Settled| {
                let row = self.row_of[usize::from(settled.column)];
                self.reduced(row.into(), column.into(), by) == 0
            };
            before = self.path[..before].iter().position(fits).expect("it was reached");
            let via = self.path[before].column;
            self.pair(self.row_of[usize::from(via)], column);
            column = via;
        }
        self.pair(row, column);
    }

    fn pair(&mut self, row: u16, column: u16) {
        self.row_of[usize::from(column)] = row;
        self.column_of[usize::from(row)] = column;
    }

    /// Updates the reach of all columns from a row, with `base` added to each; returns the least reach.
    fn relax(&mut self, row: u16, base: i16, by: Step) -> i16 {
        let base = i16x8::splat(base);
        let mut least = i16x8::splat(i16::MAX);
        let mut look = |new: i16x8, reach: &mut i16x8| {
            *reach = new.min(*reach);
            least = least.min(*reach);
        };
        let columns = self.reach.0.iter_mut().zip(&self.column_price.0);
        if let Some(cell) = self.rows.get(usize::from(row)) {
            let (i, j) = place(*cell, by);
            let places = self.column_i.0.iter().zip(&self.column_j.0);
            for ((reach, price), (column_i, column_j)) in columns.zip(places) {
                look(base - *price + (apart(i, *column_i) + apart(j, *column_j)), reach);
            }
        } else {
            for (reach, price) in columns {
                look(base - *price, reach);
            }
        }
        least.reduce_min()
    }

    /// The first column that has this reach.
    fn first_at(&self, reach: i16) -> u16 {
        const TOGETHER: usize = 4;
        let wanted = i16x8::splat(reach);
        let groups = (0..).step_by(TOGETHER * LANES).zip(self.reach.0.chunks(TOGETHER));
        for (first, group) in groups {
            let any = group.iter().fold(i16x8::ZERO, |any, lanes| any | lanes.simd_eq(wanted));
            if any.to_bitmask() == 0 {
                continue;
            }
            for (first, lanes) in (first..).step_by(LANES).zip(group) {
                let fits = lanes.simd_eq(wanted).to_bitmask();
                if fits != 0 {
                    return first_of(first, fits);
                }
            }
        }
        unreachable!("some column has the least reach")
    }
}

/// Twice the coordinates of a row's cell, moved by `by`.
fn place(cell: Step, by: Step) -> (i16x8, i16x8) {
    (i16x8::splat(2 * (cell.0 + by.0)), i16x8::splat(2 * (cell.1 + by.1)))
}

fn apart(a: i16x8, b: i16x8) -> i16x8 {
    (a - b).max(b - a)
}

/// The column of the first set bit, where the first lane is column `place`.
fn first_of(place: usize, bits: u32) -> u16 {
    u16::try_from(place + bits.trailing_zeros() as usize).expect("columns are few")
}
