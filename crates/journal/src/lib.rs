//! The journal of an episode: all that is stored of it, enough to replay it.
//!
//! An episode is its journal: the opening (configuration, rules, prompt template), every round's acts with the digest
//! of the state after them, and the end, in a chain of hashes. States, scores and observations are recomputed from it.
//! The format is described in `docs/journal.md`.
//!
//! A crate of its own because a server writes journals, and programs without a server read, check and analyse them.

pub mod chain;
pub mod fork;
pub mod record;
pub mod replay;
mod tally;

pub use tally::Tally;
