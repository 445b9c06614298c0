//! Windows as numbers.

use swarmbench_engine::{AgentId, Canvas, Seen};

/// The possible contents of a cell; the index of each is its plane and its symbol. The order is that of [`Seen::code`].
pub const CHANNELS: [&str; Seen::CODES] =
    ["empty", "outside", "wall", "block", "prey", "nest", "food", "self", "agent", "marked agent"];

/// Writes an agent's window as symbols, and the numbers of agents in it. The window of an escaped agent is all outside.
pub(crate) fn write_symbols(
    canvas: &Canvas,
    agent: AgentId,
    symbols: &mut [u8],
    numbers: &mut [i16],
) {
    if !canvas.write_window(agent, symbols, numbers) {
        symbols.fill(Seen::Outside.code());
        numbers.fill(-1);
    }
}

/// Writes symbols as a plane for each of [`CHANNELS`].
pub(crate) fn write_planes(symbols: &[u8], planes: &mut [u8]) {
    for (plane, channel) in planes.chunks_exact_mut(symbols.len()).zip(0_u8..) {
        for (cell, &symbol) in plane.iter_mut().zip(symbols) {
            *cell = u8::from(symbol == channel);
        }
    }
}

/// Removes from a mask the pushes that the agent sees to be useless: those against a wall, a nest or food right beside
/// it. The first actions are up, down, left and right.
pub(crate) fn hint(symbols: &[u8], width: usize, own: usize, mask: &mut [bool]) {
    let height = symbols.len() / width;
    let (row, column) = (own / width, own % width);
    let beside = [
        (row > 0).then(|| own - width),
        (row + 1 < height).then(|| own + width),
        (column > 0).then(|| own - 1),
        (column + 1 < width).then(|| own + 1),
    ];
    let fixed = [Seen::Wall, Seen::Nest, Seen::Food].map(Seen::code);
    for (allowed, cell) in mask.iter_mut().zip(beside) {
        if cell.is_some_and(|cell| fixed.contains(&symbols[cell])) {
            *allowed = false;
        }
    }
}
