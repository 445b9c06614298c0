//! Pursuit: surround the prey, which takes two steps a round toward the least danger.

use super::{Plan, Region, Stage, Terrain, place_ring};
use crate::body::{Board, Body, Kind};
use crate::config::Config;
use crate::grid::BodyId;
use crate::grid::{Direction, Pos};
use crate::names::RuleSet;
use crate::rng::LayoutRng;

/// The order in which the prey tries its steps.
const STEPS: [Direction; 4] = [Direction::Right, Direction::Left, Direction::Down, Direction::Up];

/// Number of rows and columns of the danger window before a cell, and from it on.
const WINDOW: (i32, i32) = (4, 4);

/// A map on which a prey flees: the board itself, or a player's belief of it.
pub trait Ground {
    /// Number of rows.
    fn height(&self) -> i32;
    /// Number of columns.
    fn width(&self) -> i32;
    /// The kind of the body on a cell, which must lie on the map; `None` if it is empty.
    fn kind_at(&self, at: Pos) -> Option<Kind>;

    /// True if the cell lies on the map and nothing lies on it.
    fn is_free(&self, at: Pos) -> bool {
        let on_map = (0..self.height()).contains(&at.i) && (0..self.width()).contains(&at.j);
        on_map && self.kind_at(at).is_none()
    }
}

impl Ground for Board {
    fn height(&self) -> i32 {
        self.grid().height()
    }

    fn width(&self) -> i32 {
        self.grid().width()
    }

    fn kind_at(&self, at: Pos) -> Option<Kind> {
        Self::kind_at(self, at)
    }

    fn is_free(&self, at: Pos) -> bool {
        self.grid().is_free(at)
    }
}

/// True if a prey on this cell is caught.
pub fn is_caught(ground: &impl Ground, prey: Pos) -> bool {
    STEPS.iter().all(|&step| !ground.is_free(prey.toward(step)))
}

/// The cell to which an uncaught prey flees; `None` if it stays.
pub fn flight(ground: &impl Ground, rules: RuleSet, prey: Pos) -> Option<Pos> {
    match rules {
        RuleSet::Paper => safest_of_all(ground, prey),
        RuleSet::Reference => safer_than_left(ground, prey),
    }
}

/// The state of Pursuit beside the board (rules: *Pursuit*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pursuit {
    pub(crate) prey: BodyId,
    /// The layout's generator, which also places new preys.
    pub(crate) rng: LayoutRng,
    /// The cell on which the last round caught a prey. No later round depends on it, so it is not part of the digest.
    pub(crate) caught: Option<Pos>,
}

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let mut rng = LayoutRng::new(config.seed.get());
    place_ring(&mut board);
    let at = first_prey(config, &mut rng);
    let fixed = match config.rules {
        RuleSet::Paper => true,
        RuleSet::Reference => false,
    };
    let prey = board.place(Body::single(Kind::Prey, at, fixed));
    Plan { board, rng, region: region(config), task: Terrain::Pursuit { prey } }
}

/// Number of agents that fit beside the first prey.
pub(super) fn room(config: &Config) -> i64 {
    let prey = first_prey(config, &mut LayoutRng::new(config.seed.get()));
    region(config).area() - i64::from(region(config).contains(prey))
}

/// Draws the cell of the first prey.
fn first_prey(config: &Config, rng: &mut LayoutRng) -> Pos {
    let i = rng.randint(config.height / 2 + 1, config.height - 2);
    let j = rng.randint(config.width / 2 + 1, config.width - 2);
    Pos::new(i, j)
}

/// The cells on which agents are placed.
fn region(config: &Config) -> Region {
    let last = |size: i32| (size / 2).max(5);
    Region { rows: (1, last(config.height)), columns: (1, last(config.width)) }
}

impl Pursuit {
    pub(super) fn update(
        &mut self,
        stage: &Stage<'_>,
        board: &mut Board,
        score: f64,
        sums: &mut DangerSums,
    ) -> f64 {
        let prey = board.body(self.prey).at;
        self.caught = is_caught(board, prey).then_some(prey);
        if self.caught.is_some() {
            self.respawn(board, sums);
            return score + 1.0;
        }
        if let Some(goal) = flight(board, stage.config.rules, prey) {
            board.put(self.prey, goal);
        }
        score
    }

