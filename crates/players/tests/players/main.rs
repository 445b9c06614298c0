//! The built-in players, played in the engine as an agent plays: by what it may observe and nothing
//! else.

mod registry;
mod robustness;
mod scores;
