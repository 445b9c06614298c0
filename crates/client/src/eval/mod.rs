//! Evaluations: who plays what, as runs on a server, and the results.
//!
//! An [`experiment`] is a file or a command line: lists of models, tasks, seeds and settings that multiply. Its [`plan`]
//! is a list of runs, each of one player by one combination of settings, which tells itself by its identity. They are
//! [`conduct`]ed one after the other: found where they were begun before, created where not, played to the end. What
//! stops this early is a [`stop_reason::StopReason`]. A [`report`] is made of what the server then says, and [`verify`] plays all
//! journals again.

pub mod conduct;
pub mod conversation;
pub mod experiment;
pub mod plan;
pub mod report;
pub mod stop_reason;
pub mod verify;
