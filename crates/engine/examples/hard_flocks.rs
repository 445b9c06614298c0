//! Searches for layouts whose cost in Flocking is hard to find: draws mixtures of lines, crowds and rings, and then
//! climbs from the hardest by moving agents. Hardness is measured by `effort`, which is the same on every machine.
//!
//! ```console
//! cargo run --release -p swarmbench-engine --example hard_flocks -- 256 256 1 600 300
//! ```
//!
//! The arguments are the number of agents, rows and columns of the map, the seed, drawn layouts, and steps uphill. The
//! hardest layout is printed with its effort, one agent a line.

use swarmbench_engine::Pos;
use swarmbench_engine::tasks::flocking::{effort, target};
use swarmbench_testkit::worlds::Dice;

/// A part of a layout, with the relative probability that an agent belongs to it.
struct Part {
    kind: usize,
    from: (usize, usize),
    to: (usize, usize),
    width: usize,
    chances: usize,
}

impl Part {
    fn draw(size: usize, dice: &mut Dice) -> Self {
        let mut cell = || (dice.below(size), dice.below(size));
        let (from, to) = (cell(), cell());
        let widest = 1 + dice.below(size / 3);
        let (width, chances) = (1 + dice.below(widest), 1 + dice.below(8));
        Self { kind: dice.below(4), from, to, width, chances }
    }

    /// A cell of the part: of a line, a crowd, the outline of a square, or anywhere.
    fn cell(&self, size: usize, dice: &mut Dice) -> (usize, usize) {
        let aside = (dice.below(self.width), dice.below(self.width));
        let part = dice.below(1000);
        let between = |from: usize, to: usize| (from * (1000 - part) + to * part) / 1000;
        match self.kind {
            0 => (
                between(self.from.0, self.to.0) + aside.0.min(6),
                between(self.from.1, self.to.1) + aside.1.min(6),
            ),
            1 => (self.from.0 + aside.0, self.from.1 + aside.1),
            2 => {
                let side = [0, self.width][part % 2];
                let (i, j) = if part % 4 < 2 { (side, aside.1) } else { (aside.0, side) };
                (self.from.0 + i, self.from.1 + j)
            }
            _ => (dice.below(size), dice.below(size)),
        }
    }
}

fn cell(i: usize, j: usize, size: usize) -> Pos {
    let inside = |at: usize| i32::try_from(at.clamp(1, size - 2)).expect("a map is small");
    Pos::new(inside(i), inside(j))
}

fn mixture(count: usize, size: usize, dice: &mut Dice) -> Vec<Pos> {
    let parts: Vec<Part> = (0..=dice.below(5)).map(|_| Part::draw(size, dice)).collect();
    let chances = parts.iter().map(|part| part.chances).sum();
    let mut cells: Vec<Pos> = Vec::new();
    for tries in 0.. {
        if cells.len() == count {
            break;
        }
        let mut chance = dice.below(chances);
        let part = parts.iter().find(|part| {
            let is_meant = chance < part.chances;
            chance = chance.saturating_sub(part.chances);
            is_meant
        });
        let (i, j) = match part {
            // Small parts can be full: after many tries any cell is drawn.
            Some(part) if tries < 20 * count => part.cell(size, dice),
            _ => (dice.below(size), dice.below(size)),
        };
        let at = cell(i, j, size);
        if !cells.contains(&at) {
            cells.push(at);
        }
    }
    cells
}

/// The same layout with some agents elsewhere, or a part of the map shifted; `None` if agents would share a cell.
fn neighbour(layout: &[Pos], size: usize, dice: &mut Dice) -> Option<Vec<Pos>> {
    let place = |at: i32, step: usize, wide: usize| {
        (at.unsigned_abs() as usize + step).saturating_sub(wide)
    };
    let mut next = layout.to_vec();
    if dice.below(3) == 0 {
        let edge = layout[dice.below(layout.len())];
        let (by, in_rows) = ((dice.below(5), dice.below(5)), dice.below(2) == 0);
        let meant = |at: &&mut Pos| if in_rows { at.i >= edge.i } else { at.j >= edge.j };
        for at in next.iter_mut().filter(meant) {
            *at = cell(place(at.i, by.0, 2), place(at.j, by.1, 2), size);
        }
    } else {
        let most = 1 + dice.below(layout.len() / 4);
        for _ in 0..=dice.below(most) {
            let (agent, other) = (dice.below(layout.len()), layout[dice.below(layout.len())]);
            let near = if dice.below(2) == 0 { other } else { next[agent] };
            let wide = 1 + dice.below(20);
            let by = (dice.below(2 * wide + 1), dice.below(2 * wide + 1));
            next[agent] = cell(place(near.i, by.0, wide), place(near.j, by.1, wide), size);
        }
    }
    let mut cells = next.clone();
    cells.sort_unstable();
    cells.dedup();
    (cells.len() == layout.len()).then_some(next)
}

#[expect(clippy::disallowed_methods, reason = "a program has arguments")]
fn main() {
    let arguments: Vec<usize> =
        std::env::args().skip(1).filter_map(|argument| argument.parse().ok()).collect();
    let &[count @ 12..=256, size @ 8..=256, seed, draws @ 1..=1_000_000, steps] = &arguments[..]
    else {
        eprintln!(
            "usage: hard_flocks AGENTS SIZE SEED DRAWS STEPS (12 to 256 agents, size 8 to 256)"
        );
        std::process::exit(2);
    };
    if count > (size - 2) * (size - 2) {
        eprintln!("{count} agents do not fit on {size} x {size} cells");
        std::process::exit(2);
    }
    let target = target(u16::try_from(count).expect("at most 256"));
    let mut dice = Dice(seed as u64);
    let drawn = (0..draws).map(|_| mixture(count, size, &mut dice));
    let rated = drawn.map(|layout| (effort(&layout, &target), layout));
    let (mut most, mut layout) = rated.max_by_key(|(effort, _)| *effort).expect("one is drawn");
    eprintln!("the hardest of {draws} drawn layouts takes {most}");
    for step in 1..=steps {
        let Some(next) = neighbour(&layout, size, &mut dice) else { continue };
        let effort = effort(&next, &target);
        if effort > most {
            (most, layout) = (effort, next);
            eprintln!("step {step}: {most}");
        }
    }
    println!("# {count} agents, {size} x {size} cells: effort {most}");
    for at in layout {
        println!("{} {}", at.i, at.j);
    }
}
