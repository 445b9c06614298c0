//! Moments of a game side by side, as one picture.

use super::font;
use super::frame::{Moment, draw_map, message_lines, size};
use super::palette::{INK, MUTED};
use super::scale::{HEADING, LABEL, MARGIN, TITLE, number, real};
use super::scene::{Anchor, Scene};

/// Maximum moments of a picture.
pub const MOMENTS_MAX: usize = 24;

/// Moments of a game side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Moments {
    /// The title.
    pub title: String,
    /// The moments, at most [`MOMENTS_MAX`].
    pub moments: Vec<Moment>,
    /// True if messages stand below each map.
    pub messages: bool,
}

const SIGNS: &str = "Arrow: chosen move; empty arrow with a bar: blocked; ?: no action; S: switches its light; no sign: stays";

impl Moments {
    fn cell(&self) -> f64 {
        let cells = self.moments.first().map_or(10, |moment| size(moment).0.max(size(moment).1));
        (280.0 / real(cells)).floor().clamp(4.0, 28.0)
    }

    fn lines(&self, moment: &Moment, room: f64) -> Vec<String> {
        if self.messages { message_lines(&moment.messages, room) } else { Vec::new() }
    }

    /// The picture.
    #[must_use]
    pub fn scene(&self) -> Scene {
        let cell = self.cell();
        let (rows, columns) = self.moments.first().map_or((0, 0), size);
        let (width, height) = (real(columns) * cell, real(rows) * cell);
        // Text needs more room than a small map.
        let room = if self.messages { width.max(220.0) } else { width.max(110.0) };
        let across = self.moments.len().clamp(1, 4);
        let page = MARGIN.mul_add(2.0, real(across) * (room + MARGIN) - MARGIN).max(360.0);
        let line_height = LABEL + 4.0;
        let below: Vec<f64> = (self.moments.chunks(across))
            .map(|row| row.iter().map(|moment| self.lines(moment, room).len()).max().unwrap_or(0))
            .map(|lines| height + 26.0 + real(lines) * line_height + MARGIN)
            .collect();
        let top = heading_height(page);
        let mut scene = Scene::new(page, top + below.iter().sum::<f64>(), &self.title);
        let mut y = heading(&mut scene, &self.title);
        for (row, used) in self.moments.chunks(across).zip(below) {
            for (place, moment) in row.iter().enumerate() {
                let x = MARGIN + real(place) * (room + MARGIN);
                draw_map(&mut scene, (x, y), cell, moment);
                let caption = format!("round {}, score {}", moment.round, number(moment.score));
                let at = (x, y + height + 16.0);
                scene.text_within(at, room, (Anchor::Start, HEADING - 1.0, INK), &caption);
                for (line, text) in self.lines(moment, room).iter().enumerate() {
                    let at = (x, y + height + 32.0 + real(line) * line_height);
                    scene.text(at, Anchor::Start, LABEL, INK, text);
                }
            }
            y += used;
        }
        scene
    }
}

/// Draws the title, and what the signs mean; returns the vertical coordinate below both.
fn heading(scene: &mut Scene, title: &str) -> f64 {
    let room = scene.width - 2.0 * MARGIN;
    scene.text_within((MARGIN, 24.0), room, (Anchor::Start, TITLE, INK), title);
    let mut y = 24.0;
    for line in font::wrap(SIGNS, LABEL, room) {
        y += 15.0;
        scene.text((MARGIN, y), Anchor::Start, LABEL, MUTED, &line);
    }
    y + 12.0
}

/// The height that [`heading`] needs.
fn heading_height(width: f64) -> f64 {
    heading(&mut Scene::new(width, 0.0, ""), "")
}
