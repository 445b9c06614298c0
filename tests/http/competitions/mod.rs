//! Competitions.

mod announcements;
mod board;
mod change;
mod closing;
mod codes;
mod create;
mod entrant;
mod export;
mod judge;
mod list;
mod mend;
mod register;
mod show;
mod start;
mod void;
