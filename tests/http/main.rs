//! The server through its front door: every route, over real HTTP, by the wire contract.
//!
//! The files mirror those of `src/http`; [`across`] has the tests of more than one route.
//!
//! [`app`] starts a server on a free port over a database of its own. No test sleeps: where time has
//! to pass, a test moves a clock by hand; where something has to happen first, it asks with a wait.

mod app;
#[path = "../../crates/engine/tests/common/corners.rs"]
mod corners;
mod cup;
#[path = "../../crates/engine/tests/common/dice.rs"]
mod dice;
#[path = "../support/game.rs"]
mod game;
#[path = "../../crates/engine/tests/privacy/oracle.rs"]
mod oracle;
#[expect(dead_code, reason = "other tests use other parts")]
#[path = "../support/postgres.rs"]
mod postgres;

mod across;
mod agent;
mod audit;
mod boards;
mod body;
mod claims;
mod client;
mod clock;
mod competitions;
mod episodes;
mod exports;
mod host;
mod imports;
mod keys;
mod limits;
mod mcp;
mod nodes;
mod openapi;
mod pages;
mod room;
mod router;
mod runs;
mod serve;
mod stream;
mod swarm;
mod timers;
