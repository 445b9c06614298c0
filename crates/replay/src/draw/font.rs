//! The built-in font and the measurement of its texts: `DejaVu` Sans, with the Latin, Greek and Cyrillic letters and
//! the signs that pictures use, without hinting and kerning.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, OutlineCurve};

/// The font file. Its licence is beside it.
static FILE: &[u8] = include_bytes!("../../assets/DejaVuSans.ttf");

/// The name of the font.
pub const FAMILY: &str = "DejaVu Sans";

static FONT: LazyLock<FontRef<'static>> =
    LazyLock::new(|| FontRef::try_from_slice(FILE).expect("the font is part of the program"));

/// The width of a text. A character that the font lacks is as wide as the box that is drawn for it.
#[must_use]
pub fn width(text: &str, size: f64) -> f64 {
    text.chars().map(|c| advance(c, size)).sum()
}

/// The distance from a character to the next one.
#[must_use]
pub fn advance(c: char, size: f64) -> f64 {
    f64::from(FONT.h_advance_unscaled(FONT.glyph_id(c))) * size / units()
}

/// Units of the font in a size.
pub(crate) fn units() -> f64 {
    f64::from(FONT.units_per_em().expect("the font is part of the program"))
}

/// The outline of a character around its origin, in units of the font; y grows upwards. Empty without ink.
pub(crate) fn outline(c: char) -> Vec<OutlineCurve> {
    FONT.outline(FONT.glyph_id(c)).map(|outline| outline.curves).unwrap_or_default()
}

/// Shortens a text to the width `room`: a long text keeps both ends with `…` between them, so that names with a
/// common beginning differ.
#[must_use]
pub fn fit(text: &str, size: f64, room: f64) -> String {
    if width(text, size) <= room {
        return text.to_owned();
    }
    let chars: Vec<char> = text.chars().collect();
    let mut left = room - advance('…', size);
    let (mut first, mut last) = (0, chars.len());
    while first < last {
        let takes_first = first + last <= chars.len();
        let next = advance(if takes_first { chars[first] } else { chars[last - 1] }, size);
        if next > left {
            break;
        }
        left -= next;
        if takes_first {
            first += 1;
        } else {
            last -= 1;
        }
    }
    chars[..first].iter().chain(&['…']).chain(&chars[last..]).collect()
}

/// Breaks a text into lines of at most the width `room`, at spaces where possible.
#[must_use]
pub fn wrap(text: &str, size: f64, room: f64) -> Vec<String> {
    let mut lines = Vec::new();
    let mut line = String::new();
    let mut used = 0.0;
    for c in text.chars() {
        let next = advance(c, size);
        if used + next > room && !line.is_empty() {
            // A word that began late in the line moves to the next one.
            let rest = match line.rfind(' ') {
                Some(space) if space > line.len() / 2 => line.split_off(space + 1),
                _ => String::new(),
            };
            used = width(&rest, size);
            lines.push(std::mem::replace(&mut line, rest));
        }
        line.push(c);
        used += next;
    }
    lines.push(line);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_keep_both_ends() {
        assert_eq!(fit("short", 10.0, 100.0), "short");
        let long = format!("a{}z", "m".repeat(200));
        let cut = fit(&long, 10.0, 100.0);
        assert!(cut.starts_with("am") && cut.contains('…') && cut.ends_with("mz"), "{cut}");
        assert!(width(&cut, 10.0) <= 100.0);
        assert_eq!(fit("mmm", 10.0, 0.0), "…");
    }

    #[test]
    fn lines_are_never_too_wide_and_lose_nothing_but_spaces() {
        let text = "go to (3,4) and wait there, Donaudampfschifffahrtsgesellschaft";
        let lines = wrap(text, 10.0, 90.0);
        assert!(lines.len() > 3, "{lines:?}");
        assert!(lines.iter().all(|line| width(line, 10.0) <= 90.0), "{lines:?}");
        assert_eq!(lines.concat(), text);
    }
}
