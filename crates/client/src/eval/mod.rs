//! Evaluations: who plays what, as runs on a server, and the results.
//!
//! An [`experiment`] is a file or a command line: lists of models, tasks, seeds and settings that multiply. Its [`plan`]
//! is a list of runs, each of one player with one combination of settings, and each with an identity. [`conduct`] plays
//! one of them: it resumes the run of that identity or creates it. [`lanes`] plays all, those of different endpoints side
//! by side. An [`entry`] is an entrant whose attempts in a competition are played in the same way. What stops this
//! early is a [`stop_reason::StopReason`], answers that mostly fail in one way among them ([`judge`]). A [`report`]
//! shows what the server then says, and [`verify`] replays all journals.

pub mod conduct;
pub mod conversation;
pub mod entry;
pub mod experiment;
pub mod judge;
pub mod lanes;
mod list;
pub mod plan;
pub mod report;
pub mod stop_reason;
pub mod system;
pub mod verify;
