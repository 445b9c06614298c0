//! Competitions.

mod board;
mod change;
mod closing;
mod codes;
mod create;
mod export;
mod list;
mod register;
mod show;
mod start;
mod void;
