//! The maps of Foraging: there are so few that a small part of one identifies it.

use swarmbench_engine::{Direction, Pos, Seen, View, limits};

use crate::Seat;
use crate::chart::within;

/// Distance in rows and columns within which a cell counts as near.
const NEAR: i32 = 12;

/// Extent of the squares from the edges of the map, in cells.
const CORNER: i32 = 3;

/// Inner walls lie in every fourth row (or column).
const SPACING: i32 = 4;

/// A half of every gap: loaded and empty agents use different halves and do not meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lane {
    /// The half nearer to the squares on a map with one wall.
    Inner,
    /// The other half.
    Outer,
    /// Both halves, for an agent that is alone.
    Both,
}

/// One of the maps that the rules can lay out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    height: i32,
    width: i32,
    /// The top-left cells of the two squares.
    pub(super) food: Pos,
    pub(super) nest: Pos,
    /// The direction of inner walls: columns, or rows.
    columns: bool,
    walls: i32,
}

impl Layout {
    /// All maps of the seat's size that the rules can lay out, at most eight; none of a size that the
    /// rules do not allow.
    pub(super) fn all(seat: &Seat) -> Vec<Self> {
        if ![seat.height, seat.width].iter().all(|&cells| limits::SIZE.contains(&cells.into())) {
            return Vec::new();
        }
        let (height, width) = (i32::from(seat.height), i32::from(seat.width));
        let mut all = Vec::new();
        for columns in [false, true] {
            let walls = (if columns { width } else { height } - SPACING - 1) / SPACING;
            for (top, left) in [(true, true), (true, false), (false, true), (false, false)] {
                let corner = |top: bool, left: bool| {
                    Pos::new(if top { 1 } else { height - 3 }, if left { 1 } else { width - 3 })
                };
                let (mut food, mut nest) = (corner(top, left), corner(!top, !left));
                if walls % 2 == 1 && columns {
                    (food.i, nest.i) = (1, 1);
                } else if walls % 2 == 1 {
                    (food.j, nest.j) = (1, 1);
                }
                // Without walls their direction does not matter.
                let columns = columns && walls > 0;
                let layout = Self { height, width, food, nest, columns, walls };
                if !all.contains(&layout) {
                    all.push(layout);
                }
            }
        }
        all
    }

    /// The content of a cell in the layout, without agents.
    pub(super) fn at(&self, cell: Pos) -> Seen {
        let on_map = (0..self.height).contains(&cell.i) && (0..self.width).contains(&cell.j);
        let inside =
            (1..self.height - 1).contains(&cell.i) && (1..self.width - 1).contains(&cell.j);
        let is_in = |square: Pos| {
            (0..2).contains(&(cell.i - square.i)) && (0..2).contains(&(cell.j - square.j))
        };
        if !on_map {
            Seen::Outside
        } else if is_in(self.food) {
            Seen::Food
        } else if is_in(self.nest) {
            Seen::Nest
        } else if !inside || self.is_inner_wall(cell) {
            Seen::Wall
        } else {
            Seen::Empty
        }
    }

    /// Rows and columns.
    pub(super) const fn size(&self) -> Pos {
        Pos::new(self.height, self.width)
    }

    /// An agent can stand on an open cell.
    pub(super) fn is_open(&self, cell: Pos) -> bool {
        self.at(cell) == Seen::Empty
    }

    /// True if the view agrees with the layout near the agent and in the corners, where the squares are. A window over
    /// a large map has many more cells than needed.
    pub(super) fn fits(&self, here: Pos, view: &View) -> bool {
        let (low, right) = (self.height - 1, self.width - 1);
        let corners = [(0, 0), (0, right), (low, 0), (low, right)];
        let corners = corners.into_iter().map(|(i, j)| (Pos::new(i, j), CORNER));
        let mut telling = corners.chain([(here, NEAR)]);
        telling.all(|(middle, reach)| within(view, middle, reach).all(|it| self.has(it)))
    }

