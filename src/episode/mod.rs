//! Running episodes.
//!
//! [`lockstep`] is the barrier as a pure machine: who acted, who may, whose clock ran out. [`actor`]
//! performs what it says, one task an episode. [`seating`] says who holds which seat. [`registry`] finds and starts them, and evicts idle
//! ones; [`recovery`] makes a running episode of a journal; [`replay`] makes states of
//! earlier rounds again; [`heavy`] says what leaves the async threads; [`quota`] counts what each owner
//! uses, [`memory`] how much memory an episode takes. Readers look at a [`Snapshot`], which never changes.

pub mod actor;
pub mod heavy;
pub mod in_flight;
mod keyframes;
pub mod lockstep;
pub mod memory;
pub mod quota;
pub mod recovery;
pub mod registry;
pub mod replay;
mod replays;
pub mod seating;
mod snapshot;
pub mod spec;
mod status;

pub use snapshot::Snapshot;
pub use status::{Ending, Outcome, Status};
