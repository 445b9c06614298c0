//! Boards as pure functions: which board a question finds, and the order of a competition's entrants.

mod collection;
mod standings;
