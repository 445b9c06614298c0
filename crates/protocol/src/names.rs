//! Names that people read: of keys, entrants, models, competitions and labels. Two different
//! names must not look the same.

use std::borrow::Cow;
use std::fmt::Write as _;

use unicode_properties::{GeneralCategory, UnicodeGeneralCategory};
use unicode_security::confusable_detection::skeleton;

/// What the models of built-in players begin with.
pub const BUILT_IN: &str = "built-in/";

/// What is wrong with a name of at most `chars_max` characters.
///
/// # Errors
/// What it has to be instead.
pub fn check(name: &str, chars_max: usize) -> Result<(), String> {
    if !(1..=chars_max).contains(&name.chars().count()) || name.chars().any(char::is_control) {
        return Err(format!("must be 1 to {chars_max} characters without control characters"));
    }
    if name.trim().is_empty() || name.chars().any(is_invisible) {
        return Err("must be seen: it has invisible characters, or nothing else".to_owned());
    }
    Ok(())
}

/// Whether a text of several lines has no control characters but line breaks and tabs.
#[must_use]
pub fn is_plain_text(text: &str) -> bool {
    !text.chars().any(|c| c.is_control() && c != '\n' && c != '\t')
}

/// What is wrong with the name of a model.
///
/// # Errors
/// What it has to be instead.
pub fn check_model(model: &str, chars_max: usize) -> Result<(), String> {
    check(model, chars_max)?;
    let imitates =
        seen(model).iter().zip(seen(BUILT_IN)).any(|(one, other)| one.starts_with(&other));
    if imitates && !model.starts_with(BUILT_IN) {
        return Err(format!("looks like a built-in player: only those begin with {BUILT_IN}"));
    }
    Ok(())
}

/// How a name looks where it is shown: two names that look the same have at least one look in common.
#[must_use]
pub fn looks(name: &str) -> [String; 2] {
    let [small, as_written] = seen(name);
    [format!("small {small}"), format!("written {as_written}")]
}

/// Whether two names look the same where they are shown.
#[cfg(test)]
fn is_look_alike(one: &str, other: &str) -> bool {
    looks(one).iter().zip(looks(other)).any(|(one, other)| *one == other)
}

/// What is seen of a name: one of both is the same for names that look the same. A capital I looks like a small L, which
/// shows only before letters are made small; other pairs show only afterwards.
fn seen(name: &str) -> [String; 2] {
    let name = name.trim();
    let as_written: String = skeleton(name).collect();
    [skeleton(&name.to_lowercase()).collect(), as_written.to_lowercase()]
}

/// A text without characters that XML forbids or that change how the text around them is read: line breaks and tabs
/// become spaces, all others `U+FFFD`.
#[must_use]
pub fn printable(text: &str) -> String {
    let replace = |c: char| match c {
        '\t' | '\n' | '\r' | '\u{85}' | '\u{2028}' | '\u{2029}' => ' ',
        c if c.is_control() || hides_or_turns(c) => '\u{FFFD}',
        c => c,
    };
    text.chars().map(replace).collect()
}

/// A text as a terminal or a line of a log may show it: control characters but line breaks and tabs, and characters that
/// are not seen or turn others around, become `\u001b` and so on, as in JSON.
#[must_use]
pub fn shown(text: &str) -> Cow<'_, str> {
    let is_plain = |c: char| c == '\n' || c == '\t' || !(c.is_control() || hides_or_turns(c));
    if text.chars().all(is_plain) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_plain(c) {
            shown.push(c);
        } else {
            for unit in c.encode_utf16(&mut [0; 2]) {
                write!(shown, "\\u{unit:04x}").expect("text");
            }
        }
    }
    Cow::Owned(shown)
}

/// Marks of direction, characters without width, and those that no text may have.
const fn hides_or_turns(c: char) -> bool {
    matches!(c, '\u{61C}' | '\u{200B}'..='\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2060}'..='\u{206F}')
        || matches!(c, '\u{2028}' | '\u{2029}' | '\u{FEFF}' | '\u{FFFE}' | '\u{FFFF}')
        || matches!(c, '\u{FFF9}'..='\u{FFFB}' | '\u{E0000}'..='\u{E007F}')
}

