//! Evaluations as researchers run them: the real program, on databases and servers of its own, with models that are
//! played by a server of the test.

mod attempts;
mod bench;
mod boards;
mod experiments;
mod failing;
mod harness;
mod models;
mod money;
mod players;
mod prompts;
mod resume;
mod side_by_side;
mod teams;