    /// True if the layout has this content on a cell.
    fn has(&self, (cell, seen): (Pos, Seen)) -> bool {
        match seen {
            Seen::Empty | Seen::Yourself | Seen::Agent { .. } => self.is_open(cell),
            Seen::Outside | Seen::Wall | Seen::Nest | Seen::Food => self.at(cell) == seen,
            Seen::Block | Seen::Prey => false,
        }
    }

    /// The cells beside a square.
    pub(super) fn beside(&self, square: Pos) -> Vec<Pos> {
        let sides = (-1..3).flat_map(|i| (-1..3).map(move |j| square.plus(Pos::new(i, j))));
        let what = self.at(square);
        let touches =
            |cell: &Pos| Direction::ALL.iter().any(|&side| self.at(cell.toward(side)) == what);
        sides.filter(|cell| self.is_open(*cell)).filter(touches).collect()
    }

    /// The number of steps between two open cells for an agent that keeps to a lane.
    ///
    /// Walls are crossed one after another, each within its gap. An agent that moves along a wall only as far as the
    /// next gap demands never moves too far, so the number of steps needs no search. The squares lie in corners of
    /// their rooms, where they block no way.
    pub(super) fn apart(&self, from: Pos, to: Pos, lane: Lane) -> i32 {
        let (from, to) = (self.turned(from), self.turned(to));
        let (from, to) = if from.i <= to.i { (from, to) } else { (to, from) };
        let (mut along, mut steps) = (from.j, to.i - from.i);
        let first = ((from.i - 1) / SPACING).max(0);
        for number in first..self.walls.min(to.i / SPACING) {
            let (first, last) = self.lane(number, lane);
            let next = along.max(first).min(last);
            steps += (next - along).abs();
            along = next;
        }
        steps + (to.j - along).abs()
    }

    /// The lane of loaded agents, or of empty ones.
    ///
    /// All agents go around the ends of the walls in the same sense, whichever square holds the food. In that sense
    /// agents that turn one after another do not push each other into a wall, because of the order in which the rules
    /// resolve the directions.
    pub(super) fn lane_of(&self, loaded: bool) -> Lane {
        let away = self.turned(self.food).i < self.turned(self.nest).i;
        if loaded == away { Lane::Inner } else { Lane::Outer }
    }

    /// Distance in rows (or columns) of a cell from the side of its room along which the lane runs, at most two. Inner
    /// lanes run along the wall around whose end the way leads next.
    pub(super) fn aside(&self, cell: Pos, lane: Lane) -> i32 {
        let line = self.turned(cell).i;
        let room = (line / SPACING).min(self.walls);
        let deep = (line - room * SPACING - 1).clamp(0, 2);
        if (room % 2 == 0) == (lane == Lane::Inner) { 2 - deep } else { deep }
    }

    /// The first and the last cell of a lane in the gap of a wall, counted along the wall.
    fn lane(&self, number: i32, lane: Lane) -> (i32, i32) {
        let (first, last) = self.gap(number);
        match lane {
            Lane::Inner | Lane::Outer if first >= last => (first, last),
            Lane::Both => (first, last),
            Lane::Inner => (first, i32::midpoint(first, last - 1)),
            Lane::Outer => (i32::midpoint(first, last - 1) + 1, last),
        }
    }

    /// The first and the last cell of a gap, counted along its wall.
    fn gap(&self, number: i32) -> (i32, i32) {
        let length = if self.columns { self.height } else { self.width };
        if number % 2 == 0 {
            (length - (length + 2) / 3 + 1, length - 2)
        } else {
            (1, length / 3 - 1)
        }
    }

    pub(super) fn is_inner_wall(&self, cell: Pos) -> bool {
        let cell = self.turned(cell);
        let number = cell.i / SPACING - 1;
        let (first, last) = self.gap(number);
        cell.i % SPACING == 0
            && (0..self.walls).contains(&number)
            && !(first..=last).contains(&cell.j)
    }

