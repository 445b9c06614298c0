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

/// How many rows and columns of the danger window lie before a cell, and how many from it on.
const WINDOW: (i32, i32) = (4, 4);

/// A map on which a prey flees: the board itself, or a player's belief of it.
pub trait Ground {
    /// Rows.
    fn height(&self) -> i32;
    /// Columns.
    fn width(&self) -> i32;
    /// What lies on a cell of the map; only cells of the map are asked for.
    fn kind_at(&self, at: Pos) -> Option<Kind>;

    /// Whether the cell lies on the map and nothing lies on it.
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

/// Whether a prey on this cell is caught.
pub fn is_caught(ground: &impl Ground, prey: Pos) -> bool {
    STEPS.iter().all(|&step| !ground.is_free(prey.toward(step)))
}

/// The cell to which a prey flees that was not caught; `None` if it stays.
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

/// How many agents fit beside the first prey.
pub(super) fn room(config: &Config) -> i64 {
    let prey = first_prey(config, &mut LayoutRng::new(config.seed.get()));
    region(config).area() - i64::from(region(config).contains(prey))
}

/// Where the first prey is drawn.
fn first_prey(config: &Config, rng: &mut LayoutRng) -> Pos {
    let i = rng.randint(config.height / 2 + 1, config.height - 2);
    let j = rng.randint(config.width / 2 + 1, config.width - 2);
    Pos::new(i, j)
}

/// Where agents are placed.
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
        if is_caught(board, prey) {
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
    let mut best: Option<(f64, Pos)> = None;
    for first in STEPS {
        let middle = from.toward(first);
        if !ground.is_free(middle) {
            continue;
        }
        for second in STEPS {
            let end = middle.toward(second);
            if ground.is_free(end) {
                let danger = danger(ground, end);
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
    let mut least = danger(ground, from.toward(Direction::Left));
    let mut best = None;
    for first in STEPS {
        let middle = from.toward(first);
        for second in STEPS {
            let end = middle.toward(second);
            let open = [middle, from.toward(second), end];
            if open.iter().all(|&cell| ground.is_free(cell)) {
                let danger = danger(ground, end);
                if danger < least {
                    least = danger;
                    best = Some(end);
                }
            }
        }
    }
    best
}

/// Agents + walls × 0.9 in the window of a cell, in doubles exactly so: ties follow from it.
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

/// Sums over all cells above and to the left, so that the danger of any cell costs the same few
/// operations: a respawn asks for as many as the map has cells.
#[derive(Debug, Default)]
pub(super) struct DangerSums {
    height: i32,
    width: i32,
    /// `(height + 1) × (width + 1)` sums of agents and walls.
    sums: Vec<(i32, i32)>,
}

impl DangerSums {
    /// Sums up the board as it is now.
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
