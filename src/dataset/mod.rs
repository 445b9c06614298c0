//! Import and export of the public toolkit's data format, and tables of episodes, acts and rounds for analysts.
//!
//! [`mod@format`] defines the files. [`header`] reads facts about a stored episode that need no replay; [`game`] replays it
//! round by round; [`export`] writes it into [`files`], as tables in JSON Lines ([`tables`]) or in Parquet ([`columns`]).
//! [`read`] reads files of the format, which are untrusted, within [`bounds`], and converts them to rows of the store
//! ([`imported`]). [`measure`] computes metrics of exported and imported games, [`replay`] replay pages of imported games.
//! [`rows`] reads tables. `docs/evaluate/dataset.md` describes every field.

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
