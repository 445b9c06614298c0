//! Evaluations: who plays what, as runs on a server, and the results.
//!
//! An [`experiment`] is a file or a command line: lists of models, tasks, seeds and settings that multiply. Its [`plan`]
//! is a list of runs, each of one player with one combination of settings, and each with an identity. [`conduct`] plays
//! them one after the other: it resumes the run of that identity or creates it. What stops this early is a
//! [`stop_reason::StopReason`]. A [`report`] shows what the server then says, and [`verify`] replays all journals.

pub mod conduct;
pub mod conversation;
pub mod experiment;
mod list;
pub mod plan;
pub mod report;
pub mod stop_reason;
pub mod verify;
