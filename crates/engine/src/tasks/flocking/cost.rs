//! The cost of a placement in Flocking: exact, by bound and prune.
//!
//! The cost is the least cost of an optimal assignment over all translations that bring some target cell onto some
//! agent. An assignment costs up to the cube of the number of agents and there are up to its square of translations, so
//! most translations are settled by lower bounds:
//!
//! 1. The best matching along a line keeps the order, so its cost is quickly found; and it depends on one coordinate of
//!    the translation alone, so a small table has it for all translations. An assignment costs at least what rows and
//!    columns cost together, each matched on their own. It also costs at least what each of the two diagonals costs,
//!    since |Δi| + |Δj| is the greater of |Δi + Δj| and |Δi − Δj|. See `lines.rs`.
//!    |Δi + Δj| and |Δi − Δj|. See `lines.rs`.
//! 2. The prices with which an assignment ends also bound the cost of every other translation, those of its neighbours
//!    closely, most others hardly. See `field.rs`.
//! 3. The assignment itself is found from below, by shortest augmenting paths; its dual value never exceeds the cost,
//!    and the search stops as soon as it reaches the best cost known. It begins with the prices that bound this
//!    translation best. See `assignment.rs`.
//!
//! The next translation to try is the one with the least bound among those that bring some cells together (see
//! `meetings.rs`), until no bound is below the best cost known. Agents move by at most a cell from round to round, so
//! the best translation of the last round, its prices and its pairs are tried first.

use super::assignment::{Assignment, Start};
use super::cells::{ALONG, Cells, Shape, Step};
use super::field::Field;
use super::lines::Line;
use super::meetings::Meetings;
use crate::grid::Pos;

/// The least total of rows and columns by which agents and target cells, matched one to one, are apart under the best
/// translation. If their numbers differ, only the fewer need a partner. Neither may be empty.
///
/// # Panics
/// Panics if one of them is empty, or spreads over 512 rows or columns.
#[must_use]
pub fn distance(agents: &[Pos], target: &[Pos]) -> i32 {
    // The roles can be exchanged: a translation of the one is the opposite one of the other.
    let (few, many) = if agents.len() < target.len() { (agents, target) } else { (target, agents) };
    Search::default().least(&Shape::new(few), many, &mut Known::default())
}

/// The result of a search that the next one starts from: the translation of the best assignment, its prices and pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Known {
    by: Option<(i32, i32)>,
    start: Start,
}

/// Number of remaining translations up to which each is tried without bounding it again.
const FEW: usize = 2;

/// Distance in rows and columns within which prices found for one translation bound others. Only the first [`FIRST`]
/// prices of a search are tried on all translations.
const NEAR: u16 = 8;
const FIRST: usize = 32;

/// Maximum number of prices kept during a search; the oldest are replaced.
const STARTS_MAX: usize = 1024;

/// A translation that may be the best.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    bound: i32,
    by: Step,
    /// The best bound by prices, and the index of these prices in `starts`.
    by_prices: i32,
    start: usize,
}

/// A search, with memory that the next one reuses.
#[derive(Debug, Default)]
pub(crate) struct Search {
    many: Cells,
    meetings: Meetings,
    /// Rows, columns and both diagonals.
    lines: [Line; 4],
    candidates: Vec<Candidate>,
    field: Field,
    starts: Vec<Start>,
    assignment: Assignment,
}

impl Search {
    /// Computes [`distance`]. `known` is from an earlier search of the same number of cells, and is replaced. The cost
    /// does not depend on it.
    pub(super) fn least(&mut self, few: &Shape, many: &[Pos], known: &mut Known) -> i32 {
        self.many.set(many);
        self.meetings.set(&few.cells, &self.many);
        let corner =
            (self.many.corner.0 - few.cells.corner.0, self.many.corner.1 - few.cells.corner.1);
        self.assignment.begin(&few.cells, &self.many, &known.start);
        let mut best = i32::MAX;
        let near = known.by.and_then(|by| self.meetings.near((by.0 - corner.0, by.1 - corner.1)));
        let mut found = |assignment: &Assignment, by: Step| {
            known.by = Some((corner.0 + i32::from(by.0), corner.1 + i32::from(by.1)));
            assignment.save(&mut known.start);
        };
        if let Some(by) = near
            && let Some(cost) = self.assignment.below(best, by)
        {
            best = cost;
            found(&self.assignment, by);
        }
        self.find_candidates(few, best);
        let mut tries = 0;
        if let Some(by) = near {
            self.tighten(few, best, tries, by);
            tries += 1;
        }
        while let Some(candidate) = self.take_least() {
            if let Some(start) = self.starts.get(candidate.start) {
                self.assignment.restore(start);
            }
            if let Some(cost) = self.assignment.below(best, candidate.by) {
                best = cost;
                found(&self.assignment, candidate.by);
            }
            self.candidates.retain(|candidate| candidate.bound < best);
            self.tighten(few, best, tries, candidate.by);
            tries += 1;
        }
        best
    }

