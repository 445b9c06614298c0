//! What the server and its clients exchange: the shapes of the JSON, suites, and the rules for names.
//!
//! A crate of its own so that a client is built without the server. The shapes are fixed by the wire contract
//! (`docs/protocol.md`); a program with types of its own converts them explicitly, so that its types can change. With the
//! feature `openapi` they describe themselves.

/// Defines a page of a list.
macro_rules! page {
    ($(#[$meta:meta])* $name:ident of $item:ident) => {
        $(#[$meta])*
        #[derive(Clone, Debug, Serialize, Deserialize)]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        pub struct $name {
            /// The items of this page.
            pub items: Vec<$item>,
            /// Where the next page begins; null on the last.
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
pub mod node;
pub mod observation;
pub mod problem;
pub mod replay;
pub mod run;
pub mod settings;
pub mod status;
pub mod suite;
pub mod table;
pub mod time;

use serde::{Deserialize, Serialize};
use swarmbench_engine::Pos;

/// A cell: row `i` grows downward, column `j` to the right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Position {
    /// The row.
    pub i: i32,
    /// The column.
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

/// A duration in seconds; whole numbers are written without a fraction.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(value_type = f64))]
pub struct Seconds(pub f64);

impl Seconds {
    /// The seconds of a duration.
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
