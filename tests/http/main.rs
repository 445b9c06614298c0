//! The server through its front door: every route, over real HTTP, by the wire contract.
//!
//! The files mirror those of `src/http`; [`across`] has the tests of more than one route.
//!
//! [`app`] starts a server on a free port over a database of its own. Where time has to pass, a test moves a clock by
//! hand; where something has to happen first, it asks with a wait.

mod app;
mod cup;

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
mod eviction;
mod exports;
mod host;
mod imports;
mod keys;
mod limits;
mod mcp;
mod openapi;
mod pages;
mod proxy;
mod router;
mod runs;
mod serve;
mod servers;
mod stream;
mod swarm;
mod timers;
