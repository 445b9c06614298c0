//! Names that people read: of keys, entrants, models, competitions and labels. Two different
//! names must not look the same.

use std::borrow::Cow;
use std::fmt::Write as _;

use unicode_properties::{GeneralCategory, UnicodeGeneralCategory};
use unicode_security::confusable_detection::skeleton;

/// What the models of built-in players begin with.
pub const BUILT_IN: &str = "built-in/";

/// Words that pages, logs and files show in place of a name: no entrant has one of them.
const RESERVED: [&str; 15] = [
    "admin",
    "administrator",
    "built-in",
    "entrant",
    "judge",
    "local",
    "moderator",
    "operator",
    "organiser",
    "organizer",
    "server",
    "staff",
    "swarmbench",
    "system",
    "unnamed",
];

/// What the names of erased entrants, and the ids of entrants and keys, begin with.
const RESERVED_BEGINNINGS: [&str; 4] = [BUILT_IN, "erased", "ent_", "key_"];

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
    if begins_like(model, BUILT_IN) && !model.starts_with(BUILT_IN) {
        return Err(format!("looks like a built-in player: only those begin with {BUILT_IN}"));
    }
    Ok(())
}

/// The name of an entrant or of a member of a team as it is stored and shown. `players` are the names of built-in players,
/// which are reserved, too.
///
/// # Errors
/// What it has to be instead.
pub fn of_entrant<'a>(
    name: &str,
    chars_max: usize,
    players: impl IntoIterator<Item = &'a str>,
) -> Result<String, String> {
    check(name, chars_max)?;
    let is_imitated = |word: &&str| is_word(name, word);
    let reserved = RESERVED.iter().copied().chain(players).find(is_imitated);
    let begins = RESERVED_BEGINNINGS.into_iter().find(|beginning| begins_like(name, beginning));
    match reserved.or(begins) {
        Some(word) => Err(format!("looks like {word:?}, which is reserved: choose another name")),
        None => Ok(with_single_spaces(name)),
    }
}

/// A name without white space around it, and with one space for each run of white space of any kind.
#[must_use]
pub fn with_single_spaces(name: &str) -> String {
    name.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether a name looks like a word, or its plural, but for what is neither a letter nor a digit.
fn is_word(name: &str, word: &str) -> bool {
    let letters = |text: &str| text.chars().filter(|c| c.is_alphanumeric()).collect::<String>();
    seen(name).iter().zip(seen(word)).any(|(name, word)| {
        let (name, word) = (letters(name), letters(&word));
        name.strip_suffix('s').is_some_and(|one| one == word) || name == word
    })
}

/// Whether a name looks as if it began with a text.
fn begins_like(name: &str, beginning: &str) -> bool {
    seen(name).iter().zip(seen(beginning)).any(|(name, start)| name.starts_with(&start))
}

/// How a name looks where it is shown: two names that look the same have at least one look in common. Names are compared by
/// this alone.
#[must_use]
pub fn looks(name: &str) -> [String; 2] {
    let [small, as_written] = seen(name);
    [format!("small {small}"), format!("written {as_written}")]
}

/// Whether two names look the same where they are shown.
#[must_use]
pub fn is_look_alike(one: &str, other: &str) -> bool {
    looks(one).iter().zip(looks(other)).any(|(one, other)| *one == other)
}

/// What is seen of a name: one of both is the same for names that look the same. A capital I looks like a small L, which
/// shows only before letters are made small; other pairs show only afterwards.
fn seen(name: &str) -> [String; 2] {
    let name: String = with_single_spaces(name).chars().map(with_one_dash).collect();
    let look = |text: &str| skeleton(text).map(with_one_dash).collect::<String>();
    [look(&without_case(&name)), without_case(&look(&name))]
}

/// A text whose letters have one case: `ß` is `ss`, and a final `ς` is `σ`.
fn without_case(text: &str) -> String {
    text.chars().flat_map(char::to_uppercase).flat_map(char::to_lowercase).collect()
}

/// A hyphen in place of every dash, the minus sign, and the katakana mark that long dashes look like.
fn with_one_dash(c: char) -> char {
    let is_dash = c.general_category() == GeneralCategory::DashPunctuation;
    if is_dash || matches!(c, '\u{2212}' | '\u{30fc}') { '-' } else { c }
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
        for (one, other) in [
            ("blue", " BLUE"),
            ("blue", "blu\u{435}"),
            ("l1", "Il"),
            ("Team Rocket", "team \u{3000}\u{a0}Rocket "),
            ("Straße", "STRASSE"),
            ("ΣΟΦΟΣ", "σοφος"),
        ] {
            assert!(is_look_alike(one, other), "{one:?} {other:?}");
        }
        let is_dash = |c: &char| c.general_category() == GeneralCategory::DashPunctuation;
        for dash in (' '..=char::MAX).filter(is_dash).chain(['\u{2212}']) {
            assert!(is_look_alike("gpt-5", &format!("GPT{dash}5")), "{dash:?}");
        }
        for (one, other) in [("blue", "red"), ("Team Rocket", "TeamRocket")] {
            assert!(!is_look_alike(one, other), "{one:?} {other:?}");
        }
    }

    #[test]
    fn no_entrant_is_called_like_somebody_else() {
        let named = |name: &str| of_entrant(name, 50, ["close-in", "random"]);
        for (name, shown) in [
            (" Team \u{a0} Rocket", "Team Rocket"),
            ("Entropy", "Entropy"),
            ("server room", "server room"),
            ("randomness", "randomness"),
        ] {
            assert_eq!(named(name).as_deref(), Ok(shown));
        }
        for (name, reserved) in [
            ("organizer", "organizer"),
            ("Organisers", "organiser"),
            ("0rganizer", "organizer"),
            ("[ Judge ]", "judge"),
            ("\u{405}ERVER", "server"),
            ("swarm-bench", "swarmbench"),
            ("erased ent_01", "erased"),
            ("ENT_0198", "ent_"),
            ("built\u{2014}in/random", "built-in/"),
            ("Close In", "close-in"),
            ("RANDOM", "random"),
        ] {
            let problem = named(name).expect_err(name);
            assert!(problem.contains(&format!("{reserved:?}")), "{name:?}: {problem}");
        }
        assert!(named("\u{7}").is_err() && named("").is_err());
    }
}
