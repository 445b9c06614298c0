//! The cost of a placement in Flocking: exact, by bound and prune.
//!
//! Wanted is the least cost of an optimal assignment over all translations that bring some target
//! cell onto some agent. An assignment costs up to the cube of the number of agents and there are
//! up to its square of translations, so most translations are settled by lower bounds:
//!
//! 1. Along a line, the best matching keeps the order, so its cost is quickly found; and it depends
//!    on one coordinate of the translation alone, so a small table has it for all translations. An
//!    assignment costs at least what rows and columns cost together, each matched on their own. It
//!    also costs at least what each of the two diagonals costs, since |Δi| + |Δj| is the greater of
//!    |Δi + Δj| and |Δi − Δj|.
//! 2. The assignment itself is found from below, by shortest augmenting paths; its dual value never
//!    exceeds the cost, and it is given up as soon as that reaches the best cost known. The prices
//!    of the columns are kept from one translation to the next: any prices give a dual value, and
//!    those that were right elsewhere are mostly good enough to give up before the first path.
//!
//! Translations are tried in the order of the first bound, and the search ends where it reaches the
//! best cost known.

use crate::grid::Pos;

/// The least total of rows and columns by which agents and target cells, matched one to one, are
/// apart under the best translation. Where there are more of one than of the other, only the fewer
/// need a partner. Neither may be empty.
#[must_use]
pub fn distance(agents: &[Pos], target: &[Pos]) -> i32 {
    // The roles can be exchanged: a translation of the one is the opposite one of the other.
    let (few, many) = if agents.len() < target.len() { (agents, target) } else { (target, agents) };
    let mut assignment = Assignment::new(many.len());
    let mut best = i32::MAX;
    for (bound, by) in translations(few, many) {
        if bound >= best {
            break;
        }
        if let Some(cost) = assignment.below(best, few, many, by) {
            best = cost;
        }
    }
    best
}

/// All translations of `few` that bring one of them onto one of `many`, each once, by the lower
/// bound on their cost.
fn translations(few: &[Pos], many: &[Pos]) -> Vec<(i32, Pos)> {
    let along = |coordinate: fn(&Pos) -> i32| {
        Axis::new(few.iter().map(coordinate), many.iter().map(coordinate))
    };
    let (rows, columns) = (along(|cell| cell.i), along(|cell| cell.j));
    let (falling, rising) = (along(|cell| cell.i + cell.j), along(|cell| cell.i - cell.j));
    let mut seen = vec![false; rows.len() * columns.len()];
    let mut found = Vec::with_capacity(seen.len().min(few.len() * many.len()));
    for one in few {
        for other in many {
            let by = Pos::new(other.i - one.i, other.j - one.j);
            let known = &mut seen[rows.index(by.i) * columns.len() + columns.index(by.j)];
            if !*known {
                *known = true;
                let apart = rows.bound(by.i) + columns.bound(by.j);
                let across = falling.bound(by.i + by.j).max(rising.bound(by.i - by.j));
                found.push((apart.max(across), by));
            }
        }
    }
    found.sort_unstable_by_key(|&(bound, by)| (bound, by));
    found
}

/// Lower bounds along one axis, for every translation along it.
struct Axis {
    first: i32,
    bounds: Vec<i32>,
}

impl Axis {
    fn new(few: impl Iterator<Item = i32>, many: impl Iterator<Item = i32>) -> Self {
        let (few, many) = (sorted(few), sorted(many));
        let first = many[0] - few[few.len() - 1];
        let last = many[many.len() - 1] - few[0];
        let bounds = (first..=last).map(|by| matching(&few, &many, by)).collect();
        Self { first, bounds }
    }

    fn len(&self) -> usize {
        self.bounds.len()
    }

    fn index(&self, by: i32) -> usize {
        usize::try_from(by - self.first).expect("a difference of two of the points")
    }

    fn bound(&self, by: i32) -> i32 {
        self.bounds[self.index(by)]
    }
}

fn sorted(values: impl Iterator<Item = i32>) -> Vec<i32> {
    let mut values: Vec<i32> = values.collect();
    values.sort_unstable();
    values
}

/// The cheapest matching of all the `few` points, moved by `by`, to some of the `many`, on a line;
/// both sorted. The best matching keeps the order, so with `spare` points more on one side, point k
/// goes to one of the points k to k + spare.
fn matching(few: &[i32], many: &[i32], by: i32) -> i32 {
    let spare = many.len() - few.len();
    if spare == 0 {
        return few.iter().zip(many).map(|(a, b)| (a + by - b).abs()).sum();
    }
    // `costs[s]`: the points so far are matched and at most s of the many were passed over.
    let mut costs = vec![0; spare + 1];
    for (k, a) in few.iter().enumerate() {
        let mut least = i32::MAX;
        for (s, cost) in costs.iter_mut().enumerate() {
            least = least.min(*cost + (a + by - many[k + s]).abs());
            *cost = least;
        }
    }
    costs[spare]
}

