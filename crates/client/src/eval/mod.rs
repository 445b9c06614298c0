//! Evaluations: players and games as runs on a server, and their results.
//!
//! An [`experiment`] is a file or a command line: lists of models, tasks, seeds and settings that multiply. Its
//! [`plan`] is a list of runs, each of one player with one combination of settings, and each with an identity.
//! [`conduct`] plays one run: it resumes the run of that identity or creates it. [`lanes`] plays all runs, those of
//! different endpoints side by side. An [`entry`] is an entrant whose attempts in a competition are played in the
//! same way. A [`stop_reason::StopReason`] ends an evaluation early, for example if most answers fail in one way
//! ([`judge`]). A [`report`] shows the results of the server, and [`verify`] replays all journals.

pub mod conduct;
pub mod conversation;
pub mod entry;
pub mod experiment;
pub mod harness;
pub mod judge;
pub mod lanes;
mod list;
mod memory;
pub mod plan;
pub mod report;
pub mod stop_reason;
pub mod system;
pub mod verify;
