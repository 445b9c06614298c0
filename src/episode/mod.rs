//! Running episodes.
//!
//! [`lockstep`] is the barrier as a pure machine; an [`actor`] performs its effects, one task per episode. [`seating`] assigns
//! seats to holders. [`registry`] creates, finds and evicts episodes; [`recovery`] makes a running episode of a journal; [`past`]
//! is what a fork takes over; [`replay`] computes states of earlier rounds; [`heavy`] estimates work and moves it off the async
//! threads; [`quota`] limits what each owner uses, and [`memory`] estimates the memory of an episode. Readers look at the
//! published [`Snapshot`].
//!
//! Dependencies run in one direction: `registry`, `recovery`, `past`, `replay`, `actor`, and below it all others.

pub mod actor;
pub mod heavy;
pub mod in_flight;
mod keyframes;
pub mod lockstep;
pub mod memory;
pub mod past;
pub mod quota;
pub mod recovery;
pub mod registry;
pub mod replay;
pub mod replays;
pub mod seating;
mod slot;
mod slots;
mod snapshot;
pub mod spec;
mod status;

pub use snapshot::Snapshot;
pub use status::{Ending, Outcome, Status};
