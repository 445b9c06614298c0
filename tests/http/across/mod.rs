//! Tests of more than one route: permissions, errors, limits, crashes, and the files of a database.

mod access;
mod backup;
mod bad_input;
mod bounds;
mod clocks;
mod concurrency;
mod damage;
mod episode;
mod fairness;
mod faults;
mod files;
mod golden;
mod golden_database;
mod hosted;
pub(crate) mod memory;
mod organizer;
mod privacy;
mod restart;
mod sealed;
mod shares;
mod templates;
pub(crate) mod vectors;
mod words;
