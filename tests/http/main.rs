//! The server through its front door: every route, over real HTTP, by the wire contract.
//!
//! [`app`] starts a server on a free port over a database of its own. No test sleeps: where time has
//! to pass, a test moves a clock by hand; where something has to happen first, it asks with a wait.

mod app;
#[path = "../../crates/engine/tests/common/corners.rs"]
mod corners;
mod cup;
#[path = "../../crates/engine/tests/common/dice.rs"]
mod dice;
#[path = "../../crates/engine/tests/privacy/oracle.rs"]
mod oracle;

mod access;
mod agent;
mod backup;
mod bad_input;
mod boards;
mod bounds;
mod claims;
mod clocks;
mod competitions;
mod concurrency;
mod connections;
mod damage;
mod doubt;
mod episode;
mod episodes;
mod exports;
mod fairness;
mod faults;
mod files;
mod golden;
mod golden_database;
mod host;
mod hosted;
mod keys;
mod limits;
mod organizer;
mod privacy;
mod published;
mod restart;
mod runs;
mod sealed;
mod shares;
mod streams;
mod swarm;
mod vectors;