/// Whether a character is not seen, or turns others around.
fn is_invisible(character: char) -> bool {
    let is_hidden = matches!(
        character.general_category(),
        GeneralCategory::Format
            | GeneralCategory::LineSeparator
            | GeneralCategory::ParagraphSeparator
            | GeneralCategory::PrivateUse
            | GeneralCategory::Unassigned
    );
    is_hidden || is_blank(character)
}

/// Letters, marks and symbols that are shown as nothing: the property `Default_Ignorable_Code_Point` of Unicode, as far
/// as the categories do not cover it, and the blank pattern of Braille.
fn is_blank(character: char) -> bool {
    matches!(
        character,
        '\u{34f}'                       // combining grapheme joiner
            | '\u{115f}' | '\u{1160}'   // fillers of Hangul
            | '\u{3164}' | '\u{ffa0}'
            | '\u{17b4}' | '\u{17b5}'   // inherent vowels of Khmer
            | '\u{180b}'..='\u{180f}'   // variation selectors
            | '\u{fe00}'..='\u{fe0f}'
            | '\u{e0100}'..='\u{e01ef}'
            | '\u{2800}' // a pattern of Braille without dots
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_shows_what_it_would_obey() {
        assert_eq!(shown("a\n\tb é 🐜"), "a\n\tb é 🐜");
        for (text, expected) in [
            ("\u{1b}]0;title\u{7}", "\\u001b]0;title\\u0007"),
            ("a\rb\u{9b}2J\u{7f}", "a\\u000db\\u009b2J\\u007f"),
            ("\u{202e}eulb\u{2066}\u{200f}\u{2028}", "\\u202eeulb\\u2066\\u200f\\u2028"),
            ("a\u{e0041}", "a\\udb40\\udc41"),
        ] {
            assert_eq!(shown(text), expected);
        }
    }

    #[test]
    fn names_have_to_be_seen() {
        for good in ["team blue", "a", "模型", "ünïcode 🐜", "gpt-4 (2026)", "ㅎ한글", "⠓⠊"]
        {
            assert_eq!(check(good, 20), Ok(()), "{good:?}");
        }
        for hidden in [
            " ",
            "\u{a0}",
            "\u{3164}",
            "blue\u{3164}",
            "\u{ffa0}",
            "\u{115f}\u{1160}",
            "a\u{200b}",
            "\u{2800}",
            "a\u{fe0f}",
            "a\u{e0101}",
            "\u{ad}",
            "a\u{34f}",
            "\u{17b4}",
            "\u{202e}eulb",
            "\u{e000}",
            "\u{feff}",
            "a\u{2028}",
        ] {
            let problem = check(hidden, 20).expect_err(hidden);
            assert!(problem.contains("must be seen"), "{hidden:?}: {problem}");
        }
        for wrong in ["", "a\u{7}", "a name of more than twenty characters"] {
            assert!(check(wrong, 20).expect_err(wrong).contains("1 to 20"), "{wrong:?}");
        }
    }

    #[test]
    fn only_built_in_players_look_like_those() {
        for good in ["built-in/random", "builtin", "my built-in/model", "random"] {
            assert_eq!(check_model(good, 50), Ok(()), "{good:?}");
        }
        for alike in [
            "Built-in/random",
            "bui\u{1c0}t-in/random",
            "built-\u{456}n/random",
            " built-in/random",
            "buiIt-in/random",
        ] {
            assert!(check_model(alike, 50).expect_err(alike).contains("looks like"), "{alike:?}");
        }
    }

    #[test]
    fn names_that_look_the_same_are_found() {
        for (one, other) in
            [("blue", " BLUE"), ("blue", "blu\u{435}"), ("gpt-5", "gpt\u{2010}5"), ("l1", "Il")]
        {
            assert!(is_look_alike(one, other), "{one:?} {other:?}");
        }
        assert!(!is_look_alike("blue", "red"));
    }
}