    /// All translations whose lower bound from lines is less than `limit`.
    fn find_candidates(&mut self, few: &Shape, limit: i32) {
        let Self { many, meetings, lines, candidates, .. } = self;
        let set = |line: &mut Line, number: usize| {
            let along = ALONG[number];
            let places = many.all.iter().map(|&(i, j)| along(i.into(), j.into()));
            line.set(&few.along[number], places);
        };
        let [rows, columns, falling, rising] = lines;
        set(rows, 0);
        set(columns, 1);
        candidates.clear();
        let least = columns.least();
        if rows.least() + least >= limit {
            return;
        }
        let step = |by: i32| i16::try_from(by).expect("a small number");
        for (i, down) in rows.bounds().filter(|(_, down)| down + least < limit) {
            let columns = columns.bounds().filter(|(_, across)| down + across < limit);
            let all = columns.map(|(j, across)| (down + across, (step(i), step(j))));
            let all = all.filter(|&(_, by)| meetings.has(by));
            candidates.extend(all.map(|(bound, by)| Candidate {
                bound,
                by,
                by_prices: i32::MIN,
                start: usize::MAX,
            }));
        }
        if candidates.len() <= FEW {
            return;
        }
        set(falling, 2);
        set(rising, 3);
        candidates.retain_mut(|Candidate { bound, by: (i, j), .. }| {
            let (i, j) = (i32::from(*i), i32::from(*j));
            // A translation without a bound brings none of the few onto one of the many.
            let Some(diagonal) = falling.bound(i + j).zip(rising.bound(i - j)) else {
                return false;
            };
            *bound = diagonal.0.max(diagonal.1).max(*bound);
            *bound < limit
        });
    }

    fn take_least(&mut self) -> Option<Candidate> {
        let candidates = self.candidates.iter().enumerate();
        let (place, _) = candidates.min_by_key(|(_, candidate)| (candidate.bound, candidate.by))?;
        Some(self.candidates.swap_remove(place))
    }

    /// Bounds candidates by the current prices of the assignment, which were found for the translation `at`; keeps
    /// those whose bound is still less than `limit`.
    fn tighten(&mut self, few: &Shape, limit: i32, tries: usize, at: Step) {
        let Self { many, candidates, field, starts, assignment, .. } = self;
        if candidates.len() <= FEW {
            return;
        }
        let is_near =
            |by: Step| tries < FIRST || by.0.abs_diff(at.0).max(by.1.abs_diff(at.1)) <= NEAR;
        let near = candidates.iter().map(|candidate| candidate.by).filter(|&by| is_near(by));
        let ends = near.fold(None, |ends, by| {
            let (first, last): (Step, Step) = ends.unwrap_or((by, by));
            Some(((first.0.min(by.0), first.1.min(by.1)), (last.0.max(by.0), last.1.max(by.1))))
        });
        let Some(ends) = ends else { return };
        field.draw(few, many, assignment.prices(), ends);
        let place = tries % STARTS_MAX;
        candidates.retain_mut(|candidate| {
            if !is_near(candidate.by) {
                return true;
            }
            let bound = field.bound(few, candidate.by);
            candidate.bound = candidate.bound.max(bound);
            if bound > candidate.by_prices {
                (candidate.by_prices, candidate.start) = (bound, place);
            }
            candidate.bound < limit
        });
        if starts.len() <= place {
            starts.resize_with(place + 1, Start::default);
        }
        assignment.save(&mut starts[place]);
    }
}
