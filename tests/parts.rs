//! Parts of the server without HTTP: who may know whom, recorded and generated games, the store, the registry, and the simulation.

mod architecture;
mod fuzz;
mod game;
mod golden;
mod registry;
mod simulation;
mod store;
