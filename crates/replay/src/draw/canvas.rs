//! Scenes as indexed pixels: frames of a replay need few colours, and there are thousands of frames.

use std::collections::BTreeMap;

use super::palette::{AXIS, Color, GROUND, INK, MUTED, PAPER, RULE};
use super::png::Picture;
use super::scene::Scene;

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
/// Colours outside the palette become the nearest one: those of edges, which are blends.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: usize,
    height: usize,
    picture: Picture,
    pixels: Vec<u8>,
    palette: Vec<Color>,
    /// Indices of the colours that were drawn so far.
    indices: BTreeMap<Color, u8>,
}

impl Canvas {
    /// An empty canvas with the size of a scene.
    ///
    /// # Panics
    /// If the scene has no pixels.
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
            picture: Picture::new(scene, 1.0).expect("a frame has pixels"),
            pixels: vec![0; width * height],
            palette: palette(),
            indices: BTreeMap::new(),
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
        self.picture.draw(scene);
        // Most pixels have the colour of the one before.
        let (mut last, mut index) = (self.palette[0], 0);
        for (pixel, color) in self.pixels.iter_mut().zip(self.picture.colors()) {
            if color != last {
                let nearest = || nearest(&self.palette, color);
                (last, index) = (color, *self.indices.entry(color).or_insert_with(nearest));
            }
            *pixel = index;
        }
    }
}

/// The index of the colour that is nearest to another.
fn nearest(palette: &[Color], color: Color) -> u8 {
    let distance = |other: &Color| {
        let part = |a: u8, b: u8| i32::from(a.abs_diff(b)).pow(2);
        part(color.0, other.0) + part(color.1, other.1) + part(color.2, other.2)
    };
    let nearest = (0..).zip(palette).min_by_key(|(_, other)| distance(other));
    nearest.map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Anchor, Area, Paint};
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
        let (blue, black) =
            [Color::BLUE, Color::BLACK].map(|color| nearest(&canvas.palette, color)).into();
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
