//! The journal of an episode: its only stored form, from which it is replayed.
//!
//! A journal contains the opening (configuration, rules, prompt template), the acts of every round with the digest of
//! the state after them, and the end, in a chain of hashes. States, scores and observations are recomputed from it.
//! The format is described in `docs/journal.md`.
//!
//! The crate is separate because a server writes journals, and programs without a server read, check and analyse
//! them.

pub mod chain;
pub mod fork;
pub mod record;
pub mod replay;
mod tally;

pub use tally::Tally;
