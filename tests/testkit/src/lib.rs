//! What several test programs and benchmarks share. It knows the engine, and no server: what needs one is in the test
//! program that needs it.

pub mod corners;
pub mod dice;
pub mod fuzz;
pub mod oracle;
pub mod postgres;
pub mod program;
pub mod worlds;

pub use swarmbench_testkit_needs::needs;
