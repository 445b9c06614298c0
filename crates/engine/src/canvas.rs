//! All windows of a round at once, as numbers (rules: *What an agent sees*).
//!
//! The map is drawn once with a border as wide as a window reaches, so a window is a few rows to copy. The windows
//! equal the current view of [`World::observe`].

use crate::act::AgentId;
use crate::body::Kind;
use crate::config::Config;
use crate::grid::Pos;
use crate::names::{Control, RuleSet};
use crate::observe::Seen;
use crate::world::World;

/// A map as agents see it; reusable for any number of states.
#[derive(Clone, Debug, Default)]
pub struct Canvas {
    /// Cells of the border on each side.
    border: i32,
    /// Columns of a row, borders included.
    stride: usize,
    /// Rows and columns of a window.
    window: (usize, usize),
    symbols: Vec<u8>,
    numbers: Vec<i16>,
    /// The first cell of an agent's window and its own cell in the window, by agent; `None` once it has escaped.
    starts: Vec<Option<(usize, usize)>>,
}

impl Seen {
    /// Number of codes.
    pub const CODES: usize = 10;

    /// The code of the cell, from 0: empty, outside, wall, block, prey, nest, food, the agent itself, another agent,
    /// one with a mark.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Empty => 0,
            Self::Outside => 1,
            Self::Wall => 2,
            Self::Block => 3,
            Self::Prey => 4,
            Self::Nest => 5,
            Self::Food => 6,
            Self::Yourself => 7,
            Self::Agent { marked: false, .. } => 8,
            Self::Agent { marked: true, .. } => 9,
        }
    }
}

/// Agent number for "no other agent".
const NOBODY: i16 = -1;

impl Canvas {
    /// Draws the present state of a world.
    pub fn draw(&mut self, world: &World) {
        let (config, board) = (world.config(), world.board());
        let (height, width) = (board.grid().height(), board.grid().width());
        self.set_out(config, height, width);
        for body in &board.bodies()[board.agents().len()..] {
            let code = match body.kind() {
                Kind::Wall => Seen::Wall,
                Kind::Nest => Seen::Nest,
                Kind::Food => Seen::Food,
                Kind::Block => Seen::Block,
                Kind::Prey => Seen::Prey,
                Kind::Agent => continue,
            };
            for cell in body.cells().filter(|&cell| board.grid().contains(cell)) {
                let at = self.place(cell);
                self.symbols[at] = code.code();
            }
        }
        let inverted = config.rules() == RuleSet::Reference;
        let flags = world.task.flags();
        self.starts.clear();
        for (body, number) in board.agents().iter().zip(0_u16..) {
            if body.gone {
                self.starts.push(None);
                continue;
            }
            let flag = flags.get(usize::from(number));
            let marked = flag.is_some_and(|&flag| flag != inverted);
            let at = self.place(body.at);
            self.symbols[at] = Seen::Agent { number, marked }.code();
            self.numbers[at] = number.cast_signed();
            let corner = match config.control() {
                Control::Decentralized => {
                    Pos::new(body.at.i - self.border, body.at.j - self.border)
                }
                Control::Centralized => Pos::new(0, 0),
            };
            let start = self.place(corner);
            let (rows, columns) = ((at - start) / self.stride, (at - start) % self.stride);
            self.starts.push(Some((start, rows * self.window.1 + columns)));
        }
    }

    /// Writes the window of an agent row by row: the code of each cell ([`Seen::code`]), and the number of the agent in
    /// it, −1 without one and for the agent itself. Returns false and writes nothing once the agent has escaped.
    ///
    /// # Panics
    /// Panics if the slices do not have the size of a window, or there is no such agent.
    pub fn write_window(&self, agent: AgentId, codes: &mut [u8], numbers: &mut [i16]) -> bool {
        let Some((start, own)) = self.starts[agent.index()] else { return false };
        let columns = self.window.1;
        let rows = codes.chunks_exact_mut(columns).zip(numbers.chunks_exact_mut(columns));
        for ((codes, numbers), row) in rows.zip(0..) {
            let from = start + row * self.stride;
            codes.copy_from_slice(&self.symbols[from..from + columns]);
            numbers.copy_from_slice(&self.numbers[from..from + columns]);
        }
        codes[own] = Seen::Yourself.code();
        numbers[own] = NOBODY;
        true
    }

