//! Answers of language models (rules: *Answers of language models*).
//!
//! An answer is free text with markers, `ACTION: …`, `MSG: …` and, under centralized control,
//! `TO: …`. An episode names the [`AnswerReader`] that finds them:
//!
//! - `last-marker`: the last of each kind. Around a marker or a value it accepts what models are seen to write: white
//!   space, list signs, Markdown emphasis and headings, quotes, brackets.
//! - `first-marker`: the first of each kind anywhere in the text, as the public toolkit reads.
//! - `json`: no markers, but the fields of one JSON object.

use serde::Deserialize;

use crate::act::{Act, Action, AgentId};
use crate::config::Config;
use crate::message::Message;
use crate::names::{AnswerReader, Control, TaskName};

/// A parsed answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// The act of the agent; empty if the answer is invalid.
    pub act: Act,
    /// The reason why the answer is invalid; `None` if it names an action, or is only a message.
    pub fault: Option<Fault>,
}

impl Answer {
    /// True if the answer is valid.
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        self.fault.is_none()
    }
}

/// The reason why an answer is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The answer is empty or white space.
    Empty,
    /// The answer has no action and no message.
    NoMarker,
    /// The answer has an action by a name that the task does not have.
    UnknownAction,
}

impl Fault {
    /// The fault of an invalid text.
    fn of(text: &str, has_action: bool) -> Self {
        match has_action {
            true => Self::UnknownAction,
            false if text.trim().is_empty() => Self::Empty,
            false => Self::NoMarker,
        }
    }
}

/// Reads the answer of `agent` to a prompt. Takes time proportional to the length of the text.
#[must_use]
pub fn parse(text: &str, config: &Config, agent: AgentId) -> Answer {
    let read = match config.answer_reader() {
        AnswerReader::LastMarker => last_markers(text, config),
        AnswerReader::FirstMarker => first_markers(text, config),
        AnswerReader::Json => object(text, config),
    };
    if !read.valid {
        return Answer { act: Act::default(), fault: Some(Fault::of(text, read.names_action)) };
    }
    let commands = config.control() == Control::Centralized && agent == AgentId::COMMANDER;
    let to = (read.to.filter(|_| commands)).filter(|to| *to != agent && to.0 < config.num_agents());
    Answer { act: Act { action: read.action, message: read.message, to }, fault: None }
}

/// What a reader finds in a text.
struct Read {
    action: Option<Action>,
    message: Option<Message>,
    /// The receiver, whether or not there is such an agent.
    to: Option<AgentId>,
    /// True if the answer has an action by any name.
    names_action: bool,
    valid: bool,
}

fn last_markers(text: &str, config: &Config) -> Read {
    let markers = markers(text, config.control() == Control::Centralized);
    let last = |kind| markers.iter().rev().find(|marker| marker.kind == kind);
    let message = last(Kind::Message).and_then(|marker| Message::new(unwrapped(marker.value)));
    let said = last(Kind::Action);
    let action =
        said.and_then(|marker| words(marker.value).find_map(|word| named(config.task(), word)));
    let is_only_message = said.is_none_or(|marker| {
        words(marker.value).any(|word| word.eq_ignore_ascii_case("MSG")) || marker.announces_message
    });
    let valid = action.is_some() || (is_only_message && message.is_some());
    let to = last(Kind::To).and_then(|marker| receiver(marker.value));
    Read { action, message, to, names_action: said.is_some(), valid }
}

/// Reads a text as the public toolkit does: a marker is found wherever its letters stand, in three spellings, and a
/// later spelling overrides an earlier one. An action is found by its letters, too.
fn first_markers(text: &str, config: &Config) -> Read {
    let actions = Action::of_task(config.task());
    let said = || values(text, ["ACTION:", "Action:", "action:"]);
    let action = (said().rev())
        .find_map(|value| actions.iter().copied().find(|action| value.contains(action.name())));
    let message = values(text, ["MSG:", "Msg:", "msg:"]).next_back().and_then(Message::new);
    let to = values(text, ["TO:", "To:", "to:"]).next_back().and_then(receiver);
    let valid = action.is_some() || message.is_some();
    Read { action, message, to, names_action: said().next().is_some(), valid }
}

/// The fields of an answer in JSON. Others are skipped, without memory for what they hold.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Fields {
    action: Option<String>,
    message: Option<String>,
    to: Option<String>,
}

/// Reads the JSON object that begins at the first brace of a text, after the reasoning if the text has any. What follows it is
/// no part of the answer.
fn object(text: &str, config: &Config) -> Read {
    let spoken = text.rsplit_once("</think>").map_or(text, |(_, spoken)| spoken);
    let json = spoken.find('{').map_or("", |start| &spoken[start..]);
    let fields = serde_json::Deserializer::from_str(json).into_iter::<Fields>().next();
    let Fields { action: said, message, to } = fields.and_then(Result::ok).unwrap_or_default();
    let said = said.as_deref().map(str::trim).filter(|name| !name.is_empty());
    let action = said.and_then(|name| named(config.task(), name));
    let message = message.as_deref().and_then(Message::new);
    let valid = action.is_some() || (said.is_none() && message.is_some());
    let to = to.as_deref().and_then(receiver);
    Read { action, message, to, names_action: said.is_some(), valid }
}

/// The values after the first occurrence of each of these markers, up to the end of the line.
fn values<'a, const N: usize>(
    text: &'a str,
    spellings: [&'static str; N],
) -> impl DoubleEndedIterator<Item = &'a str> {
    spellings.into_iter().filter_map(move |marker| {
        let (_, rest) = text.split_once(marker)?;
        rest.split('\n').next()
    })
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Action,
    Message,
    To,
}

