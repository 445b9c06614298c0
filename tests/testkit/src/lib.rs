//! Code shared by several test programs and benchmarks. It knows the engine but no server: code that needs a server
//! belongs to the test program that needs it.

pub mod corners;
pub mod dice;
pub mod fuzz;
pub mod oracle;
pub mod postgres;
pub mod program;
pub mod worlds;

pub use swarmbench_testkit_needs::needs;