/// The assignment problem of one translation, with its memory kept for the next. Rows are the
/// `few`, made as many as the columns by rows that cost nothing anywhere; columns are the `many`.
struct Assignment {
    size: usize,
    cost: Vec<i32>,
    row_price: Vec<i32>,
    column_price: Vec<i32>,
    row_of: Vec<usize>,
    reach: Vec<i32>,
    from: Vec<usize>,
    open: Vec<usize>,
}

const NONE: usize = usize::MAX;

impl Assignment {
    fn new(size: usize) -> Self {
        Self {
            size,
            cost: vec![0; size * size],
            row_price: vec![0; size],
            column_price: vec![0; size],
            row_of: vec![NONE; size],
            reach: vec![0; size],
            from: vec![NONE; size],
            open: vec![0; size],
        }
    }

    /// The cost of the best assignment of `few`, moved by `by`, to `many` if it is less than `limit`.
    fn below(&mut self, limit: i32, few: &[Pos], many: &[Pos], by: Pos) -> Option<i32> {
        let mut value = self.price(few, many, by);
        if value >= limit {
            return None;
        }
        for row in self.match_at_once() {
            value += self.match_row(row);
            if value >= limit {
                return None;
            }
        }
        Some(value)
    }

    /// Sets up the costs, and gives each row the highest price that the columns' prices allow.
    /// Returns the sum of all prices: the dual value to begin with.
    fn price(&mut self, few: &[Pos], many: &[Pos], by: Pos) -> i32 {
        // Only differences between the columns' prices matter; this keeps the numbers small.
        let highest = self.column_price.iter().copied().max().unwrap_or(0);
        self.column_price.iter_mut().for_each(|price| *price -= highest);
        for (row, price) in self.row_price.iter_mut().enumerate() {
            let costs = &mut self.cost[row * self.size..(row + 1) * self.size];
            if let Some(cell) = few.get(row) {
                let a = cell.plus(by);
                for (cost, b) in costs.iter_mut().zip(many) {
                    *cost = (a.i - b.i).abs() + (a.j - b.j).abs();
                }
            }
            let reduced = costs.iter().zip(&self.column_price).map(|(cost, price)| cost - price);
            *price = reduced.min().expect("not empty");
        }
        self.row_price.iter().sum::<i32>() + self.column_price.iter().sum::<i32>()
    }

    /// Matches rows to free columns whose price fits as it is; returns the rows that find none.
    fn match_at_once(&mut self) -> Vec<usize> {
        self.row_of.fill(NONE);
        let mut unmatched = Vec::new();
        for (row, price) in self.row_price.iter().enumerate() {
            let costs = &self.cost[row * self.size..(row + 1) * self.size];
            let fits = (costs.iter().zip(&self.column_price).zip(&self.row_of))
                .position(|((cost, other), &taken)| cost - other == *price && taken == NONE);
            match fits {
                Some(column) => self.row_of[column] = row,
                None => unmatched.push(row),
            }
        }
        unmatched
    }

    /// Matches one more row by a shortest augmenting path; returns by how much the optimum of the
    /// rows matched so far, and with it the dual value, grows.
    fn match_row(&mut self, row: usize) -> i32 {
        self.reach.fill(i32::MAX);
        let mut open = std::mem::take(&mut self.open);
        open.clear();
        open.extend(0..self.size);
        let mut settled = 0;
        let mut at = row;
        let mut via = NONE;
        let mut length = 0;
        let last = loop {
            let costs = &self.cost[at * self.size..(at + 1) * self.size];
            let base = length - self.row_price[at];
            let mut least = i32::MAX;
            let mut place = settled;
            for (k, &column) in open.iter().enumerate().skip(settled) {
                let reach = base + costs[column] - self.column_price[column];
                if reach < self.reach[column] {
                    self.reach[column] = reach;
                    self.from[column] = via;
                }
                let reach = self.reach[column];
                if reach < least || (reach == least && self.row_of[column] == NONE) {
                    least = reach;
                    place = k;
                }
            }
            length = least;
            let column = open[place];
            open.swap(settled, place);
            settled += 1;
            if self.row_of[column] == NONE {
                break column;
            }
            via = column;
            at = self.row_of[column];
        };
        self.row_price[row] += length;
        for &column in &open[..settled - 1] {
            let slack = length - self.reach[column];
            self.column_price[column] -= slack;
            self.row_price[self.row_of[column]] += slack;
        }
        let mut column = last;
        while column != NONE {
            let before = self.from[column];
            self.row_of[column] = if before == NONE { row } else { self.row_of[before] };
            column = before;
        }
        self.open = open;
        length
    }
}
