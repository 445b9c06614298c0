//! Types that the server and its clients exchange: shapes of the JSON, suites, and the rules for names.
//!
//! The crate is separate so that clients build without the server. The shapes are fixed by the wire contract
//! (`docs/protocol.md`); programs with types of their own convert them explicitly, so that these types can change. The feature
//! `openapi` adds the descriptions for the OpenAPI document.

/// Defines a page of a list.
macro_rules! page {
    ($(#[$meta:meta])* $name:ident of $item:ident) => {
        $(#[$meta])*
        #[derive(Clone, Debug, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        pub struct $name {
            /// Items of this page.
            pub items: Vec<$item>,
            /// Cursor of the next page; null on the last page.
            pub next_cursor: Option<String>,
        }
    };
}

pub mod act;
pub mod any_case;
pub mod board;
pub mod carried;
pub mod claim;
pub mod clock;
pub mod competition;
pub mod episode;
pub mod failure;
pub mod import;
pub mod key;
pub mod loopback;
pub mod metrics;
pub mod names;
pub mod observation;
pub mod problem;
pub mod replay;
pub mod run;
pub mod server;
pub mod settings;
pub mod status;
pub mod suite;
pub mod table;
pub mod time;
pub mod worth;

use serde::{Deserialize, Serialize};
use swarmbench_engine::Pos;

/// Cell of the map: row `i` grows downward, column `j` to the right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Position {
    /// Row of the cell.
    pub i: i32,
    /// Column of the cell.
    pub j: i32,
}

impl From<Pos> for Position {
    fn from(at: Pos) -> Self {
        Self { i: at.i, j: at.j }
    }
}

impl From<Position> for Pos {
    fn from(at: Position) -> Self {
        Self::new(at.i, at.j)
    }
}

/// Duration in seconds; whole numbers are written without a fraction.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(value_type = f64))]
pub struct Seconds(pub f64);

impl Seconds {
    /// Seconds of a duration.
    #[must_use]
    pub fn of(duration: std::time::Duration) -> Self {
        Self(duration.as_secs_f64())
    }
}

impl Serialize for Seconds {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole, positive, and far below the limit of the type"
        )]
        if self.0.fract() == 0.0 && (0.0..1e15).contains(&self.0) {
            serializer.serialize_u64(self.0 as u64)
        } else {
            serializer.serialize_f64(self.0)
        }
    }
}