    /// The cell on a map on which the inner walls are rows.
    const fn turned(&self, cell: Pos) -> Pos {
        if self.columns { Pos::new(cell.j, cell.i) } else { cell }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Arc;

    use swarmbench_engine::{AgentId, Config, Settings, TaskName, World};

    use super::*;

    /// A game whose agents see everything.
    fn world(height: i64, width: i64, seed: u64) -> World {
        let settings = Settings {
            control: "centralized".to_owned(),
            height,
            width,
            ..Settings::standard(TaskName::Foraging, seed)
        };
        World::new(Arc::new(Config::check(&settings).expect("playable settings")))
    }

    /// The only layout that fits the world.
    fn layout(world: &World) -> Layout {
        let seat = Seat::of(world.config(), AgentId(0), 0);
        let view = world.observe(AgentId(0)).view.expect("it has not escaped");
        let fits: Vec<_> =
            Layout::all(&seat).into_iter().filter(|it| it.fits(Pos::new(1, 1), &view)).collect();
        assert_eq!(fits.len(), 1, "{seat:?}");
        fits[0]
    }

    /// Every cell that can be reached, with its distance in steps from the first one, found by search.
    fn searched(layout: &Layout, from: Pos) -> Vec<(Pos, i32)> {
        let mut found = vec![(from, 0)];
        let mut open = VecDeque::from(found.clone());
        while let Some((cell, steps)) = open.pop_front() {
            for next in Direction::ALL.map(|side| cell.toward(side)) {
                if layout.is_open(next) && found.iter().all(|&(known, _)| known != next) {
                    found.push((next, steps + 1));
                    open.push_back((next, steps + 1));
                }
            }
        }
        found
    }

    #[test]
    fn every_map_is_known_and_so_are_its_ways() {
        for (height, width) in [(8, 8), (9, 9), (10, 10), (13, 13), (14, 14), (8, 17), (18, 11)] {
            for seed in 0..12 {
                let layout = layout(&world(height, width, seed));
                for from in layout.beside(layout.food) {
                    for (to, steps) in searched(&layout, from) {
                        assert_eq!(
                            layout.apart(from, to, Lane::Both),
                            steps,
                            "{layout:?} {from:?} {to:?}"
                        );
                        assert_eq!(
                            layout.apart(to, from, Lane::Both),
                            steps,
                            "{layout:?} {from:?} {to:?}"
                        );
                        let lane = layout.apart(from, to, Lane::Inner).min(layout.apart(
                            from,
                            to,
                            Lane::Outer,
                        ));
                        assert!(lane >= steps, "{layout:?} {from:?} {to:?}");
                    }
                }
            }
        }
    }

    /// The maximum score of the swarm on a layout if no agent is ever blocked or pushed along.
    fn bound(world: &World) -> i32 {
        let layout = layout(world);
        let (foods, nests) = (layout.beside(layout.food), layout.beside(layout.nest));
        let apart = |from: Pos, to: Pos| layout.apart(from, to, Lane::Both);
        let trip =
            |food: Pos| nests.iter().map(|&nest| apart(food, nest)).min().expect("four cells");
        let least = foods.iter().map(|&food| trip(food)).min().expect("four cells");
        let first = |from: Pos| {
            foods.iter().map(|&food| apart(from, food) + trip(food)).min().expect("four cells")
        };
        let rounds = i32::try_from(world.config().settings().max_round).expect("a short game");
        let deliveries = |at: Pos| (rounds - first(at)) / (2 * least) + 1;
        world.agent_states().map(|agent| deliveries(agent.at)).sum()
    }

    /// The number stands in the documentation of the foraging module.
    #[test]
    fn without_traffic_the_swarm_would_score_so_much() {
        let total: i32 = (0..20).map(|seed| bound(&world(10, 10, seed))).sum();
        assert_eq!(total, 877, "20 times 43.85");
    }
}
