//! The built-in players, played in the engine as an agent plays: only from its observations.

mod registry;
mod robustness;
mod scores;
