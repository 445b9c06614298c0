//! Classes of characters.

use unicode_properties::{GeneralCategory, GeneralCategoryGroup, UnicodeGeneralCategory as _};

/// Characters that Python, the toolkit's language, counts as digits beside the decimal ones: superscripts, digits in
/// circles and the like (Unicode: `Numeric_Type=Digit`). No further characters will get this property.
const OTHER_DIGITS: [(char, char); 20] = [
    ('\u{b2}', '\u{b3}'),
    ('\u{b9}', '\u{b9}'),
    ('\u{1369}', '\u{1371}'),
    ('\u{19da}', '\u{19da}'),
    ('\u{2070}', '\u{2070}'),
    ('\u{2074}', '\u{2079}'),
    ('\u{2080}', '\u{2089}'),
    ('\u{2460}', '\u{2468}'),
    ('\u{2474}', '\u{247c}'),
    ('\u{2488}', '\u{2490}'),
    ('\u{24ea}', '\u{24ea}'),
    ('\u{24f5}', '\u{24fd}'),
    ('\u{24ff}', '\u{24ff}'),
    ('\u{2776}', '\u{277e}'),
    ('\u{2780}', '\u{2788}'),
    ('\u{278a}', '\u{2792}'),
    ('\u{10a40}', '\u{10a43}'),
    ('\u{10e60}', '\u{10e68}'),
    ('\u{11052}', '\u{1105a}'),
    ('\u{1f100}', '\u{1f10a}'),
];

/// True if the character is a decimal digit of any script (category Nd).
pub(crate) fn is_digit(c: char) -> bool {
    if c.is_ascii() {
        return c.is_ascii_digit();
    }
    c.general_category() == GeneralCategory::DecimalNumber
}

/// True if the toolkit counts `c` as a digit.
pub(crate) fn is_toolkit_digit(c: char) -> bool {
    is_digit(c) || OTHER_DIGITS.iter().any(|&(first, last)| (first..=last).contains(&c))
}

/// True if the character is a letter (categories L) or a decimal digit.
pub(crate) fn is_of_token(c: char) -> bool {
    if c.is_ascii() {
        return c.is_ascii_alphanumeric();
    }
    is_digit(c) || c.general_category_group() == GeneralCategoryGroup::Letter
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_of_all_scripts_count_and_superscripts_in_the_toolkit_only() {
        for (c, paper, toolkit) in [
            ('7', true, true),
            ('٣', true, true),
            ('²', false, true),
            ('①', false, true),
            ('½', false, false),
            ('Ⅷ', false, false),
            ('五', false, false),
            ('a', false, false),
        ] {
            assert_eq!((is_digit(c), is_toolkit_digit(c)), (paper, toolkit), "{c}");
        }
    }
}