    /// Places a new prey on the first drawn of the least dangerous empty cells, of as many draws as
    /// the map has cells.
    fn respawn(&mut self, board: &mut Board, sums: &mut DangerSums) {
        board.lift(self.prey);
        let (height, width) = (board.grid().height(), board.grid().width());
        sums.count(board);
        let mut best: Option<(f64, Pos)> = None;
        let mut counted = 0;
        while counted < height * width {
            let i = self.rng.randint(1, height - 2);
            let j = self.rng.randint(1, width - 2);
            let cell = Pos::new(i, j);
            if !board.grid().is_free(cell) {
                continue;
            }
            counted += 1;
            let danger = sums.danger(cell);
            if best.is_none_or(|(least, _)| danger < least) {
                best = Some((danger, cell));
            }
        }
        let (_, cell) = best.expect("a map has cells");
        board.put(self.prey, cell);
        board.fix(self.prey);
    }
}

/// The rules `paper`: the first sequence of two steps over empty cells whose end has the least
/// danger.
fn safest_of_all(ground: &impl Ground, from: Pos) -> Option<Pos> {
    let nearby = Nearby::new(ground, from);
    let mut best: Option<(f64, Pos)> = None;
    for first in STEPS {
        let middle = from.toward(first);
        if !ground.is_free(middle) {
            continue;
        }
        for second in STEPS {
            let end = middle.toward(second);
            if ground.is_free(end) {
                let danger = nearby.danger(end);
                if best.is_none_or(|(least, _)| danger < least) {
                    best = Some((danger, end));
                }
            }
        }
    }
    best.map(|(_, end)| end)
}

/// The rules `reference`: the cell that lies one second step away from the start must be empty too,
/// and the end must be less dangerous than the cell left of the prey.
fn safer_than_left(ground: &impl Ground, from: Pos) -> Option<Pos> {
    let nearby = Nearby::new(ground, from);
    let mut least = nearby.danger(from.toward(Direction::Left));
    let mut best = None;
    for first in STEPS {
        let middle = from.toward(first);
        for second in STEPS {
            let end = middle.toward(second);
            let open = [middle, from.toward(second), end];
            if open.iter().all(|&cell| ground.is_free(cell)) {
                let danger = nearby.danger(end);
                if danger < least {
                    least = danger;
                    best = Some(end);
                }
            }
        }
    }
    best
}

/// Agents + walls × 0.9 in the window of a cell. The order of operations is fixed: ties depend on the rounding of
/// doubles.
fn weigh(agents: i32, walls: i32) -> f64 {
    f64::from(agents) + f64::from(walls) * 0.9
}

/// The first and last row (or column) of the danger window around `center`, clipped to the map.
fn window(center: i32, size: i32) -> (i32, i32) {
    ((center - WINDOW.0).max(0), (center + WINDOW.1).min(size))
}

/// The danger of one cell.
pub fn danger(ground: &impl Ground, cell: Pos) -> f64 {
    let (top, bottom) = window(cell.i, ground.height());
    let (left, right) = window(cell.j, ground.width());
    let (mut agents, mut walls) = (0, 0);
    for i in top..bottom {
        for j in left..right {
            match ground.kind_at(Pos::new(i, j)) {
                Some(Kind::Agent) => agents += 1,
                Some(Kind::Wall) => walls += 1,
                Some(Kind::Nest | Kind::Food | Kind::Block | Kind::Prey) | None => {}
            }
        }
    }
    weigh(agents, walls)
}

/// Maximum number of cells that a prey moves in a round.
const STEPS_OF_A_ROUND: i32 = 2;

/// Number of rows and columns on which the danger of the cells depends to which a prey can flee.
const NEARBY: usize = 12;
const _: () = assert!(WINDOW.0 + WINDOW.1 + 2 * STEPS_OF_A_ROUND == 12, "see above");

