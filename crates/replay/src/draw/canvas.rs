//! Scenes as indexed pixels: frames of a replay need few colours, and there are thousands of frames.

use std::collections::BTreeMap;

use super::font::{self, Bitmap};
use super::palette::{AXIS, Color, GROUND, INK, MUTED, PAPER, RULE};
use super::scale::real;
use super::scene::{Anchor, Area, Paint, Point, Scene, Shape, Text};

/// Levels of an edge between two colours.
const LEVELS: usize = 4;
/// Samples along each side of a pixel.
const SAMPLES: usize = 3;

/// The colours of all pixels, fewer than 64: those of frames, and the blends between a ground and its text.
#[must_use]
pub(crate) fn palette() -> Vec<Color> {
    let mut all = vec![PAPER, GROUND, RULE, AXIS, MUTED, INK];
    all.extend(super::palette::OKABE_ITO);
    all.extend([0x33, 0x4D, 0xA6, 0xC0].map(Color::grey));
    let between = [
        (Color::BLUE, PAPER),
        (Color::VERMILLION, PAPER),
        (Color::GREEN, PAPER),
        (Color::PURPLE, PAPER),
        (Color::SKY_BLUE, Color::BLACK),
        (Color::YELLOW, Color::BLACK),
        (Color::ORANGE, Color::BLACK),
        (Color::ORANGE, PAPER),
    ];
    for (a, b) in between {
        all.extend([0.25, 0.5, 0.75].map(|share| a.mixed(b, share)));
    }
    all
}

/// Pixels as indices into the palette.
///
/// Colours outside the palette become the nearest one: frames have none.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
    palette: Vec<Color>,
    /// The blended colour by ink, ground and level.
    blends: BTreeMap<(u8, u8, usize), u8>,
    /// Rendered glyphs by character and size in quarters of a pixel.
    glyphs: BTreeMap<(char, u32), Option<Bitmap>>,
}

impl Canvas {
    /// An empty canvas with the size of a scene.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "pixels of a picture"
    )]
    pub fn new(scene: &Scene) -> Self {
        let (width, height) = (scene.width as usize, scene.height as usize);
        Self {
            width,
            height,
            pixels: vec![0; width * height],
            palette: palette(),
            blends: BTreeMap::new(),
            glyphs: BTreeMap::new(),
        }
    }

    /// The width in pixels.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// The height in pixels.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row by row.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Draws a scene over everything.
    pub fn draw(&mut self, scene: &Scene) {
        self.pixels.fill(0);
        for shape in &scene.shapes {
            match shape {
                Shape::Rect(area, paint) => self.rect(*area, *paint),
                Shape::Circle(center, radius, paint) => self.circle(*center, *radius, *paint),
                Shape::Path(points, paint) => self.path(points, *paint),
                Shape::Text(text) => self.text(text),
            }
        }
    }

    fn index(&self, color: Color) -> u8 {
        let distance = |other: &Color| {
            let part = |a: u8, b: u8| i32::from(a.abs_diff(b)).pow(2);
            part(color.0, other.0) + part(color.1, other.1) + part(color.2, other.2)
        };
        let nearest = (0..).zip(&self.palette).min_by_key(|(_, other)| distance(other));
        nearest.map_or(0, |(index, _)| index)
    }

    /// Paints `level` of [`LEVELS`] of a colour onto a pixel.
    fn blend(&mut self, at: usize, ink: u8, level: usize) {
        let ground = self.pixels[at];
        self.pixels[at] = match level {
            0 => ground,
            LEVELS => ink,
            _ => self.between(ink, ground, level),
        };
    }

    fn between(&mut self, ink: u8, ground: u8, level: usize) -> u8 {
        if let Some(&known) = self.blends.get(&(ink, ground, level)) {
            return known;
        }
        let [from, to] = [ground, ink].map(|index| self.palette[usize::from(index)]);
        let between = self.index(from.mixed(to, real(level) / real(LEVELS)));
        self.blends.insert((ink, ground, level), between);
        between
    }

    /// Paints all points inside a shape whose bounds are `area`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the picture"
    )]
    fn fill(&mut self, area: Area, color: Color, inside: impl Fn(Point) -> bool) {
        let ink = self.index(color);
        let clamp = |at: f64, most: usize| at.clamp(0.0, real(most)) as usize;
        let columns = clamp(area.x.floor(), self.width)..clamp(area.right().ceil(), self.width);
        let rows = clamp(area.y.floor(), self.height)..clamp(area.bottom().ceil(), self.height);
        let part = |sample: usize| (real(sample) + 0.5) / real(SAMPLES);
        for row in rows {
            for column in columns.clone() {
                let samples = (0..SAMPLES * SAMPLES).filter(|sample| {
                    let (i, j) = (sample / SAMPLES, sample % SAMPLES);
                    inside((real(column) + part(j), real(row) + part(i)))
                });
                let covered = real(samples.count()) / real(SAMPLES * SAMPLES);
                let level = (covered * real(LEVELS)).round() as usize;
                self.blend(row * self.width + column, ink, level);
            }
        }
    }

    fn rect(&mut self, area: Area, paint: Paint) {
        if let Some(fill) = paint.fill {
            let (x, y) = (area.x..area.right(), area.y..area.bottom());
            self.fill(area, fill, |point| x.contains(&point.0) && y.contains(&point.1));
        }
        if paint.stroke.is_some() {
            let (left, right, top, bottom) = (area.x, area.right(), area.y, area.bottom());
            let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
            self.path(&corners, Paint { fill: None, ..paint });
        }
    }

    fn circle(&mut self, (x, y): Point, radius: f64, paint: Paint) {
        let around = |radius: f64| Area::new(x - radius, y - radius, 2.0 * radius, 2.0 * radius);
        let from = |point: Point| (point.0 - x).hypot(point.1 - y);
        if let Some(fill) = paint.fill {
            self.fill(around(radius), fill, |point| from(point) <= radius);
        }
        if let Some(stroke) = paint.stroke {
            let half = stroke.width / 2.0;
            self.fill(around(radius + half), stroke.color, |point| {
                (from(point) - radius).abs() <= half
            });
        }
    }

    fn path(&mut self, points: &[Point], paint: Paint) {
        if let Some(fill) = paint.fill {
            self.fill(bounds(points, 0.0), fill, |point| is_inside(points, point));
        }
        let Some(stroke) = paint.stroke else { return };
        let half = stroke.width / 2.0;
        let closing = paint.fill.and(points.first().zip(points.last()));
        let segments = points.windows(2).map(|pair| (pair[0], pair[1]));
        for (from, to) in segments.chain(closing.map(|(first, last)| (*last, *first))) {
            self.fill(bounds(&[from, to], half), stroke.color, |point| {
                distance(point, from, to) <= half
            });
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "pixels of a picture"
    )]
    fn text(&mut self, text: &Text) {
        let ink = self.index(text.color);
        let width = font::width(&text.text, text.size);
        let mut x = text.at.0
            - match text.anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => width,
            };
        let y = text.at.1.round() as i64;
        for c in text.text.chars() {
            let left = x.round() as i64;
            x += font::advance(c, text.size);
            let key = (c, (text.size * 4.0) as u32);
            let glyph = self.glyphs.entry(key).or_insert_with(|| font::bitmap(c, text.size));
            // The bitmap is taken out of the map, which must not be borrowed while the pixels change.
            let Some(glyph) = glyph.take() else { continue };
            for (row, line) in (0..).zip(glyph.coverage.chunks(glyph.width.max(1))) {
                for (column, covered) in (0..).zip(line) {
                    let at =
                        (left + i64::from(glyph.left) + column, y + i64::from(glyph.top) + row);
                    let Some(at) = self.place(at) else { continue };
                    let level = (f64::from(*covered) * real(LEVELS)).round() as usize;
                    self.blend(at, ink, level.min(LEVELS));
                }
            }
            self.glyphs.insert(key, Some(glyph));
        }
    }

    /// The index of a pixel, if it is inside the picture.
    fn place(&self, (x, y): (i64, i64)) -> Option<usize> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }
}

