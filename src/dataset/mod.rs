//! The data format of the public toolkit, both ways, and tables of acts and rounds for data people.
//!
//! [`mod@format`] has the shapes of the format's files. [`game`] plays a stored episode again, round by
//! round; [`export`] writes what comes of it: [`files`] says where to, [`tables`] are JSON Lines and
//! [`columns`] is Parquet. [`read`] reads such files, which anybody may have written, within the bounds of
//! [`bounds`], and makes of each a game that the store can keep. The format field by field: `docs/evaluate/dataset.md`.

pub mod bounds;
pub mod columns;
pub mod export;
pub mod files;
pub mod format;
pub mod game;
pub mod imported;
pub mod read;
pub mod tables;
