//! Fuzz targets: what comes from outside, in forms that nobody thought of. docs/develop/testing.md says how to run them
//! for longer. (The target of `POST /act` is beside its code, in `src/http/agent/act.rs`.)

mod answer;
mod carried;
mod journal;
mod lockstep;
mod template;
