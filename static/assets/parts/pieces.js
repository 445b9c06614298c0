// States of a game in pages, and data collected from them.

/** @import { Piece, State } from "./game.js" */

/**
 * Marks of a state, by the round that led to it.
 * @param {Map<number, string[]>} marks
 * @param {State[]} states
 */
export function collectMarks(marks, states) {
  for (const state of states) if (state.marks?.length) marks.set(state.round - 1, state.marks);
}

/** Adds later states to a page that overlaps with them. @param {Piece} piece @param {Piece} later */
export function join(piece, later) {
  const kept = later.from - piece.from;
  piece.states = [...piece.states.slice(0, kept), ...later.states];
  for (const name of new Set([...Object.keys(piece.metrics), ...Object.keys(later.metrics)])) {
    const before = piece.metrics[name] ?? Array(kept).fill(null);
    const after = later.metrics[name] ?? Array(later.states.length).fill(null);
    piece.metrics[name] = [...before.slice(0, kept), ...after];
  }
}
