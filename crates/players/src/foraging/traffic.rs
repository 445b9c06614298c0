//! The moves of agents in view of each other: all agents compute the same.

use swarmbench_engine::{Direction, Pos};

use super::layout::{Lane, Layout};

/// Reach of roads from the agent in their middle, in rows and columns.
const REACH: i32 = 8;

/// Distance from the middle beyond which an agent needs new roads, in rows and columns.
const DRIFT: i32 = 4;

/// Cost of a step. The other costs only break ties between equally good steps.
const STEP: i32 = 16;
/// Cost of each row (or column) beside the lane.
const ASIDE: i32 = 6;
/// Cost of waiting.
const STAY: i32 = 2;
/// Cost of entering the cell of an agent of the other kind, which comes toward this one.
const ONCOMING: i32 = 4;

/// An empty cell.
const NOBODY: usize = usize::MAX;

/// The part of a map around an agent. Cells are identified by their index here.
#[derive(Clone)]
pub(super) struct Roads {
    middle: Pos,
    origin: Pos,
    height: i32,
    width: i32,
    /// Cells on which an agent can stand; false on the rim.
    open: Vec<bool>,
    /// The cost of the way to the next delivery, by load and cell.
    costs: [Vec<i32>; 2],
    /// The least number of steps to the next delivery, by load and cell.
    steps: [Vec<i32>; 2],
}

impl Roads {
    /// The roads around an agent.
    pub(super) fn new(layout: &Layout, middle: Pos) -> Self {
        let size = layout.size();
        let first = |middle: i32, size: i32| (middle - REACH).min(size - 2 * REACH - 1).max(0);
        let origin = Pos::new(first(middle.i, size.i), first(middle.j, size.j));
        let (height, width) = (size.i.min(2 * REACH + 1), size.j.min(2 * REACH + 1));
        let on_rim = |n: i32| n % width % (width - 1) == 0 || n / width % (height - 1) == 0;
        let cells: Vec<Pos> =
            (0..height * width).map(|n| origin.plus(Pos::new(n / width, n % width))).collect();
        let is_open = |(cell, n): (&Pos, i32)| !on_rim(n) && layout.is_open(*cell);
        let open: Vec<bool> = cells.iter().zip(0..).map(is_open).collect();
        let each = |loaded, of: fn(&Way, Pos) -> i32| {
            let way = Way::new(*layout, loaded);
            let of = |(cell, &open): (&Pos, &bool)| if open { of(&way, *cell) } else { 0 };
            cells.iter().zip(&open).map(of).collect()
        };
        let costs = [false, true].map(|loaded| each(loaded, Way::cost));
        let steps =
            [false, true].map(|loaded| each(loaded, |way, from| way.steps(from, Lane::Both)));
        Self { middle, origin, height, width, open, costs, steps }
    }

    /// True if the roads still reach far enough around an agent.
    pub(super) const fn reach(&self, here: Pos) -> bool {
        here.is_within(DRIFT, self.middle)
    }

    /// The index of a cell on which an agent can stand; `None` for other cells.
    pub(super) fn cell(&self, at: Pos) -> Option<usize> {
        let (i, j) = (at.i - self.origin.i, at.j - self.origin.j);
        let inside = (0..self.height).contains(&i) && (0..self.width).contains(&j);
        let cell = usize::try_from(i * self.width + j).ok().filter(|_| inside)?;
        self.open[cell].then_some(cell)
    }

    /// The open cell in a direction of an open one.
    pub(super) fn toward(&self, cell: usize, side: Direction) -> Option<usize> {
        let row = usize::try_from(self.width).expect("roads have a width");
        // An open cell does not lie on the rim, so it has four neighbours.
        let next = match side {
            Direction::Up => cell - row,
            Direction::Down => cell + row,
            Direction::Left => cell - 1,
            Direction::Right => cell + 1,
        };
        self.open[next].then_some(next)
    }

    /// The cost of the way from a cell to the next delivery.
    fn cost(&self, cell: usize, loaded: bool) -> i32 {
        self.costs[usize::from(loaded)][cell]
    }
}

/// The goals of loaded agents, or of empty ones.
struct Way {
    layout: Layout,
    loaded: bool,
    /// The cells at which the load changes, with the number of steps from there to where it changes again.
    goals: Vec<(Pos, i32)>,
    /// The steps of the way back, which do not count toward a delivery.
    back: i32,
}

impl Way {
    fn new(layout: Layout, loaded: bool) -> Self {
        let (near, far) =
            if loaded { (layout.nest, layout.food) } else { (layout.food, layout.nest) };
        let then = layout.beside(far);
        let onward = |goal: Pos| {
            let steps = then.iter().map(|&next| layout.apart(goal, next, Lane::Both));
            (goal, steps.min().unwrap_or(0))
        };
        let goals: Vec<_> = layout.beside(near).into_iter().map(onward).collect();
        let back = goals.iter().map(|&(_, onward)| onward).min().unwrap_or(0);
        Self { layout, loaded, goals, back: if loaded { back } else { 0 } }
    }