/// Sums over the cells above and to the left, around a prey: the danger of each cell to which it can flee costs a few
/// operations.
struct Nearby {
    size: Pos,
    /// The top-left cell of the sums.
    corner: Pos,
    /// Numbers of agents and walls; both fit, as there are fewer than 256 cells.
    sums: [[(u8, u8); NEARBY + 1]; NEARBY + 1],
}

impl Nearby {
    fn new(ground: &impl Ground, prey: Pos) -> Self {
        let size = Pos::new(ground.height(), ground.width());
        let first = |at: i32| at - STEPS_OF_A_ROUND - WINDOW.0;
        let corner = Pos::new(first(prey.i), first(prey.j));
        let mut sums = [[(0, 0); NEARBY + 1]; NEARBY + 1];
        for (a, i) in (1..=NEARBY).zip(corner.i..) {
            let (mut agents, mut walls) = (0, 0);
            for (b, j) in (1..=NEARBY).zip(corner.j..) {
                if (0..size.i).contains(&i) && (0..size.j).contains(&j) {
                    match ground.kind_at(Pos::new(i, j)) {
                        Some(Kind::Agent) => agents += 1,
                        Some(Kind::Wall) => walls += 1,
                        Some(Kind::Nest | Kind::Food | Kind::Block | Kind::Prey) | None => {}
                    }
                }
                let above = sums[a - 1][b];
                sums[a][b] = (above.0 + agents, above.1 + walls);
            }
        }
        Self { size, corner, sums }
    }

    /// The danger of a cell to which the prey can flee; equal to [`danger`].
    fn danger(&self, cell: Pos) -> f64 {
        let (top, bottom) = window(cell.i, self.size.i);
        let (left, right) = window(cell.j, self.size.j);
        let place = |at: i32, first: i32| usize::try_from(at - first).expect("near the prey");
        let (top, bottom) = (place(top, self.corner.i), place(bottom, self.corner.i));
        let (left, right) = (place(left, self.corner.j), place(right, self.corner.j));
        let count = |of: fn((u8, u8)) -> u8| {
            let at = |a: usize, b: usize| i32::from(of(self.sums[a][b]));
            at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left)
        };
        weigh(count(|sums| sums.0), count(|sums| sums.1))
    }
}

/// Sums over all cells above and to the left, so that the danger of any cell costs the same few operations: a respawn
/// needs as many as the map has cells.
#[derive(Debug, Default)]
pub(super) struct DangerSums {
    height: i32,
    width: i32,
    /// `(height + 1) × (width + 1)` sums of agents and walls.
    sums: Vec<(i32, i32)>,
}

impl DangerSums {
    /// Sums up the current board.
    fn count(&mut self, board: &Board) {
        let (height, width) = (board.grid().height(), board.grid().width());
        let area = usize::try_from((height + 1) * (width + 1)).expect("a map has a positive size");
        (self.height, self.width) = (height, width);
        self.sums.clear();
        self.sums.resize(area, (0, 0));
        for i in 0..height {
            let (mut agents, mut walls) = (0, 0);
            for j in 0..width {
                match board.kind_at(Pos::new(i, j)) {
                    Some(Kind::Agent) => agents += 1,
                    Some(Kind::Wall) => walls += 1,
                    Some(Kind::Nest | Kind::Food | Kind::Block | Kind::Prey) | None => {}
                }
                let above = self.sums[self.index(i, j + 1)];
                let index = self.index(i + 1, j + 1);
                self.sums[index] = (above.0 + agents, above.1 + walls);
            }
        }
    }

    fn index(&self, i: i32, j: i32) -> usize {
        usize::try_from(i * (self.width + 1) + j).expect("inside the table")
    }

    fn danger(&self, cell: Pos) -> f64 {
        let (top, bottom) = window(cell.i, self.height);
        let (left, right) = window(cell.j, self.width);
        let corner = |i, j| self.sums[self.index(i, j)];
        let (a, b, c, d) =
            (corner(bottom, right), corner(top, right), corner(bottom, left), corner(top, left));
        weigh(a.0 - b.0 - c.0 + d.0, a.1 - b.1 - c.1 + d.1)
    }
}
