//! Code shared by several test programs and benchmarks. It knows the engine but no server: code that needs a server
//! belongs to the test program that needs it.

pub mod corners;
pub mod dice;
#[cfg(feature = "fuzz")]
pub mod fuzz;
pub mod host;
pub mod latencies;
pub mod oracle;
#[cfg(feature = "servers")]
pub mod postgres;
#[cfg(feature = "servers")]
pub mod program;
pub mod worlds;

pub use swarmbench_testkit_needs::needs;