    /// The number of steps from a cell to the next delivery.
    fn steps(&self, from: Pos, lane: Lane) -> i32 {
        let steps = |&(goal, onward): &(Pos, i32)| self.layout.apart(from, goal, lane) + onward;
        self.goals.iter().map(steps).min().unwrap_or(0) - self.back
    }

    fn cost(&self, from: Pos) -> i32 {
        let lane = self.layout.lane_of(self.loaded);
        STEP * self.steps(from, lane) + ASIDE * self.layout.aside(from, lane)
    }
}

/// An agent on the roads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walker {
    pub(super) number: u16,
    pub(super) at: usize,
    pub(super) loaded: bool,
    /// True for an agent that only makes room for others.
    pub(super) idle: bool,
}

/// Agents on roads, and their decisions, made one after another.
///
/// The one with the highest priority takes the best cell. The agent that stands there decides next, and so on; if an
/// agent down the line cannot make room, the one before it takes its second choice. Known as priority inheritance with
/// backtracking (Okumura et al., 2019).
pub(super) struct Traffic<'a> {
    roads: &'a Roads,
    walkers: &'a [Walker],
    /// The index of the walker on a cell now, and after this round, by cell.
    now: Vec<usize>,
    next: Vec<usize>,
    /// The cell that a walker decided to go to or stay on, by walker.
    decided: Vec<Option<usize>>,
}

impl<'a> Traffic<'a> {
    /// Walkers that have not yet decided. No two may be on one cell.
    pub(super) fn new(roads: &'a Roads, walkers: &'a [Walker]) -> Self {
        let mut now = vec![NOBODY; roads.open.len()];
        for (place, walker) in walkers.iter().enumerate() {
            now[walker.at] = place;
        }
        let next = vec![NOBODY; roads.open.len()];
        Self { roads, walkers, now, next, decided: vec![None; walkers.len()] }
    }

    /// The step of the first walker with `left` rounds left. Loaded agents have priority, then those nearest to their
    /// goal, then those that can no longer deliver in time, and last those that only make room.
    pub(super) fn decide(mut self, left: i32, turn: usize) -> Option<Direction> {
        let priority = |&place: &usize| {
            let walker = &self.walkers[place];
            let steps = self.roads.steps[usize::from(walker.loaded)][walker.at];
            (walker.idle, steps > left, !walker.loaded, steps, walker.number)
        };
        let mut order: Vec<usize> = (0..self.walkers.len()).collect();
        order.sort_by_key(priority);
        for place in order {
            if self.decided[place].is_none() {
                self.send(place, None, turn);
            }
        }
        let (at, to) = (self.walkers.first()?.at, self.decided.first().copied()??);
        Direction::ALL.into_iter().find(|&side| self.roads.toward(at, side) == Some(to))
    }

    pub(super) fn is_taken(&self, cell: usize) -> bool {
        self.now[cell] != NOBODY
    }

    /// Decides for a walker that has to leave its cell to one that comes from `from`. Returns whether
    /// it leaves or may stay.
    fn send(&mut self, place: usize, from: Option<usize>, turn: usize) -> bool {
        let at = self.walkers[place].at;
        // A provisional decision: an agent whose decision is pending is not asked again.
        self.decided[place] = Some(at);
        for to in self.options(place, turn) {
            if self.next[to] != NOBODY || from == Some(to) {
                continue;
            }
            self.next[to] = place;
            let there = self.now[to];
            if there != NOBODY && there != place {
                if let Some(goes) = self.decided[there] {
                    // Two agents cannot swap places.
                    if goes == at {
                        self.next[to] = NOBODY;
                        continue;
                    }
                } else if !self.send(there, Some(at), turn) {
                    continue;
                }
            }
            self.decided[place] = Some(to);
            return true;
        }
        self.next[at] = place;
        false
    }

    /// The cells to which a walker can go, best first.
    fn options(&self, place: usize, turn: usize) -> Vec<usize> {
        let Walker { at, loaded, idle, .. } = self.walkers[place];
        let mut sides = Direction::ALL;
        sides.rotate_left(turn % 4);
        let steps = sides.into_iter().filter_map(|side| self.roads.toward(at, side));
        let mut options: Vec<_> = steps.chain([at]).collect();
        options.sort_by_key(|&to| {
            if idle {
                // An idle walker stays or enters an empty cell.
                return i32::from(to != at) + i32::from(self.is_taken(to) && to != at);
            }
            let more = match self.walkers.get(self.now[to]) {
                _ if to == at => STAY,
                Some(other) if other.loaded != loaded => ONCOMING,
                _ => 0,
            };
            self.roads.cost(to, loaded) + more
        });
        options
    }
}
