//! The assignment problem of one translation: by shortest augmenting paths, eight columns at once.

use wide::i16x8;

use super::cells::{Cells, Step};

/// Columns that are looked at together.
const LANES: usize = 8;

/// What stands for a column after the last: no cost brings a row to it.
const FAR: i16 = -8192;

/// What stands for no row and for no column.
const NONE: u16 = u16::MAX;

/// Numbers by column, in lanes; the last lanes may belong to no column.
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

    /// All numbers, those of the lanes that belong to no column at the end.
    pub(super) fn iter(&self) -> impl Iterator<Item = i16> {
        self.0.iter().flat_map(|lanes| lanes.to_array())
    }

    fn at(&self, place: usize) -> i16 {
        self.0[place / LANES].as_array()[place % LANES]
    }

    fn at_mut(&mut self, place: usize) -> &mut i16 {
        &mut self.0[place / LANES].as_mut_array()[place % LANES]
    }
}

/// From where an assignment begins: prices of the columns, and the column of each row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Start {
    prices: Lanes,
    columns: Vec<u16>,
}

/// The problem with its memory. Rows are the `few`, made as many as the columns by rows that cost nothing anywhere;
/// columns are the `many`.
#[derive(Debug, Default)]
pub(super) struct Assignment {
    rows: Vec<Step>,
    size: usize,
    column_i: Lanes,
    column_j: Lanes,
    column_price: Lanes,
    row_price: Vec<i16>,
    /// By row the column with which it was matched last.
    column_of: Vec<u16>,
    row_of: Vec<u16>,
    /// All bits of a column that has no row.
    is_free: Lanes,
    unmatched: Vec<u16>,
    reach: Lanes,
    from: Lanes,
    /// The greatest number for columns to which a shortest path is known.
    settled: Lanes,
    path: Vec<u16>,
    /// How often a row was compared with all columns.
    pub(super) looks: usize,
}

impl Assignment {
    /// Sets the problem up. `start` may be that of an earlier one with other cells; if it is one of another size, all
    /// prices are 0.
    pub(super) fn begin(&mut self, few: &Cells, many: &Cells, start: &Start) {
        self.size = many.all.len();
        self.rows.clear();
        self.rows.extend_from_slice(&few.all);
        self.column_i.set(many.all.iter().map(|cell| cell.0), 0);
        self.column_j.set(many.all.iter().map(|cell| cell.1), 0);
        let zeros = || std::iter::repeat_n(0, many.all.len());
        self.column_price.set(zeros(), FAR);
        self.column_of.clear();
        self.column_of.resize(self.size, NONE);
        if start.columns.len() == self.size {
            self.restore(start);
        }
        for lanes in [&mut self.is_free, &mut self.reach, &mut self.from] {
            lanes.set(zeros(), 0);
        }
        self.settled.set(zeros(), i16::MAX);
        self.path.clear();
        self.row_price.clear();
        self.row_price.resize(self.size, 0);
        self.row_of.clear();
        self.row_of.resize(self.size, NONE);
    }

    /// The prices of the columns as they are now; the greatest is 0.
    pub(super) const fn prices(&self) -> &Lanes {
        &self.column_price
    }

    /// Notes the prices and pairs as they are now.
    pub(super) fn save(&self, to: &mut Start) {
        to.prices.0.clone_from(&self.column_price.0);
        to.columns.clone_from(&self.column_of);
    }

    /// Goes back to prices and pairs of the same problem.
    pub(super) fn restore(&mut self, from: &Start) {
        self.column_price.0.copy_from_slice(&from.prices.0);
        self.column_of.copy_from_slice(&from.columns);
    }

    /// The cost of the best assignment of the few, moved by `by`, to the many if it is less than `limit`. The prices
    /// after it are good ones for this translation, whatever the outcome.
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

    /// Only differences between the columns' prices matter; this keeps the numbers small.
    fn shift_prices(&mut self) {
        let highest =
            self.column_price.0.iter().fold(i16x8::splat(FAR), |high, lanes| high.max(*lanes));
        let highest = i16x8::splat(highest.reduce_max());
        for lanes in &mut self.column_price.0 {
            *lanes = (*lanes - highest).max(i16x8::splat(FAR));
        }
    }

    /// Gives each row the highest price that the columns' prices allow. Returns the sum of all prices: the dual value
    /// to begin with.
    fn set_prices(&mut self, by: Step) -> i32 {
        let mut sum = 0;
        self.looks += self.rows.len();
        let prices = &mut self.row_price;
        for (price, row) in prices.iter_mut().zip(&self.rows) {
            let (i, j) = (i16x8::splat(row.0 + by.0), i16x8::splat(row.1 + by.1));
            let mut least = i16x8::splat(i16::MAX);
            for ((column_i, column_j), column_price) in
                self.column_i.0.iter().zip(&self.column_j.0).zip(&self.column_price.0)
            {
                let reduced = (i - *column_i).abs() + (j - *column_j).abs() - *column_price;
                least = least.min(reduced);
            }
            *price = least.reduce_min();
            sum += i32::from(*price);
        }
        // The highest price of a column is 0.
        prices[self.rows.len()..].fill(0);
        sum + self.column_price.iter().take(self.size).map(i32::from).sum::<i32>()
    }

    /// What is left of a cost after the prices of its row and its column.
    fn reduced(&self, row: usize, column: usize, by: Step) -> i16 {
        let cost = self.rows.get(row).map_or(0, |cell| {
            let (i, j) = (self.column_i.at(column), self.column_j.at(column));
            (cell.0 + by.0 - i).abs() + (cell.1 + by.1 - j).abs()
        });
        cost - self.column_price.at(column) - self.row_price[row]
    }

