//! Parts of the server without HTTP: who may know whom, recorded and generated games, names, boards, machines, the store, the registry, and the simulation.

mod architecture;
mod boards;
mod fuzz;
mod game;
mod golden;
mod machines;
mod names;
mod registry;
mod simulation;
mod store;
