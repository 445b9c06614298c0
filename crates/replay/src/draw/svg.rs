//! Scenes as SVG.

use std::fmt::{Display, Formatter, Result, Write};

use super::font::FAMILY;
use super::palette::{Color, PAPER};
use super::scene::{Anchor, Paint, Point, Scene, Shape, Text};

/// Writes a scene as an SVG document. The same scene gives the same bytes.
#[must_use]
pub fn svg(scene: &Scene) -> String {
    let mut out = String::new();
    write(&mut out, scene).expect("a string takes everything");
    out
}

fn write(out: &mut String, scene: &Scene) -> Result {
    let (width, height) = (Number(scene.width), Number(scene.height));
    writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"{FAMILY}, Verdana, sans-serif\">\n<title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" \
         fill=\"{}\"/>",
        Escaped(&scene.title),
        Hex(PAPER)
    )?;
    for shape in &scene.shapes {
        match shape {
            Shape::Rect(area, paint) => write!(
                out,
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"{}/>",
                Number(area.x),
                Number(area.y),
                Number(area.width),
                Number(area.height),
                Painted(*paint)
            )?,
            Shape::Circle((x, y), radius, paint) => write!(
                out,
                "<circle cx=\"{}\" cy=\"{}\" r=\"{}\"{}/>",
                Number(*x),
                Number(*y),
                Number(*radius),
                Painted(*paint)
            )?,
            Shape::Path(points, paint) => write_path(out, points, *paint)?,
            Shape::Text(text) => write_text(out, text)?,
        }
        out.push('\n');
    }
    out.write_str("</svg>\n")
}

fn write_path(out: &mut String, points: &[Point], paint: Paint) -> Result {
    out.write_str("<path d=\"")?;
    for (number, (x, y)) in points.iter().enumerate() {
        let step = if number == 0 { 'M' } else { 'L' };
        write!(out, "{step}{} {}", Number(*x), Number(*y))?;
    }
    let end = if paint.fill.is_some() { "Z" } else { "" };
    write!(out, "{end}\"{}/>", Painted(paint))
}

fn write_text(out: &mut String, text: &Text) -> Result {
    let (x, y) = (Number(text.at.0), Number(text.at.1));
    write!(out, "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\"", Number(text.size))?;
    match text.anchor {
        Anchor::Start => {}
        Anchor::Middle => out.write_str(" text-anchor=\"middle\"")?,
        Anchor::End => out.write_str(" text-anchor=\"end\"")?,
    }
    write!(out, " fill=\"{}\">{}</text>", Hex(text.color), Escaped(&text.text))
}

/// A number with at most two decimals, that is hundredths of a pixel.
pub(crate) struct Number(pub f64);

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let text = format!("{:.2}", self.0);
        let text = text.trim_end_matches('0').trim_end_matches('.');
        f.write_str(if text == "-0" { "0" } else { text })
    }
}

struct Hex(Color);

impl Display for Hex {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let Color(red, green, blue) = self.0;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}

struct Painted(Paint);

impl Display for Painted {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self.0.fill {
            None => f.write_str(" fill=\"none\"")?,
            Some(color) => write!(f, " fill=\"{}\"", Hex(color))?,
        }
        let Some(stroke) = self.0.stroke else { return Ok(()) };
        write!(f, " stroke=\"{}\" stroke-width=\"{}\"", Hex(stroke.color), Number(stroke.width))
    }
}

/// A text with its XML markup escaped.
struct Escaped<'a>(&'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        for c in self.0.chars() {
            match c {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                c => f.write_char(c)?,
            }
        }
        Ok(())
    }
}
