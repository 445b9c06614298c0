//! A cluster as machines: what a server knows of it, and what it decides.
//!
//! Nothing here reads a clock, a socket or a database. Time comes in as an argument, and what is to be done goes out as a step.
//! `membership` and `http::forward` drive the machines with the database and the network, the simulation with its own. The database
//! decides everything that has to be right: a wrong decision costs time, never an act.
//!
//! - [`ServerRow`] is a server as the database shows it, [`preferred`] the one that should take a free place, and
//!   [`commit_pause`] how servers share the database.
//! - [`Lease`] is a server's right to answer.
//! - [`Places`] are the games, runs and competitions that a server owns.
//! - [`watch`] decides when a server beats, who is dead, and which work is due.
//! - [`route`] decides which server answers a request.

mod lease;
mod places;
pub mod route;
mod server;
pub mod watch;

pub use lease::{ANSWERS_FOR, Lease};
pub use places::Places;
pub use server::{
    CLOCK_OFF_MAX, Death, Incarnation, STARTS_WITHIN, ServerRow, TAKEN_OVER_AFTER, commit_pause,
    number_of, preferred,
};
