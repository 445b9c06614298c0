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
