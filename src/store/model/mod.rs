//! Entries of the writer, and the interface between episodes and the store. No SQL.

pub mod entries;
pub mod port;
