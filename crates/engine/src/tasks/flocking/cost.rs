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
    Search::default().least(agents, target, None).cost
}

/// The outcome of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Least {
    pub(super) cost: i32,
    /// A translation that has this cost: of the fewer onto the more.
    pub(super) by: Pos,
}

/// A search, with its memory kept for the next.
#[derive(Debug, Default)]
pub(crate) struct Search {
    rows: Axis,
    columns: Axis,
    falling: Axis,
    rising: Axis,
    seen: Vec<bool>,
    candidates: Vec<(i32, Pos)>,
    assignment: Assignment,
}

impl Search {
    /// See [`distance`]. `near` is a translation that is tried first: where it is good, most others are settled by
    /// their bounds. The cost does not depend on it.
    pub(super) fn least(&mut self, agents: &[Pos], target: &[Pos], near: Option<Pos>) -> Least {
        // The roles can be exchanged: a translation of the one is the opposite one of the other.
        let (few, many) =
            if agents.len() < target.len() { (agents, target) } else { (target, agents) };
        self.assignment.begin(many.len());
        let mut best = Least { cost: i32::MAX, by: Pos::new(0, 0) };
        if let Some(by) = near
            && let Some(cost) = self.assignment.below(best.cost, few, many, by)
        {
            best = Least { cost, by };
        }
        self.find_candidates(few, many, best.cost);
        for &(bound, by) in &self.candidates {
            if bound >= best.cost {
                break;
            }
            if let Some(cost) = self.assignment.below(best.cost, few, many, by) {
                best = Least { cost, by };
            }
        }
        best
    }

    /// All translations of `few` that bring one of them onto one of `many` and whose lower bound is less than `limit`,
    /// each once, by that bound.
    fn find_candidates(&mut self, few: &[Pos], many: &[Pos], limit: i32) {
        let Self { rows, columns, falling, rising, seen, candidates, .. } = self;
        rows.set(few, many, |cell| cell.i);
        columns.set(few, many, |cell| cell.j);
        falling.set(few, many, |cell| cell.i + cell.j);
        rising.set(few, many, |cell| cell.i - cell.j);
        seen.clear();
        seen.resize(rows.len() * columns.len(), false);
        candidates.clear();
        for one in few {
            for other in many {
                let by = Pos::new(other.i - one.i, other.j - one.j);
                let known = &mut seen[rows.index(by.i) * columns.len() + columns.index(by.j)];
                if std::mem::replace(known, true) {
                    continue;
                }
                let apart = rows.bound(by.i) + columns.bound(by.j);
                let across = falling.bound(by.i + by.j).max(rising.bound(by.i - by.j));
                let bound = apart.max(across);
                if bound < limit {
                    candidates.push((bound, by));
                }
            }
        }
        candidates.sort_unstable_by_key(|&(bound, by)| (bound, by));
    }
}

/// Lower bounds along one axis, for every translation along it.
#[derive(Debug, Default)]
struct Axis {
    first: i32,
    bounds: Vec<i32>,
    few: Vec<i32>,
    many: Vec<i32>,
    costs: Vec<i32>,
}

impl Axis {
    fn set(&mut self, few: &[Pos], many: &[Pos], coordinate: fn(&Pos) -> i32) {
        let Self { first, bounds, few: from, many: to, costs } = self;
        for (values, cells) in [(&mut *from, few), (&mut *to, many)] {
            values.clear();
            values.extend(cells.iter().map(coordinate));
            values.sort_unstable();
        }
        *first = to[0] - from[from.len() - 1];
        let last = to[to.len() - 1] - from[0];
        bounds.clear();
        bounds.extend((*first..=last).map(|by| matching(from, to, by, costs)));
    }

    const fn len(&self) -> usize {
        self.bounds.len()
    }

    fn index(&self, by: i32) -> usize {
        usize::try_from(by - self.first).expect("a difference of two of the points")
    }

    fn bound(&self, by: i32) -> i32 {
        self.bounds[self.index(by)]
    }
}

/// The cheapest matching of all the `few` points, moved by `by`, to some of the `many`, on a line;
/// both sorted. The best matching keeps the order, so with `spare` points more on one side, point k
/// goes to one of the points k to k + spare.
fn matching(few: &[i32], many: &[i32], by: i32, costs: &mut Vec<i32>) -> i32 {
    let spare = many.len() - few.len();
    if spare == 0 {
        return few.iter().zip(many).map(|(a, b)| (a + by - b).abs()).sum();
    }
    // `costs[s]`: the points so far are matched and at most s of the many were passed over.
    costs.clear();
    costs.resize(spare + 1, 0);
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
#[derive(Debug, Default)]
struct Assignment {
    size: usize,
    cost: Vec<i32>,
    row_price: Vec<i32>,
    column_price: Vec<i32>,
    row_of: Vec<usize>,
    reach: Vec<i32>,
    from: Vec<usize>,
    open: Vec<usize>,
    unmatched: Vec<usize>,
}

const NONE: usize = usize::MAX;

impl Assignment {
    /// Forgets all prices: what is found depends on nothing that was asked before.
    fn begin(&mut self, size: usize) {
        self.size = size;
        for costs in [&mut self.cost, &mut self.row_price, &mut self.column_price, &mut self.reach]
        {
            costs.clear();
        }
        self.cost.resize(size * size, 0);
        self.row_price.resize(size, 0);
        self.column_price.resize(size, 0);
        self.reach.resize(size, 0);
        self.row_of.resize(size, NONE);
        self.from.resize(size, NONE);
    }

    /// The cost of the best assignment of `few`, moved by `by`, to `many` if it is less than `limit`.
    fn below(&mut self, limit: i32, few: &[Pos], many: &[Pos], by: Pos) -> Option<i32> {
        let mut value = self.price(few, many, by);
        if value >= limit {
            return None;
        }
        self.match_at_once();
        for place in 0..self.unmatched.len() {
            value += self.match_row(self.unmatched[place]);
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

    /// Matches rows to free columns whose price fits as it is; the rows that find none are `unmatched`.
    fn match_at_once(&mut self) {
        self.row_of.fill(NONE);
        self.unmatched.clear();
        for (row, price) in self.row_price.iter().enumerate() {
            let costs = &self.cost[row * self.size..(row + 1) * self.size];
            let fits = (costs.iter().zip(&self.column_price).zip(&self.row_of))
                .position(|((cost, other), &taken)| cost - other == *price && taken == NONE);
            match fits {
                Some(column) => self.row_of[column] = row,
                None => self.unmatched.push(row),
            }
        }
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
