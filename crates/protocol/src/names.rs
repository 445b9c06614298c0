//! Names that people read: of keys, entrants, models, competitions and labels. Two different
//! names must not look the same.

use std::borrow::Cow;
use std::fmt::Write as _;

use unicode_normalization::UnicodeNormalization;
use unicode_properties::{GeneralCategory, GeneralCategoryGroup, UnicodeGeneralCategory};
use unicode_script::{Script, UnicodeScript};
use unicode_security::confusable_detection::skeleton;

/// Prefix of the models of built-in players.
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

/// Prefixes of the names of erased entrants, and of the ids of entrants and keys.
const RESERVED_BEGINNINGS: [&str; 4] = [BUILT_IN, "erased", "ent_", "key_"];

/// Characters of a look: looks are keys of an index, and some characters stand for 18 others. Those of 200 letters fit in.
const LOOK_CHARS_MAX: usize = 400;

/// Fault of a name of at most `chars_max` characters.
///
/// # Errors
/// The required form of the name.
pub fn check(name: &str, chars_max: usize) -> Result<(), String> {
    if !(1..=chars_max).contains(&name.chars().count()) || name.chars().any(char::is_control) {
        return Err(format!("must be 1 to {chars_max} characters without control characters"));
    }
    if name.trim().is_empty() || name.chars().any(is_invisible) || has_stray_mark(name) {
        return Err("must be seen: it has invisible characters, or nothing else".to_owned());
    }
    Ok(())
}

/// Whether a text of several lines has no control characters but line breaks and tabs.
#[must_use]
pub fn is_plain_text(text: &str) -> bool {
    !text.chars().any(|c| c.is_control() && c != '\n' && c != '\t')
}

/// Fault of the name of a model.
///
/// # Errors
/// The required form of the name.
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
/// The required form of the name.
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

/// Whether a name looks like a word, its plural, or either after `the`, but for what is neither a letter nor a digit.
fn is_word(name: &str, word: &str) -> bool {
    let letters = |text: &str| text.chars().filter(|c| c.is_alphanumeric()).collect::<String>();
    seen(name).iter().zip(seen(word)).any(|(name, word)| {
        // The end comes first: `server 5` is one of many, and `5erver` is not.
        let one = name.trim_end_matches(|c: char| !c.is_alphanumeric()).strip_suffix('s');
        let word = letters(&with_letters_for_digits(&word));
        one.into_iter().chain([name.as_str()]).any(|name| {
            let name = letters(&with_letters_for_digits(name));
            name == word || name.strip_prefix("the").is_some_and(|rest| rest == word)
        })
    })
}

/// Whether a name looks as if it began with a text, but for quotes, brackets and the like before it.
fn begins_like(name: &str, beginning: &str) -> bool {
    seen(name).iter().zip(seen(beginning)).any(|(name, start)| {
        let name = with_letters_for_digits(name);
        name.trim_start_matches(|c: char| !c.is_alphanumeric())
            .starts_with(&with_letters_for_digits(&start))
    })
}

