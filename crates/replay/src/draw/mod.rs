//! Pictures of a game: a scene of shapes, written as SVG, PNG, GIF or Y4M.
//!
//! [`frame`] lays out a state as a [`Scene`], a list of shapes, which [`svg()`] writes, [`png()`] renders, and [`Canvas`]
//! draws into the frames of a [`Film`]. The same game gives the same bytes. Texts of players are never interpreted.
//!
//! Colours are those of Okabe and Ito, and colour alone never distinguishes anything: cells have letters and numbers.

pub mod font;
pub mod frame;
pub mod moments;
pub mod palette;
pub mod scene;

mod canvas;
mod film;
mod png;
mod scale;
mod svg;

pub use canvas::Canvas;
pub use film::{FRAMES_PER_SECOND_MAX, Film, FilmError, Gif, Y4m};
pub use png::{PNG_PIXELS_MAX, TooLarge, png};
pub use scene::Scene;
pub use svg::svg;
