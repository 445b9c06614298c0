//! A game shown round by round: the states that a server sends, and pictures.
//!
//! The source of the rounds (a running server, a journal file, an imported game) supplies states and decisions, which have
//! the same types for all sources. [`Reel`] makes states of them as they are sent, [`PageMaker`] pages of states, and
//! [`agent_round`] the view of one agent. [`draw`] makes pictures and films of worlds.
//!
//! The crate is separate because servers, commands and imports all show games. Its feature `draw`, which is on by default,
//! adds a font and encoders; a server without commands needs neither.

mod knowledge;
mod page;
mod reel;
mod talk;
mod world;

#[cfg(feature = "draw")]
pub mod draw;

#[cfg(test)]
mod tests;

pub use knowledge::{agent_round, inbox, shown_act};
pub use page::{AGENT_ROUNDS_MAX, PAGE_BYTES_MAX, PageMaker, ROUNDS_MAX, rounded, rounds_of_page};
pub use reel::{Frame, ROUNDS_BEFORE, Reel, Round, Scene};
pub use world::{block_cells, ground};