/// Skeleton of a name with digits and signs read as letters. Reserved words are compared in this form, names with each other are
/// not: `Team 5` is not `Team S`.
fn with_letters_for_digits(seen: &str) -> String {
    let letter = |c: char| match c {
        '3' => 'e',
        '4' | '@' => 'a',
        '5' | '$' => 's',
        '7' => 't',
        c => c,
    };
    seen.chars().map(letter).collect()
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

/// Two skeletons of a name: names that look the same share at least one. Letters may look alike only when they are small, as the Greek
/// `ν` and `Ν` show: so the first skeleton is lowered before look-alikes are mapped, and the second after it. Characters of ASCII have
/// the same skeleton in both.
fn seen(name: &str) -> [String; 2] {
    let plain: String = name.chars().map(with_one_line).nfkc().map(without_frame).collect();
    let name = with_single_spaces(&plain);
    [without_case(&name), name].map(|name| {
        let look = without_case(&skeleton(&name).collect::<String>());
        let look: String = look.chars().map(from_small_capital).collect();
        let look: String = skeleton(&look).map(with_one_line).collect();
        // After the skeleton `m` is `rn`, and `I`, `1` and `|` are `l`.
        let look = without_own_dots(&look.replace('i', "l")).replace('d', "cl").replace('w', "vv");
        look.chars().take(LOOK_CHARS_MAX).collect()
    })
}

/// A text whose letters have one case: `ß` is `ss`, and a final `ς` is `σ`.
fn without_case(text: &str) -> String {
    text.chars().flat_map(char::to_uppercase).flat_map(char::to_lowercase).collect()
}

/// A hyphen in place of every dash, the minus sign, and the katakana mark that long dashes look like; a low line in place
/// of everything like it.
fn with_one_line(c: char) -> char {
    match (c, c.general_category()) {
        ('\u{2212}' | '\u{30fc}', _) | (_, GeneralCategory::DashPunctuation) => '-',
        ('\u{2cd}' | '\u{2017}' | '\u{2581}', _) | (_, GeneralCategory::ConnectorPunctuation) => {
            '_'
        }
        _ => c,
    }
}

/// The letter that is white on a disc or a square, or a part of a flag: compatible forms of Unicode leave these out.
fn without_frame(c: char) -> char {
    let first = match c {
        '\u{1f150}'..='\u{1f169}' => '\u{1f150}',
        '\u{1f170}'..='\u{1f189}' => '\u{1f170}',
        '\u{1f1e6}'..='\u{1f1ff}' => '\u{1f1e6}',
        _ => return c,
    };
    ('a'..='z').nth(c as usize - first as usize).unwrap_or(c)
}

/// The letter of which another is the small capital, as the small letters of Cyrillic are of capitals that look Latin. These
/// are those that the look-alikes of Unicode leave as they are.
const fn from_small_capital(c: char) -> char {
    match c {
        '\u{1d00}' => 'a',
        '\u{299}' => 'b',
        '\u{1d05}' => 'd',
        '\u{1d07}' => 'e',
        '\u{a730}' => 'f',
        '\u{262}' => 'g',
        '\u{29c}' => 'h',
        '\u{1d0a}' => 'j',
        '\u{138}' => 'k',
        '\u{29f}' => 'l',
        '\u{28d}' => 'm',
        '\u{274}' => 'n',
        '\u{1d18}' => 'p',
        '\u{280}' => 'r',
        '\u{1d1b}' => 't',
        c => c,
    }
}

/// A look without dots above letters that have one anyway: above `i`, which is `l` here, and `j`.
fn without_own_dots(look: &str) -> String {
    let mut letter = ' ';
    let is_kept = |c: &char| {
        if !is_mark(*c) {
            letter = *c;
        }
        *c != '\u{307}' || !matches!(letter, 'l' | 'j')
    };
    look.chars().filter(is_kept).collect()
}

/// Whether a character is a part of the one before it.
fn is_mark(c: char) -> bool {
    c.general_category_group() == GeneralCategoryGroup::Mark
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
    // A skeleton leaves out what has the property `Default_Ignorable_Code_Point`, and nothing else.
    let is_ignorable = || skeleton(character.encode_utf8(&mut [0; 4])).next().is_none();
    is_hidden || is_blank(character) || is_ignorable()
}

/// True if a combining mark follows a character of another script, where fonts often draw nothing.
fn has_stray_mark(name: &str) -> bool {
    let mut script = Script::Common;
    name.chars().any(|c| match c.script() {
        own if !is_mark(c) => {
            script = own;
            false
        }
        own => own != script && !matches!(own, Script::Common | Script::Inherited),
    })
}

/// Letters and symbols that are shown as nothing, for which Unicode has no property.
const fn is_blank(character: char) -> bool {
    matches!(
        character,
        '\u{2800}'                      // a pattern of Braille without dots
            | '\u{fffc}'                // the place of an object
            | '\u{13441}' | '\u{13442}' // spaces between hieroglyphs
            | '\u{1d159}' // a note without head
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
        for good in [
            "team blue",
            "a",
            "模型",
            "ünïcode 🐜",
            "gpt-4 (2026)",
            "ㅎ한글",
            "⠓⠊",
            "हिन्दी",
            "ខ្មែរ",
            "ภาษาไทย",
            "שָׁלוֹם",
            "العَرَبِيَّة",
            "か\u{3099}",
            "п\u{301}",
            "\u{18b00}\u{16fe4}\u{18b01}",
        ] {
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
            "zoo\u{1d159} x",
            "blue\u{fffc}",
            "ab\u{13441}\u{13442}",
            "ki\u{16fe4}t",
            "\u{16fe4}",
            "ki\u{2d7f}t",
            "ki\u{1bc9d}t",
            "k\u{17d2}it",
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
            // Case and look-alikes in one name.
            ("Mallory Il", "mallory ll"),
            ("Kim Il", "kiM ll"),
            ("Ilm", "IIM"),
            ("IIM", "llrn"),
            ("Team 1", "TEAM i"),
            ("TEAM |", "team l"),
            ("N0M", "norn"),
            ("\u{3bd}icky \u{39d}orth", "VICKY NORTH"),
            ("HOP\u{414}", "\u{43d}\u{43e}\u{440}\u{434}"),
            ("МОСКВА", "MOCKBA"),
            ("mockba", "МОСКВА"),
            // Dots that a letter has anyway.
            ("bird", "bi\u{307}rd"),
            ("tim", "t\u{130}m"),
            ("tim", "TI\u{307}M"),
            ("jojo", "j\u{307}oj\u{307}o"),
            ("l\u{328}nes", "\u{12f}\u{307}nes"),
            // Other forms of letters.
            ("Organic", "\u{24c4}rganic"),
            ("kit", "\u{1d4c0}\u{1d4be}\u{1d4c9}"),
            ("kit", "\u{ff2b}\u{ff29}\u{ff34}"),
            ("Fire", "\u{fb01}re"),
            ("kit", "\u{1f15a}\u{1f178}\u{1f1f9}"),
            ("team", "\u{1d1b}\u{1d07}\u{1d00}\u{1d0d}"),
            // Pairs of letters that look like one.
            ("Wolf", "vvolf"),
            ("wolf", "VVolf"),
            ("dub", "club"),
            ("dub", "cIub"),
            ("CLUB", "c1ub"),
            ("modern", "rnoclem"),
            ("vWest", "Wvest"),
            ("a_b", "a\u{2017}b"),
        ] {
            assert!(is_look_alike(one, other), "{one:?} {other:?}");
        }
        for c in ' '..='~' {
            let [first, second] = seen(&c.to_string());
            assert_eq!(first, second, "{c:?}");
            assert_eq!(
                seen(&c.to_ascii_uppercase().to_string()),
                seen(&c.to_ascii_lowercase().to_string()),
                "{c:?}"
            );
        }
        let longest = looks(&"\u{fdfa}".repeat(200));
        assert!(longest.iter().all(|look| look.chars().count() < 2 * 200 + 10), "{longest:?}");
        let is_dash = |c: &char| c.general_category() == GeneralCategory::DashPunctuation;
        for dash in (' '..=char::MAX).filter(is_dash).chain(['\u{2212}']) {
            assert!(is_look_alike("gpt-5", &format!("GPT{dash}5")), "{dash:?}");
        }
        for (one, other) in [
            ("blue", "red"),
            // White space is compared: only its kind and length are not.
            ("Team Rocket", "TeamRocket"),
            ("Foo Bar", "Foo - Bar"),
            ("Foo Bar", "Foo-Bar"),
            ("Illinois", "Illinoise"),
            ("Team 1", "Team 2"),
            ("Team 5", "Team S"),
            ("Team A", "Team 4"),
            ("Żaba", "Zaba"),
            ("Muller", "Müller"),
            ("naïve", "naive"),
            ("12 אב", "אב 12"),
            ("Вова", "Нона"),
            ("ΝΙΚΟΣ", "ΝΕΚΟΣ"),
        ] {
            assert!(!is_look_alike(one, other), "{one:?} {other:?}");
        }
    }

    #[test]
    fn no_entrant_is_called_like_somebody_else() {
        let named = |name: &str| of_entrant(name, 50, ["close-in", "random", "step-3"]);
        for (name, shown) in [
            (" Team \u{a0} Rocket", "Team Rocket"),
            ("Entropy", "Entropy"),
            ("server room", "server room"),
            ("randomness", "randomness"),
            ("Server 5", "Server 5"),
            ("Judge 1", "Judge 1"),
            ("Illinois", "Illinois"),
            ("Eras Education", "Eras Education"),
            ("Ent-wood", "Ent-wood"),
            ("Keystone", "Keystone"),
            ("The Entropy", "The Entropy"),
            ("Theory of Judges", "Theory of Judges"),
            ("Team organizer", "Team organizer"),
            ("my built-in/x", "my built-in/x"),
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
            ("Step 3", "step-3"),
            ("0rgan1zer", "organizer"),
            ("adm1n", "admin"),
            ("AdmIn", "admin"),
            ("@dmin", "admin"),
            ("5erver", "server"),
            ("$3rv3r", "server"),
            ("5t4ff", "staff"),
            (
                "\u{24de}\u{24e1}\u{24d6}\u{24d0}\u{24dd}\u{24d8}\u{24e9}\u{24d4}\u{24e1}",
                "organizer",
            ),
            ("\u{24c4}rganizer", "organizer"),
            ("\u{1f15e}rganizer", "organizer"),
            ("adm\u{131}\u{307}n", "admin"),
            ("the organizer", "organizer"),
            ("The 5ervers!", "server"),
            ("(erased)", "erased"),
            ("\"erased\"", "erased"),
            (".erased", "erased"),
            ("[built-in/x]", "built-in/"),
            ("ent\u{2017}x", "ent_"),
            ("ent\u{203f}x", "ent_"),
            ("_key_x", "key_"),
        ] {
            let problem = named(name).expect_err(name);
            assert!(problem.contains(&format!("{reserved:?}")), "{name:?}: {problem}");
        }
        assert!(named("\u{7}").is_err() && named("").is_err());
    }
}
