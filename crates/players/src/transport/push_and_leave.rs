//! Transport by pushing in lanes.
//!
//! The block always lies the same way up to turning and mirroring: its foot stands in the gap of the
//! wall, the rest of it is caught behind the end of the gap. It has to go one cell along the open side,
//! toward the corner, and then straight out. Drawn with the open side below and the corner to the
//! right:
//!
//! ```text
//! W . . . . B B B . W
//! W . . . . B B B . W
//! W . . . . B B B . W
//! W W W W W W B B B B
//! ```
//!
//! Each push needs five agents behind the block, side by side or behind each other.

use swarmbench_engine::{Act, Action, Direction, Message, Observation, Pos, Seen, View};

use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::talk::heard;
use crate::{Player, Seat};

/// How many steps of detour one agent in the way is worth.
const CROWD: u32 = 1;

/// How many pushes it takes until nothing of the block is left on the map.
const PUSHES: i32 = 5;

/// Finds out by what it saw and heard where the gap is, then lines up behind the block and pushes.
struct PushAndLeave {
    chance: Chance,
    chart: Chart,
    seat: Seat,
    /// Every exit that may be the true one.
    exits: Vec<Exit>,
    /// Whether the block was pushed along the open side, so that now the way out is free.
    freed: bool,
}

/// Where the gap is.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Exit {
    /// The corner of the map in which the gap ends.
    corner: Pos,
    /// The way out through the gap.
    out: Direction,
    /// The way along the open side toward the corner.
    along: Direction,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let (chance, chart) = (Chance::new(seat), Chart::new(seat));
    Box::new(PushAndLeave {
        chance,
        chart,
        seat: seat.clone(),
        exits: Exit::all(seat),
        freed: false,
    })
}

impl Player for PushAndLeave {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        self.listen(observation);
        self.exclude(observation);
        let order = self.chance.order();
        let [exit] = self.exits[..] else {
            let unknown = |cell| self.chart.is_unknown(cell);
            let step = self.chart.way(here, order, CROWD, unknown).unwrap_or(order[0]);
            return Act::of(push(step));
        };
        let (corner, (i, j)) = (exit.corner, exit.out.offset());
        let freed = i32::from(self.freed);
        let news = format!("Gap at {} {} facing {i} {j} freed {freed}", corner.i, corner.j);
        let action = self.work(here, exit, order);
        Act { action: Some(action), message: Message::new(&news), to: None }
    }
}

impl PushAndLeave {
    /// Believes whoever knows the exit, unless it was excluded.
    fn listen(&mut self, observation: &Observation) {
        for [corner_i, corner_j, out_i, out_j, freed] in heard(observation, "Gap at") {
            let told = (Pos::new(corner_i, corner_j), (out_i, out_j));
            let is_told = |exit: &Exit| (exit.corner, exit.out.offset()) == told;
            if self.exits.iter().any(is_told) {
                self.exits.retain(is_told);
                self.freed |= freed == 1;
            }
        }
    }

    /// Drops every exit that what is in view contradicts. Where none is left, somebody was wrong.
    fn exclude(&mut self, observation: &Observation) {
        let Some(view) = &observation.view else { return };
        let chart = &self.chart;
        let before_all = |exit: &Exit| exit.explains(view, 0, chart);
        let explains = |exit: &Exit| (0..=PUSHES).any(|pushes| exit.explains(view, pushes, chart));
        self.exits.retain(explains);
        if self.exits.is_empty() {
            self.exits = Exit::all(&self.seat);
        }
        match self.exits[..] {
            [exit] => self.freed |= !before_all(&exit),
            _ => self.freed = false,
        }
    }

    /// Pushes where it is in a lane, which ends at the block and later leads out, and otherwise walks
    /// to one. A full lane shuts the next one off: whoever is in the way is pushed on into it.
    fn work(&self, here: Pos, exit: Exit, order: [Direction; 4]) -> Action {
        let chart = &self.chart;
        let is_lane = |cell: Pos| match exit.place(cell) {
            (_, far) if self.freed => (1..=3).contains(&far),
            (deep, far) => (1..=3).contains(&deep) && far >= 5,
        };
        if is_lane(here) {
            return push(if self.freed { exit.out } else { exit.along });
        }
        let is_goal = |cell: Pos| is_lane(cell) && !chart.is_taken(cell, 1);
        chart.way(here, order, CROWD, is_goal).map_or(Action::Stay, push)
    }
}

impl Exit {
    /// All eight: either side of each corner may be the open one.
    fn all(seat: &Seat) -> Vec<Self> {
        let (low, right) = (i32::from(seat.height) - 1, i32::from(seat.width) - 1);
        let mut exits = Vec::new();
        for (i, vertical) in [(0, Direction::Up), (low, Direction::Down)] {
            for (j, horizontal) in [(0, Direction::Left), (right, Direction::Right)] {
                let corner = Pos::new(i, j);
                exits.push(Self { corner, out: vertical, along: horizontal });
                exits.push(Self { corner, out: horizontal, along: vertical });
            }
        }
        exits
    }

    /// The cell as (how deep inside the open side, how far from the corner along it).
    fn place(&self, cell: Pos) -> (i32, i32) {
        let distance = |direction: Direction| {
            let (i, j) = direction.offset();
            (self.corner.i - cell.i) * i + (self.corner.j - cell.j) * j
        };
        (distance(self.out), distance(self.along))
    }

    /// Whether this exit explains everything in view, once the block was pushed so often.
    fn explains(&self, view: &View, pushes: i32, chart: &Chart) -> bool {
        view.positions().all(|(cell, seen)| {
            let (deep, far) = self.place(cell);
            let is_gap = deep == 0 && (0..=3).contains(&far);
            match seen {
                Seen::Outside => true,
                Seen::Block => is_block(deep, far, pushes),
                Seen::Wall => chart.is_on_ring(cell) && !is_gap,
                _ => !is_block(deep, far, pushes) && (is_gap || !chart.is_on_ring(cell)),
            }
        })
    }
}

/// Whether the block lies on a cell after so many pushes, the first along and the others out.
fn is_block(deep: i32, far: i32, pushes: i32) -> bool {
    let (along, out) = (pushes.min(1), (pushes - 1).max(0));
    match deep + out {
        0 => (0..=3).contains(&(far + along)),
        1..=3 => (2..=4).contains(&(far + along)),
        _ => false,
    }
}
