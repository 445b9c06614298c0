//! Fuzz targets: what comes from outside, in forms that nobody thought of. docs/develop/testing.md says how to run them
//! for longer.

mod act;
mod answer;
mod carried;
mod journal;
mod lockstep;
mod template;
