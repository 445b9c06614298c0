//! What is written, and what episodes need of a store: no word of SQL.

pub mod entries;
pub mod port;