    /// Matches rows to free columns whose price fits as it is, if possible to the same as last time; the rows that
    /// find none are `unmatched`.
    fn match_at_once(&mut self, by: Step) {
        self.row_of.fill(NONE);
        self.is_free.set(std::iter::repeat_n(-1, self.size), 0);
        self.unmatched.clear();
        for (row, number) in (0..self.size).zip(0..) {
            let column = usize::from(self.column_of[row]);
            if column < self.size && self.reduced(row, column, by) == 0 {
                self.row_of[column] = number;
                *self.is_free.at_mut(column) = 0;
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
                    *self.is_free.at_mut(column.into()) = 0;
                }
                None => self.unmatched.push(number),
            }
        }
    }

    /// A free column whose price fits a row.
    fn free_column(&self, row: usize, by: Step) -> Option<u16> {
        let price = i16x8::splat(self.row_price[row]);
        let Some(cell) = self.rows.get(row) else {
            return (0..)
                .zip(&self.row_of)
                .filter(|&(_, &row)| row == NONE)
                .map(|(column, _)| column)
                .find(|&column| self.reduced(row, usize::from(column), by) == 0);
        };
        let (i, j) = (i16x8::splat(cell.0 + by.0), i16x8::splat(cell.1 + by.1));
        for (place, (((column_i, column_j), column_price), is_free)) in (0..).step_by(LANES).zip(
            (self.column_i.0.iter().zip(&self.column_j.0))
                .zip(&self.column_price.0)
                .zip(&self.is_free.0),
        ) {
            let reduced = (i - *column_i).abs() + (j - *column_j).abs() - *column_price;
            let fits = (reduced.simd_eq(price) & *is_free).to_bitmask();
            if fits != 0 {
                return Some(first_of(place, fits));
            }
        }
        None
    }

    /// Matches one more row by a shortest augmenting path; returns by how much the optimum of the rows matched so
    /// far, and with it the dual value, grows.
    fn match_row(&mut self, row: u16, by: Step) -> i16 {
        self.reach.fill(i16::MAX);
        for &column in &self.path {
            *self.settled.at_mut(column.into()) = 0;
        }
        self.path.clear();
        let (mut at, mut via, mut length) = (row, NONE, 0);
        let last = loop {
            let free;
            (length, free) = self.relax(at, via, length - self.row_price[usize::from(at)], by);
            let column = self.nearest(length, free == length);
            at = self.row_of[usize::from(column)];
            if at == NONE {
                break column;
            }
            *self.settled.at_mut(column.into()) = i16::MAX;
            self.path.push(column);
            via = column;
        };
        self.row_price[usize::from(row)] += length;
        for &column in &self.path {
            let slack = length - self.reach.at(column.into());
            *self.column_price.at_mut(column.into()) -= slack;
            self.row_price[usize::from(self.row_of[usize::from(column)])] += slack;
        }
        *self.is_free.at_mut(last.into()) = 0;
        let mut column = last;
        while column != NONE {
            let before = self.from.at(column.into()).cast_unsigned();
            let row = if before == NONE { row } else { self.row_of[usize::from(before)] };
            self.row_of[usize::from(column)] = row;
            self.column_of[usize::from(row)] = column;
            column = before;
        }
        length
    }

    /// Looks from a row, `base` and its price away, at all columns; returns the least reach of those that are not
    /// settled, and of those that are free.
    fn relax(&mut self, row: u16, via: u16, base: i16, by: Step) -> (i16, i16) {
        self.looks += 1;
        let base = i16x8::splat(base);
        let via = i16x8::splat(via.cast_signed());
        let mut least = i16x8::splat(i16::MAX);
        let (mut free, most) = (least, least);
        let mut look = |new: i16x8,
                        reach: &mut i16x8,
                        from: &mut i16x8,
                        (settled, is_free): (&i16x8, &i16x8)| {
            *from = new.simd_lt(*reach).select(via, *from);
            *reach = new.min(*reach);
            least = least.min(reach.max(*settled));
            free = free.min(reach.max(!*is_free & most));
        };
        let states = self.settled.0.iter().zip(&self.is_free.0);
        let columns = self.reach.0.iter_mut().zip(&mut self.from.0).zip(states);
        let columns = columns.zip(&self.column_price.0);
        if let Some(cell) = self.rows.get(usize::from(row)) {
            let (i, j) = (i16x8::splat(cell.0 + by.0), i16x8::splat(cell.1 + by.1));
            let places = self.column_i.0.iter().zip(&self.column_j.0);
            for ((((reach, from), settled), price), (column_i, column_j)) in columns.zip(places) {
                let cost = (i - *column_i).abs() + (j - *column_j).abs();
                look(base + cost - *price, reach, from, settled);
            }
        } else {
            for (((reach, from), settled), price) in columns {
                look(base - *price, reach, from, settled);
            }
        }
        (least.reduce_min(), free.reduce_min())
    }

    /// The first column that is not settled and has this reach, or the first that is free.
    fn nearest(&self, length: i16, is_free: bool) -> u16 {
        let length = i16x8::splat(length);
        let any = i16x8::splat(if is_free { 0 } else { -1 });
        let columns = self.reach.0.iter().zip(&self.settled.0).zip(&self.is_free.0);
        for (place, ((reach, settled), free)) in (0..).step_by(LANES).zip(columns) {
            let fits = (reach.max(*settled).simd_eq(length) & (*free | any)).to_bitmask();
            if fits != 0 {
                return first_of(place, fits);
            }
        }
        NONE
    }
}

/// The column of the first bit, where the lanes begin with the column `place`.
fn first_of(place: usize, bits: u32) -> u16 {
    u16::try_from(place + bits.trailing_zeros() as usize).expect("columns are few")
}
