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
//!    |Δi + Δj| and |Δi − Δj|. See `lines.rs`.
//! 2. The prices with which an assignment ends bound the cost of every other translation, too, and
//!    those of its neighbours closely. See `field.rs`.
//! 3. The assignment itself is found from below, by shortest augmenting paths; its dual value never
//!    exceeds the cost, and it is given up as soon as that reaches the best cost known. It begins
//!    with the prices that bound this translation best. See `assignment.rs`.
//!
//! The translation with the least bound is tried next, until no bound is below the best cost known.
//! From round to round agents move by a cell: the best translation of the last round, its prices and
//! its pairs are tried first.

use super::assignment::{Assignment, Start};
use super::cells::{ALONG, Cells, Shape, Step};
use super::field::Field;
use super::lines::Line;
use crate::grid::Pos;

/// The least total of rows and columns by which agents and target cells, matched one to one, are
/// apart under the best translation. Where there are more of one than of the other, only the fewer
/// need a partner. Neither may be empty.
///
/// # Panics
/// Where one of them is empty, or spreads over 512 rows or columns.
#[must_use]
pub fn distance(agents: &[Pos], target: &[Pos]) -> i32 {
    // The roles can be exchanged: a translation of the one is the opposite one of the other.
    let (few, many) = if agents.len() < target.len() { (agents, target) } else { (target, agents) };
    Search::default().least(&Shape::new(few), many, &mut Known::default())
}

/// How much [`distance`] has to do: how often it compares a target cell with all agents (or an agent with all target
/// cells). On every machine the same; time is about in proportion.
///
/// # Panics
/// As [`distance`].
#[must_use]
pub fn effort(agents: &[Pos], target: &[Pos]) -> usize {
    let mut search = Search::default();
    search.least(&Shape::new(target), agents, &mut Known::default());
    search.assignment.looks
}

/// What a search leaves for the next one: where the best assignment was found, and with which prices and pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Known {
    by: Option<(i32, i32)>,
    start: Start,
}

/// With so few translations left, each is tried without bounding it again.
const FEW: usize = 2;

/// Prices that are kept during a search; the oldest make room.
const STARTS_MAX: usize = 1024;

/// A translation that may be the best.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    bound: i32,
    by: Step,
    /// The prices that gave the bound.
    start: usize,
}

/// A search, with its memory kept for the next.
#[derive(Debug, Default)]
pub(crate) struct Search {
    many: Cells,
    occupied: Vec<bool>,
    /// Rows, columns and both diagonals.
    lines: [Line; 4],
    candidates: Vec<Candidate>,
    field: Field,
    starts: Vec<Start>,
    assignment: Assignment,
}

impl Search {
    /// See [`distance`]. `known` is from an earlier search of the same number of cells, and is replaced. The cost does
    /// not depend on it.
    pub(super) fn least(&mut self, few: &Shape, many: &[Pos], known: &mut Known) -> i32 {
        self.set(many);
        let corner =
            (self.many.corner.0 - few.cells.corner.0, self.many.corner.1 - few.cells.corner.1);
        self.assignment.begin(&few.cells, &self.many, &known.start);
        let mut best = i32::MAX;
        let near = known.by.and_then(|by| self.near(few, (by.0 - corner.0, by.1 - corner.1)));
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
        if near.is_some() {
            self.tighten(few, best, tries);
            tries += 1;
        }
        while let Some(candidate) = self.take_least() {
            if !brings_some_onto(&self.occupied, self.many.last, few, candidate.by) {
                continue;
            }
            if let Some(start) = self.starts.get(candidate.start) {
                self.assignment.restore(start);
            }
            if let Some(cost) = self.assignment.below(best, candidate.by) {
                best = cost;
                found(&self.assignment, candidate.by);
            }
            self.candidates.retain(|candidate| candidate.bound < best);
            self.tighten(few, best, tries);
            tries += 1;
        }
        best
    }

    fn set(&mut self, many: &[Pos]) {
        self.many.set(many);
        let width = usize::from(self.many.last.1.unsigned_abs()) + 1;
        let height = usize::from(self.many.last.0.unsigned_abs()) + 1;
        self.occupied.clear();
        self.occupied.resize(height * width, false);
        for &(i, j) in &self.many.all {
            let (i, j) = (usize::from(i.unsigned_abs()), usize::from(j.unsigned_abs()));
            self.occupied[i * width + j] = true;
        }
    }

    /// The translation if it brings some of the few onto some of the many.
    fn near(&self, few: &Shape, by: (i32, i32)) -> Option<Step> {
        let by = (i16::try_from(by.0).ok()?, i16::try_from(by.1).ok()?);
        brings_some_onto(&self.occupied, self.many.last, few, by).then_some(by)
    }

    /// All translations whose lower bound from lines is less than `limit`, among them some that bring none
    /// of the few onto one of the many.
    fn find_candidates(&mut self, few: &Shape, limit: i32) {
        let Self { many, lines, candidates, .. } = self;
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
            candidates.extend(columns.map(|(j, across)| Candidate {
                bound: down + across,
                by: (step(i), step(j)),
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
            // Without a bound it brings none of the few onto one of the many.
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

    /// Bounds all candidates by the prices of the assignment as they are now; leaves those that are still less than
    /// `limit`.
    fn tighten(&mut self, few: &Shape, limit: i32, tries: usize) {
        let Self { many, candidates, field, starts, assignment, .. } = self;
        if candidates.len() <= FEW {
            return;
        }
        let ends = candidates.iter().fold(
            ((i16::MAX, i16::MAX), (i16::MIN, i16::MIN)),
            |(first, last), &Candidate { by, .. }| {
                ((first.0.min(by.0), first.1.min(by.1)), (last.0.max(by.0), last.1.max(by.1)))
            },
        );
        field.draw(few, many, assignment.prices(), ends);
        let place = tries % STARTS_MAX;
        candidates.retain_mut(|candidate| {
            let bound = field.bound(few, candidate.by);
            if bound > candidate.bound {
                (candidate.bound, candidate.start) = (bound, place);
            }
            candidate.bound < limit
        });
        if starts.len() <= place {
            starts.resize_with(place + 1, Start::default);
        }
        assignment.save(&mut starts[place]);
    }
}

fn brings_some_onto(occupied: &[bool], last: Step, few: &Shape, by: Step) -> bool {
    let width = usize::from(last.1.unsigned_abs()) + 1;
    few.cells.all.iter().any(|cell| {
        let (i, j) = (cell.0 + by.0, cell.1 + by.1);
        let is_inside = (0..=last.0).contains(&i) && (0..=last.1).contains(&j);
        is_inside && occupied[usize::from(i.unsigned_abs()) * width + usize::from(j.unsigned_abs())]
    })
}
