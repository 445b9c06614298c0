//! Metrics of small games: worked examples, the edges of definitions, and properties of all games.

mod edges;
mod engine;
mod examples;
mod extras;
mod played;
mod properties;
mod vectors;
