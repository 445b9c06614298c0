//! Exports: many episodes in one file.

pub(super) mod download;