/// The rectangle around points, wider by `border` on each side.
fn bounds(points: &[Point], border: f64) -> Area {
    let (mut least, mut most) = ((f64::MAX, f64::MAX), (f64::MIN, f64::MIN));
    for point in points {
        least = (least.0.min(point.0), least.1.min(point.1));
        most = (most.0.max(point.0), most.1.max(point.1));
    }
    let (width, height) = (most.0 - least.0 + 2.0 * border, most.1 - least.1 + 2.0 * border);
    Area::new(least.0 - border, least.1 - border, width, height)
}

/// True if a point is inside a polygon: a ray to the left crosses its sides an odd number of times.
fn is_inside(polygon: &[Point], (x, y): Point) -> bool {
    let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
    let crossed = sides.filter(|&(&(ax, ay), &(bx, by))| {
        (ay > y) != (by > y) && x > (bx - ax) * (y - ay) / (by - ay) + ax
    });
    crossed.count() % 2 == 1
}

/// The distance of a point from a segment.
fn distance((x, y): Point, (ax, ay): Point, (bx, by): Point) -> f64 {
    let (dx, dy) = (bx - ax, by - ay);
    let length = dx.mul_add(dx, dy * dy);
    let along = if length > 0.0 { ((x - ax) * dx + (y - ay) * dy) / length } else { 0.0 };
    let along = along.clamp(0.0, 1.0);
    (x - along.mul_add(dx, ax)).hypot(y - along.mul_add(dy, ay))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_few_colours() {
        let palette = palette();
        assert!(palette.len() < 64, "{}", palette.len());
        assert_eq!(palette[0], PAPER, "an empty canvas is paper");
    }

    #[test]
    fn shapes_cover_their_pixels() {
        let mut scene = Scene::new(10.0, 4.0, "");
        scene.rect(Area::new(1.0, 1.0, 2.0, 2.0), Paint::fill(Color::BLUE));
        scene.line((5.0, 0.5), (9.0, 0.5), Paint::line(Color::BLACK, 1.0));
        let mut canvas = Canvas::new(&scene);
        canvas.draw(&scene);
        let (blue, black) = (canvas.index(Color::BLUE), canvas.index(Color::BLACK));
        let rows: Vec<&[u8]> = canvas.pixels().chunks(10).collect();
        assert_eq!(rows[0][5..9], [black; 4]);
        for (i, row) in rows.iter().enumerate().skip(1) {
            let expected = if i < 3 { [0, blue, blue, 0] } else { [0; 4] };
            assert_eq!(row[..4], expected, "row {i}");
        }
    }

    #[test]
    fn characters_that_the_font_lacks_are_boxes() {
        let draw = |text: &str| {
            let mut scene = Scene::new(40.0, 20.0, "");
            scene.text((2.0, 16.0), Anchor::Start, 14.0, INK, text);
            let mut canvas = Canvas::new(&scene);
            canvas.draw(&scene);
            canvas.pixels().to_vec()
        };
        assert_ne!(draw("語"), draw(" "), "a box has ink");
        assert_eq!(draw("語"), draw("한"));
        assert_ne!(draw("語"), draw("a"));
    }
}