    /// An agent's own cell in its window; `None` once it has escaped.
    #[must_use]
    pub fn own_cell(&self, agent: AgentId) -> Option<usize> {
        self.starts[agent.index()].map(|(_, own)| own)
    }

    /// Clears the canvas for an empty map.
    fn set_out(&mut self, config: &Config, height: i32, width: i32) {
        let length = |cells: i32| usize::try_from(cells).expect("a positive size");
        (self.border, self.window) = match config.control() {
            Control::Decentralized => {
                let side = length(config.view_size);
                (config.reach(), (side, side))
            }
            Control::Centralized => (0, (length(height), length(width))),
        };
        self.stride = length(width + 2 * self.border);
        let cells = self.stride * length(height + 2 * self.border);
        self.symbols.clear();
        self.symbols.resize(cells, Seen::Outside.code());
        self.numbers.clear();
        self.numbers.resize(cells, NOBODY);
        let columns = length(width);
        for i in 0..height {
            let first = self.place(Pos::new(i, 0));
            self.symbols[first..first + columns].fill(Seen::Empty.code());
        }
    }

    /// The index of a cell; cells of the border have one, too.
    fn place(&self, cell: Pos) -> usize {
        let length = |cells: i32| usize::try_from(cells + self.border).expect("inside the border");
        length(cell.i) * self.stride + length(cell.j)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::act::{Act, Action};
    use crate::names::TaskName;
    use crate::settings::Settings;
    use std::sync::Arc;

    #[test]
    fn windows_are_those_of_observations() {
        let mut canvas = Canvas::default();
        for task in TaskName::ALL {
            for (rules, control, view_size) in [
                ("paper", "decentralized", 5),
                ("reference", "decentralized", 21),
                ("paper", "centralized", 3),
            ] {
                let settings = Settings {
                    rules: rules.to_owned(),
                    control: control.to_owned(),
                    view_size,
                    ..Settings::standard(task, 27)
                };
                let config = Arc::new(Config::check(&settings).expect("a standard game"));
                let mut world = World::new(config);
                let actions = Action::of_task(task);
                for round in 0..60 {
                    if world.is_over() {
                        break;
                    }
                    canvas.draw(&world);
                    for agent in world.agents() {
                        compare(&canvas, &world, agent);
                    }
                    let draw = |agent: AgentId| {
                        actions[(round * 7 + agent.index() * 3 + round / 5) % actions.len()]
                    };
                    let acts: Vec<Act> = world.agents().map(|agent| Act::of(draw(agent))).collect();
                    world.step(&acts);
                }
            }
        }
    }

    fn compare(canvas: &Canvas, world: &World, agent: AgentId) {
        let cells = world.config().window();
        let (mut codes, mut numbers) = (vec![99; cells], vec![99; cells]);
        let written = canvas.write_window(agent, &mut codes, &mut numbers);
        let Some(view) = world.observe(agent).view else {
            assert!(!written);
            return;
        };
        let expected: Vec<u8> = view.cells.iter().map(|seen| seen.code()).collect();
        assert_eq!(codes, expected);
        let number = |seen: &Seen| match seen {
            Seen::Agent { number, .. } => number.cast_signed(),
            _ => NOBODY,
        };
        assert_eq!(numbers, view.cells.iter().map(number).collect::<Vec<_>>());
        assert_eq!(view.cells[canvas.own_cell(agent).expect("on the map")], Seen::Yourself);
    }
}