struct Marker<'a> {
    kind: Kind,
    value: &'a str,
    /// An `ACTION:` with nothing before the `MSG:` that follows on its line, as in `ACTION: MSG:
    /// hello`.
    announces_message: bool,
}

/// All markers of a text, in order.
fn markers(text: &str, centralized: bool) -> Vec<Marker<'_>> {
    let mut found = Vec::new();
    for line in text.split(['\n', '\r']) {
        let start = line.len() - line.trim_start_matches(leads).len();
        let mut open: Option<(Kind, usize)> = None;
        let mut place = start;
        while place < line.len() {
            let marker = marker_at(line, place, centralized);
            match marker {
                Some((kind, value)) if place == start || open.is_some() => {
                    close(&mut found, open.take(), line, place, Some(kind));
                    open = Some((kind, value));
                    place = value;
                }
                _ if open.is_none() => break,
                _ => place += line[place..].chars().next().map_or(1, char::len_utf8),
            }
        }
        close(&mut found, open, line, line.len(), None);
    }
    found
}

/// Records a marker whose value ends at `end`, where `next` begins.
fn close<'a>(
    found: &mut Vec<Marker<'a>>,
    open: Option<(Kind, usize)>,
    line: &'a str,
    end: usize,
    next: Option<Kind>,
) {
    if let Some((kind, value)) = open {
        let value = &line[value..end];
        let announces_message = next == Some(Kind::Message) && words(value).next().is_none();
        found.push(Marker { kind, value, announces_message });
    }
}

/// The marker whose word begins at `place`, and the start of its value.
fn marker_at(line: &str, place: usize, centralized: bool) -> Option<(Kind, usize)> {
    let kinds = [("ACTION", Kind::Action), ("MSG", Kind::Message), ("TO", Kind::To)];
    let known = if centralized { &kinds[..] } else { &kinds[..2] };
    let rest = &line.as_bytes()[place..];
    let &(word, kind) = known.iter().find(|(word, _)| {
        rest.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()))
    })?;
    // An underscore may be emphasis: `_ACTION: UP_` has a marker, `MY_ACTION: UP` has none.
    let before = line[..place].trim_end_matches('_').chars().next_back();
    if before.is_some_and(char::is_alphanumeric) {
        return None;
    }
    let after = &line[place + word.len()..];
    let value = after.trim_start_matches(|c: char| c.is_whitespace() || is_emphasis(c));
    let value = value.strip_prefix([':', '：'])?;
    Some((kind, line.len() - value.len()))
}

/// True if a character may stand before the first marker of a line: white space, list signs, emphasis, headings.
fn leads(c: char) -> bool {
    c.is_whitespace()
        || is_emphasis(c)
        || c.is_ascii_digit()
        || matches!(c, '-' | '+' | '•' | '·' | '–' | '—' | '.' | ')' | '#')
}

const fn is_emphasis(c: char) -> bool {
    matches!(c, '*' | '_' | '`' | '~')
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The words of a value. Emphasis is not part of a word, so `_UP_` holds the word `UP`.
fn words(value: &str) -> impl Iterator<Item = &str> {
    value.split(|c: char| !is_word(c)).map(|word| word.trim_matches('_')).filter(|w| !w.is_empty())
}

fn named(task: TaskName, word: &str) -> Option<Action> {
    Action::of_task(task).iter().copied().find(|action| action.name().eq_ignore_ascii_case(word))
}

/// The receiver that a commander names, by name or by number alone.
fn receiver(value: &str) -> Option<AgentId> {
    words(value).find_map(|word| {
        let number = word.to_ascii_lowercase();
        let number = number.strip_prefix("agent").unwrap_or(&number).trim_start_matches('_');
        number.parse().ok().map(AgentId)
    })
}

/// A value without the emphasis, quotes and brackets around it, up to 8 layers of them.
fn unwrapped(value: &str) -> &str {
    const PAIRS: [(char, char); 9] = [
        ('[', ']'),
        ('(', ')'),
        ('{', '}'),
        ('<', '>'),
        ('"', '"'),
        ('\'', '\''),
        ('“', '”'),
        ('‘', '’'),
        ('«', '»'),
    ];
    const LAYERS_MAX: usize = 8;
    let mut value = value;
    for _ in 0..LAYERS_MAX {
        value = value.trim_matches(|c: char| c.is_whitespace() || is_emphasis(c));
        let inner = PAIRS.iter().find_map(|&(open, close)| {
            let inner = value.strip_prefix(open)?.strip_suffix(close)?;
            is_balanced(inner, open, close).then_some(inner)
        });
        match inner {
            Some(inner) => value = inner,
            None => break,
        }
    }
    value
}

/// True if the character at `place` is an apostrophe within a word, as in `don't`, which closes no quote.
fn is_apostrophe(text: &str, place: usize) -> bool {
    let (before, after) = text.split_at(place);
    after.starts_with('\'')
        && before.chars().next_back().is_some_and(char::is_alphanumeric)
        && after.chars().nth(1).is_some_and(char::is_alphanumeric)
}

/// True if the quotes or brackets around `inner` match each other.
fn is_balanced(inner: &str, open: char, close: char) -> bool {
    if open == close {
        return inner.match_indices(open).all(|(place, _)| is_apostrophe(inner, place));
    }
    let mut depth = 0_usize;
    for c in inner.chars() {
        if c == open {
            depth += 1;
        } else if c == close {
            match depth.checked_sub(1) {
                Some(less) => depth = less,
                None => return false,
            }
        }
    }
    depth == 0
}
