//! Windows as tables, with the numbers of rows and columns at the edges.

use std::fmt::Write;

use swarmbench_protocol::Position;
use swarmbench_protocol::observation::Cell;

/// A table in columns of five characters, without spaces at the ends of lines.
pub(super) fn plain(origin: Position, cells: &[Vec<Cell>]) -> String {
    const WIDTH: usize = 5;
    let width = cells.first().map_or(0, Vec::len);
    let mut text = String::with_capacity(WIDTH * (width + 1) * (cells.len() + 1));
    text.push_str("     ");
    let write = |text: &mut String, what: &dyn std::fmt::Display| {
        let end = text.len() + WIDTH;
        write!(text, "{what}").expect("a string takes everything");
        while text.len() < end {
            text.push(' ');
        }
    };
    for (j, _) in (origin.j..).zip(0..width) {
        write(&mut text, &j);
    }
    for (i, row) in (origin.i..).zip(cells) {
        text.truncate(text.trim_end().len());
        text.push('\n');
        write(&mut text, &i);
        for cell in row {
            write(&mut text, &cell.0);
        }
    }
    text.truncate(text.trim_end().len());
    text
}

/// A table in the form of the public toolkit: numbers of rows and columns in three characters, right-aligned; cells in
/// four, left-aligned, with the spaces at the ends of lines.
pub(super) fn padded(origin: Position, cells: &[Vec<Cell>]) -> String {
    const WIDTH: usize = 4;
    let width = cells.first().map_or(0, Vec::len);
    let mut text = String::with_capacity((WIDTH * (width + 1) + 2) * (cells.len() + 1));
    text.push_str("  ");
    for (j, _) in (origin.j..).zip(0..width) {
        write!(text, " {j:>3}").expect("a string takes everything");
    }
    for (i, row) in (origin.i..).zip(cells) {
        write!(text, "\n{i:>3}  ").expect("a string takes everything");
        for cell in row {
            write!(text, "{:<WIDTH$}", cell.0.to_string()).expect("a string takes everything");
        }
    }
    text
}
