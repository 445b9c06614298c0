//! A picture as a list of shapes, in the order in which they are painted.

use super::font;
use super::palette::Color;
use swarmbench_protocol::names::printable;

/// A picture. One unit is one pixel of an unscaled PNG or of a frame of a replay; y grows downwards.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The width.
    pub width: f64,
    /// The height.
    pub height: f64,
    /// A description for readers that cannot see the picture.
    pub title: String,
    /// The shapes, the lowest first.
    pub shapes: Vec<Shape>,
}

/// A shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A rectangle.
    Rect(Area, Paint),
    /// A circle around a point.
    Circle(Point, f64, Paint),
    /// Straight lines through points; closed if filled.
    Path(Vec<Point>, Paint),
    /// A line of text.
    Text(Text),
}

/// A point: x, y.
pub type Point = (f64, f64);

/// A rectangle whose sides are parallel to the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Area {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

/// The paint of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paint {
    /// The colour of the inside.
    pub fill: Option<Color>,
    /// The outline.
    pub stroke: Option<Stroke>,
}

/// An outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// The colour.
    pub color: Color,
    /// The width.
    pub width: f64,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// The point of the base line at which the text is anchored.
    pub at: Point,
    /// The anchor.
    pub anchor: Anchor,
    /// The size of the font.
    pub size: f64,
    /// The colour.
    pub color: Color,
    /// The text, without characters that no picture can show.
    pub text: String,
}

/// The part of a text that lies at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Anchor {
    Start,
    Middle,
    End,
}

impl Area {
    /// A rectangle.
    #[must_use]
    pub const fn new(x: f64, y: f64, width: f64, height: f64) -> Self {
        Self { x, y, width, height }
    }

    /// The right side.
    #[must_use]
    pub fn right(self) -> f64 {
        self.x + self.width
    }

    /// The lower side.
    #[must_use]
    pub fn bottom(self) -> f64 {
        self.y + self.height
    }
}

impl Paint {
    /// An inside without an outline.
    #[must_use]
    pub const fn fill(color: Color) -> Self {
        Self { fill: Some(color), stroke: None }
    }

    /// A line.
    #[must_use]
    pub const fn line(color: Color, width: f64) -> Self {
        Self { fill: None, stroke: Some(Stroke { color, width }) }
    }

    /// Adds an outline.
    #[must_use]
    pub const fn outlined(self, color: Color, width: f64) -> Self {
        Self { stroke: Some(Stroke { color, width }), ..self }
    }
}

impl Scene {
    /// An empty picture. Its sides are rounded up to even numbers, which video encoders require.
    #[must_use]
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        let even = |side: f64| (side / 2.0).ceil() * 2.0;
        let (width, height) = (even(width), even(height));
        Self { width, height, title: printable(title), shapes: Vec::new() }
    }

    /// Adds a rectangle.
    pub fn rect(&mut self, area: Area, paint: Paint) {
        self.shapes.push(Shape::Rect(area, paint));
    }

    /// Adds a circle.
    pub fn circle(&mut self, center: Point, radius: f64, paint: Paint) {
        self.shapes.push(Shape::Circle(center, radius, paint));
    }

    /// Adds lines through points, or a polygon if `paint` fills.
    pub fn path(&mut self, points: Vec<Point>, paint: Paint) {
        self.shapes.push(Shape::Path(points, paint));
    }

    /// Adds a straight line.
    pub fn line(&mut self, from: Point, to: Point, paint: Paint) {
        self.path(vec![from, to], paint);
    }

    /// Adds a text.
    pub fn text(&mut self, at: Point, anchor: Anchor, size: f64, color: Color, text: &str) {
        let text = printable(text);
        self.shapes.push(Shape::Text(Text { at, anchor, size, color, text }));
    }

    /// Adds a text, shortened in its middle to at most `width`.
    pub fn text_within(
        &mut self,
        at: Point,
        width: f64,
        (anchor, size, color): (Anchor, f64, Color),
        text: &str,
    ) {
        self.text(at, anchor, size, color, &font::fit(&printable(text), size, width));
    }
}
