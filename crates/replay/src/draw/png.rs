//! Scenes as PNG.

use std::io::Write as _;

use ab_glyph::OutlineCurve;
use png::{BitDepth, ColorType, Encoder, EncodingError};
use tiny_skia::{FillRule, Path, PathBuilder, Pixmap, Rect, Stroke, Transform};

use super::font;
use super::palette::{Color, PAPER};
use super::scene::{Anchor, Area, Paint, Point, Scene, Shape, Text};

/// The maximum number of pixels of a picture, at four bytes of memory each.
pub const PNG_PIXELS_MAX: f64 = 100_000_000.0;

/// A picture is too large.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "a picture of {width:.0} × {height:.0} pixels is larger than the limit png_pixels_max = {PNG_PIXELS_MAX:.0}: take a \
     smaller --scale, or write SVG"
)]
pub struct TooLarge {
    width: f64,
    height: f64,
}

/// Renders a scene as a PNG file with `scale` pixels for each unit. Fonts of the machine are not used.
///
/// # Errors
/// If the picture has more than [`PNG_PIXELS_MAX`] pixels.
pub fn png(scene: &Scene, scale: f64) -> Result<Vec<u8>, TooLarge> {
    let (width, height) = ((scene.width * scale).ceil(), (scene.height * scale).ceil());
    let too_large = TooLarge { width, height };
    if width * height > PNG_PIXELS_MAX {
        return Err(too_large);
    }
    let mut picture = Picture::new(scene, scale).ok_or(too_large)?;
    picture.draw(scene);
    Ok(picture.encoded().expect("a buffer takes everything"))
}

/// Pixels of a scene.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pixels: Pixmap,
    scale: Transform,
}

impl Picture {
    /// An empty picture with the size of a scene; `None` if it has no pixels, or too many.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "pixels of a picture"
    )]
    pub(super) fn new(scene: &Scene, scale: f64) -> Option<Self> {
        let [width, height] = [scene.width, scene.height].map(|side| (side * scale).ceil() as u32);
        let scale = Transform::from_scale(single(scale), single(scale));
        Some(Self { pixels: Pixmap::new(width, height)?, scale })
    }

    /// Draws a scene over everything.
    pub(super) fn draw(&mut self, scene: &Scene) {
        let Color(red, green, blue) = PAPER;
        self.pixels.fill(tiny_skia::Color::from_rgba8(red, green, blue, 255));
        for shape in &scene.shapes {
            self.shape(shape);
        }
    }

    /// The colours of all pixels, row by row. The ground of a picture is opaque, so its pixels are too.
    pub(super) fn colors(&self) -> impl Iterator<Item = Color> {
        let pixels = self.pixels.pixels().iter();
        pixels.map(|pixel| Color(pixel.red(), pixel.green(), pixel.blue()))
    }

    /// The picture as a PNG file.
    fn encoded(&self) -> Result<Vec<u8>, EncodingError> {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, self.pixels.width(), self.pixels.height());
        encoder.set_color(ColorType::Rgb);
        encoder.set_depth(BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        let mut rows = writer.stream_writer()?;
        for Color(red, green, blue) in self.colors() {
            rows.write_all(&[red, green, blue])?;
        }
        rows.finish()?;
        writer.finish()?;
        Ok(file)
    }

    fn shape(&mut self, shape: &Shape) {
        match shape {
            Shape::Rect(area, paint) => self.paint(rectangle(*area), *paint),
            Shape::Circle((x, y), radius, paint) => {
                self.paint(
                    PathBuilder::from_circle(single(*x), single(*y), single(*radius)),
                    *paint,
                );
            }
            Shape::Path(points, paint) => self.paint(lines(points, paint.fill.is_some()), *paint),
            Shape::Text(text) => self.write(text),
        }
    }

    /// Fills a path, then draws its outline. A path without points or size paints nothing.
    fn paint(&mut self, path: Option<Path>, paint: Paint) {
        let Some(path) = path else { return };
        if let Some(color) = paint.fill {
            self.fill(&path, color);
        }
        let Some(stroke) = paint.stroke else { return };
        let line = Stroke { width: single(stroke.width), ..Stroke::default() };
        self.pixels.stroke_path(&path, &ink(stroke.color), &line, self.scale, None);
    }

    fn fill(&mut self, path: &Path, color: Color) {
        self.pixels.fill_path(path, &ink(color), FillRule::Winding, self.scale, None);
    }

    fn write(&mut self, text: &Text) {
        let width = font::width(&text.text, text.size);
        let left = match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => width / 2.0,
            Anchor::End => width,
        };
        let mut outlines = PathBuilder::new();
        let mut at = (text.at.0 - left, text.at.1);
        for c in text.text.chars() {
            outline(&mut outlines, c, at, text.size);
            at.0 += font::advance(c, text.size);
        }
        if let Some(path) = outlines.finish() {
            self.fill(&path, text.color);
        }
    }
}

fn ink(Color(red, green, blue): Color) -> tiny_skia::Paint<'static> {
    let mut paint = tiny_skia::Paint::default();
    paint.set_color_rgba8(red, green, blue, 255);
    paint
}

fn rectangle(area: Area) -> Option<Path> {
    let [x, y, width, height] = [area.x, area.y, area.width, area.height].map(single);
    Rect::from_xywh(x, y, width, height).map(PathBuilder::from_rect)
}

fn lines(points: &[Point], is_closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (number, &(x, y)) in points.iter().enumerate() {
        if number == 0 {
            path.move_to(single(x), single(y));
        } else {
            path.line_to(single(x), single(y));
        }
    }
    if is_closed {
        path.close();
    }
    path.finish()
}

/// Adds the outline of a character whose origin is `at`.
fn outline(path: &mut PathBuilder, c: char, at: Point, size: f64) {
    let place = |point: ab_glyph::Point| {
        let scale = size / font::units();
        let (x, y) = (f64::from(point.x) * scale, f64::from(point.y) * scale);
        (single(at.0 + x), single(at.1 - y))
    };
    let mut end = None;
    for curve in font::outline(c) {
        let (from, to) = match curve {
            OutlineCurve::Line(from, to)
            | OutlineCurve::Quad(from, _, to)
            | OutlineCurve::Cubic(from, _, _, to) => (from, to),
        };
        if end != Some(from) {
            let (x, y) = place(from);
            path.move_to(x, y);
        }
        let (x, y) = place(to);
        match curve {
            OutlineCurve::Line(..) => path.line_to(x, y),
            OutlineCurve::Quad(_, control, _) => {
                let (x1, y1) = place(control);
                path.quad_to(x1, y1, x, y);
            }
            OutlineCurve::Cubic(_, first, second, _) => {
                let ((x1, y1), (x2, y2)) = (place(first), place(second));
                path.cubic_to(x1, y1, x2, y2, x, y);
            }
        }
        end = Some(to);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a place in a picture")]
fn single(number: f64) -> f32 {
    number as f32
}
