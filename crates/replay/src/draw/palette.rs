//! Colours that colour-blind readers can distinguish (Okabe and Ito, 2008).

/// A colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Color(pub u8, pub u8, pub u8);

#[expect(missing_docs, reason = "the names are those of the publication")]
impl Color {
    pub const BLACK: Self = Self(0, 0, 0);
    pub const ORANGE: Self = Self(230, 159, 0);
    pub const SKY_BLUE: Self = Self(86, 180, 233);
    pub const GREEN: Self = Self(0, 158, 115);
    pub const YELLOW: Self = Self(240, 228, 66);
    pub const BLUE: Self = Self(0, 114, 178);
    pub const VERMILLION: Self = Self(213, 94, 0);
    pub const PURPLE: Self = Self(204, 121, 167);

    pub const WHITE: Self = Self(255, 255, 255);
}

/// The eight colours.
pub const OKABE_ITO: [Color; 8] = [
    Color::BLACK,
    Color::ORANGE,
    Color::SKY_BLUE,
    Color::GREEN,
    Color::YELLOW,
    Color::BLUE,
    Color::VERMILLION,
    Color::PURPLE,
];

/// The colour of text.
pub const INK: Color = Color::grey(0x1A);
/// The colour of secondary text.
pub const MUTED: Color = Color::grey(0x59);
/// The colour of cells outside the map.
pub const AXIS: Color = Color::grey(0x80);
/// The colour of the lines between cells.
pub const RULE: Color = Color::grey(0xE0);
/// The ground of maps and curves.
pub const GROUND: Color = Color::grey(0xF2);
/// The ground of pictures.
pub const PAPER: Color = Color::WHITE;

impl Color {
    /// A grey.
    #[must_use]
    pub const fn grey(level: u8) -> Self {
        Self(level, level, level)
    }

    /// Mixes the colour with a `share` of another: 0 is this colour, 1 the other.
    #[must_use]
    pub fn mixed(self, other: Self, share: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=255")]
        let mix = |a: u8, b: u8| {
            f64::from(a).mul_add(1.0 - share, f64::from(b) * share).round().clamp(0.0, 255.0) as u8
        };
        Self(mix(self.0, other.0), mix(self.1, other.1), mix(self.2, other.2))
    }

    /// The relative luminance, from 0 to 1 (WCAG 2).
    #[must_use]
    pub fn luminance(self) -> f64 {
        let linear = |part: u8| {
            let part = f64::from(part) / 255.0;
            if part <= 0.040_45 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(self.0) + 0.7152 * linear(self.1) + 0.0722 * linear(self.2)
    }

    /// The contrast of two colours, from 1 to 21 (WCAG 2).
    #[must_use]
    pub fn contrast(self, other: Self) -> f64 {
        let (a, b) = (self.luminance(), other.luminance());
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    /// The colour of text on this ground: black or white, whichever is more legible.
    #[must_use]
    pub fn text_on(self) -> Self {
        if self.contrast(Self::WHITE) >= self.contrast(Self::BLACK) {
            Self::WHITE
        } else {
            Self::BLACK
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_can_be_read_on_their_grounds() {
        // WCAG 2 requires 4.5 for small text, and 3 for shapes.
        for (text, ground) in [(INK, PAPER), (MUTED, PAPER), (INK, GROUND), (MUTED, GROUND)] {
            assert!(text.contrast(ground) >= 4.5, "{text:?} on {ground:?}");
        }
        for ground in OKABE_ITO {
            assert!(ground.text_on().contrast(ground) >= 4.5, "{ground:?}");
        }
        assert!((Color::BLACK.contrast(Color::WHITE) - 21.0).abs() < 1e-9);
        assert!((Color::grey(0x76).contrast(Color::WHITE) - 4.54).abs() < 0.005);
    }
}
