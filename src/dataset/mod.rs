//! The data format of the public toolkit, both ways, and tables of episodes, acts and rounds for data people.
//!
//! [`mod@format`] has the shapes of the format's files. [`header`] reads what a stored episode tells without a replay;
//! [`game`] plays it again, round by round; [`export`] writes it into [`files`], as tables in JSON Lines ([`tables`]) or in Parquet
//! ([`columns`]). [`read`] reads such files, which are untrusted, within [`bounds`], and makes rows for the store of
//! them ([`imported`]). [`measure`] computes metrics of both, [`replay`] the states of imported games as they are sent. [`rows`] reads tables. The format field by field:
//! `docs/evaluate/dataset.md`.

pub mod bounds;
pub mod columns;
pub mod export;
pub mod files;
pub mod format;
pub mod game;
pub mod header;
pub mod imported;
pub mod measure;
pub mod read;
pub mod replay;
pub mod rows;
pub mod tables;
