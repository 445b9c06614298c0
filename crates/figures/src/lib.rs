//! Figures of many games and replays of one, as SVG, PNG, GIF and Y4M.
//!
//! A figure is a struct with its numbers. [`Figure::scene`] lays it out as a [`Scene`], a list of shapes, which
//! [`svg()`] writes, [`png()`] renders, and [`Canvas`] draws into the frames of a [`Film`]. The same numbers give the
//! same bytes. Texts of players are never interpreted.
//! numbers give the same bytes. Text of players is text only.
//!
//! Colours are those of Okabe and Ito, and colour alone never distinguishes anything: lines have dashes and markers,
//! cells have letters and numbers, bars are hatched.
//!
//! The crate is separate because nothing else needs fonts and encoders, and figures are made without a server.

pub mod board;
pub mod dynamics;
pub mod font;
pub mod frame;
pub mod palette;
pub mod scene;
pub mod sensitivity;
pub mod series;
pub mod trends;

mod canvas;
mod chart;
mod film;
mod png;
mod svg;

pub use canvas::Canvas;
pub use film::{FRAMES_PER_SECOND_MAX, Film, FilmError, Gif, Y4m};
pub use png::{PNG_PIXELS_MAX, TooLarge, png};
pub use scene::Scene;
pub use svg::svg;

/// Numbers that can be drawn.
pub trait Figure {
    /// The picture.
    fn scene(&self) -> Scene;

    /// The numbers behind the picture.
    fn data(&self) -> Data;
}

/// The numbers behind a figure, as a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Data {
    /// The names of the columns.
    pub columns: Vec<&'static str>,
    /// The rows; a cell without a value is empty.
    pub rows: Vec<Vec<String>>,
}

impl Data {
    pub(crate) fn new(columns: &[&'static str]) -> Self {
        Self { columns: columns.to_vec(), rows: Vec::new() }
    }

    /// The table as CSV, with a header.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut out = csv::Writer::from_writer(Vec::new());
        out.write_record(&self.columns).expect("a buffer takes everything");
        for row in &self.rows {
            out.write_record(row).expect("a buffer takes everything");
        }
        let bytes = out.into_inner().expect("a buffer takes everything");
        String::from_utf8(bytes).expect("made of texts")
    }
}

/// A cell, empty without a value.
fn cell(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
