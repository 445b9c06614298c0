//! The cost of a placement in Flocking: exact, by bound and prune.
//!
//! Wanted is the least cost of an optimal assignment over all translations that bring some target
//! cell onto some agent. An assignment costs up to the cube of the number of agents and there are
//! up to its square of translations, so most translations are settled by lower bounds:
//!
//! 1. Rows and columns apart: an assignment costs at least what the best matching of the rows alone
//!    costs, plus the same for the columns. Along one axis the best matching keeps the order, and its
//!    cost depends on that axis of the translation alone: two small tables give this bound for all.
//! 2. The assignment itself is found from below, by shortest augmenting paths; its dual value never
//!    exceeds the cost, and it is given up as soon as that reaches the best cost known.
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
    let rows = Axis::new(few.iter().map(|cell| cell.i), many.iter().map(|cell| cell.i));
    let columns = Axis::new(few.iter().map(|cell| cell.j), many.iter().map(|cell| cell.j));
    let mut seen = vec![false; rows.len() * columns.len()];
    let mut translations = Vec::with_capacity(seen.len().min(few.len() * many.len()));
    for one in few {
        for other in many {
            let by = Pos::new(other.i - one.i, other.j - one.j);
            let known = &mut seen[rows.index(by.i) * columns.len() + columns.index(by.j)];
            if !*known {
                *known = true;
                translations.push((rows.bound(by.i) + columns.bound(by.j), by));
            }
        }
    }
    translations.sort_unstable_by_key(|&(bound, by)| (bound, by));
    let mut assignment = Assignment::new(few.len(), many.len());
    let mut best = i32::MAX;
    for (bound, by) in translations {
        if bound >= best {
            break;
        }
        if let Some(cost) = assignment.below(best, few, many, by) {
            best = cost;
        }
    }
    best
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

/// The assignment problem of one translation, with its memory kept for the next.
struct Assignment {
    columns: usize,
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
    fn new(rows: usize, columns: usize) -> Self {
        Self {
            columns,
            cost: vec![0; rows * columns],
            row_price: vec![0; rows],
            column_price: vec![0; columns],
            row_of: vec![NONE; columns],
            reach: vec![0; columns],
            from: vec![NONE; columns],
            open: vec![0; columns],
        }
    }

    /// The cost of the best assignment of `few`, moved by `by`, to `many` if it is less than `limit`.
    fn below(&mut self, limit: i32, few: &[Pos], many: &[Pos], by: Pos) -> Option<i32> {
        self.row_of.fill(NONE);
        self.column_price.fill(0);
        let mut unmatched = Vec::new();
        let mut value = 0;
        for (row, a) in few.iter().enumerate() {
            let a = a.plus(by);
            let costs = &mut self.cost[row * self.columns..(row + 1) * self.columns];
            for (cost, b) in costs.iter_mut().zip(many) {
                *cost = (a.i - b.i).abs() + (a.j - b.j).abs();
            }
            let least = *costs.iter().min().expect("not empty");
            self.row_price[row] = least;
            value += least;
            let free = (costs.iter().zip(&self.row_of))
                .position(|(&cost, &taken)| cost == least && taken == NONE);
            match free {
                Some(column) => self.row_of[column] = row,
                None => unmatched.push(row),
            }
        }
        for row in unmatched {
            if value >= limit {
                return None;
            }
            value += self.match_row(row);
        }
        (value < limit).then_some(value)
    }

    /// Matches one more row by a shortest augmenting path; returns by how much the optimum of the
    /// rows matched so far, and with it the dual value, grows.
    fn match_row(&mut self, row: usize) -> i32 {
        self.reach.fill(i32::MAX);
        let mut open = std::mem::take(&mut self.open);
        open.clear();
        open.extend(0..self.columns);
        let mut settled = 0;
        let mut at = row;
        let mut via = NONE;
        let mut length = 0;
        let last = loop {
            let costs = &self.cost[at * self.columns..(at + 1) * self.columns];
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
