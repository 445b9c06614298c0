//! The campaign: the real server, the real disk, many clients; and then the server is killed, told to stop, or
//! its disk breaks. Whatever was acknowledged must be there afterwards. See `docs/develop/campaign.md`.
//!
//! Everywhere else tests have a clock of their own and never sleep. Here a process is killed at moments that
//! nobody chose, so time is the host's, and what is waited for has a limit after which the test fails.

mod audit;
mod away;
mod clients;
#[path = "../support/dice.rs"]
mod dice;
#[cfg(target_os = "linux")]
mod disk;
mod doors;
mod fleet;
mod forks;
mod kills;
mod ledger;
mod plan;
#[path = "../support/postgres.rs"]
mod postgres;
#[cfg(target_os = "linux")]
mod preload;
mod proxy;
#[expect(dead_code, reason = "the attacks share it and use other parts")]
#[path = "../support/server.rs"]
mod server;
mod stop;
