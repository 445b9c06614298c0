//! The reader of journals, with what somebody made of a good one.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use bolero::{TypeGenerator, produce};
use serde_json::Value;
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::RawRecord;
use swarmbench_journal::replay::{Fault, JournalReport, verify as verify_with};

use swarmbench_testkit::check;

/// A journal as the server gave it.
struct Original {
    bytes: Vec<u8>,
    head: Head,
}

/// Golden journals, the shorter ones: those are verified often enough to get somewhere.
static ORIGINALS: LazyLock<Vec<Original>> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/1");
    let names = [
        "done-at-once",
        "abandoned",
        "aborted",
        "clocks-without-banks",
        "still-running",
        "clocks",
        "centralized-paper",
        "answers-flocking",
        "several-holders",
    ];
    let original = |name: &str| {
        let bytes = fs::read(folder.join(format!("{name}.jsonl"))).expect("a golden journal");
        let head = verify(&bytes, None).expect("a proof").head;
        Original { bytes, head }
    };
    names.into_iter().map(original).collect()
});

fn verify(bytes: &[u8], expected: Option<Head>) -> Result<JournalReport, Fault> {
    verify_with(bytes, expected, Solver::Flow, |_, _| ())
}

/// A change of bytes.
#[derive(Clone, Debug, TypeGenerator)]
enum Change {
    Set {
        at: u32,
        to: u8,
    },
    Flip {
        at: u32,
        bit: u8,
    },
    Insert {
        at: u32,
        bytes: Vec<u8>,
    },
    Remove {
        at: u32,
        length: u8,
    },
    Repeat {
        at: u32,
        length: u16,
    },
    SwapLines {
        one: u8,
        other: u8,
    },
    Cut {
        at: u32,
    },
    /// White space around the parts of a line, where JSON allows it.
    Space {
        line: u8,
        place: u8,
        sign: u8,
    },
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>) {
        let place = |at: u32, bytes: &[u8]| at as usize % (bytes.len() + 1);
        match self {
            Self::Set { at, to } => {
                let at = place(*at, bytes);
                bytes.get_mut(at).into_iter().for_each(|byte| *byte = *to);
            }
            Self::Flip { at, bit } => {
                let at = place(*at, bytes);
                bytes.get_mut(at).into_iter().for_each(|byte| *byte ^= 1 << (bit % 8));
            }
            Self::Insert { at, bytes: more } => {
                let at = place(*at, bytes);
                bytes.splice(at..at, more.iter().copied());
            }
            Self::Remove { at, length } => {
                let at = place(*at, bytes);
                bytes.drain(at..bytes.len().min(at + usize::from(*length)));
            }
            Self::Repeat { at, length } => {
                let at = place(*at, bytes);
                let part = bytes[at..bytes.len().min(at + usize::from(*length))].to_vec();
                bytes.splice(at..at, part);
            }
            Self::SwapLines { one, other } => {
                let mut lines: Vec<&[u8]> = bytes.split_inclusive(|byte| *byte == b'\n').collect();
                if let count @ 1.. = lines.len() {
                    lines.swap(usize::from(*one) % count, usize::from(*other) % count);
                    *bytes = lines.concat();
                }
            }
            Self::Cut { at } => bytes.truncate(place(*at, bytes)),
            Self::Space { line, place, sign } => {
                let mut lines: Vec<Vec<u8>> =
                    bytes.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
                let Some(count @ 1..) = Some(lines.len()) else { return };
                let line = &mut lines[usize::from(*line) % count];
                let places = [0, 1, 7, 8, 74, 75, 83, 84, line.len() - 1, line.len().max(2) - 2];
                let at = places[usize::from(*place) % places.len()].min(line.len());
                line.insert(at, b" \t\r\n"[usize::from(sign % 4)]);
                *bytes = lines.concat();
            }
        }
    }
}

#[test]
fn only_the_original_has_its_head() {
    check!(1_500, produce::<(u8, Change, Option<Change>)>(), |(which, change, another)| {
        let original = &ORIGINALS[usize::from(*which) % ORIGINALS.len()];
        let mut bytes = original.bytes.clone();
        change.apply(&mut bytes);
        if let Some(change) = another {
            change.apply(&mut bytes);
        }
        let report = verify(&bytes, Some(original.head));
        assert_eq!(report.is_ok(), bytes == original.bytes, "{report:?}");
    });
}

#[test]
fn any_bytes_are_no_journal() {
    check!(2_000, produce::<Vec<u8>>().with().len(0..4096_usize), |bytes| {
        assert!(verify(bytes, None).is_err());
    });
}

/// Replacements for a place in a record.
#[derive(Clone, Debug, TypeGenerator)]
enum Leaf {
    /// Another value of the same type.
    Nudge(i8),
    Push(char),
    Null,
    Number(i64),
    Unsigned(u64),
    Float(f64),
    Text(String),
    Empty,
    Gone,
}

/// Names that mean something in one place or another.
const NAMES: [&str; 10] = [
    "UP",
    "SWITCH",
    "Agent_0",
    "Agent_7",
    "Agent_65535",
    "reference",
    "centralized",
    "finished",
    "Flocking",
    "clock",
];

impl Leaf {
    fn instead_of(&self, value: &Value) -> Value {
        match self {
            Self::Nudge(by) => match value {
                Value::Bool(value) => (!value).into(),
                Value::Number(number) => match number.as_i64() {
                    Some(number) => (number.saturating_add((*by).into())).into(),
                    None => (number.as_f64().unwrap_or_default() + f64::from(*by) / 8.0).into(),
                },
                Value::String(_) => NAMES[usize::from(by.unsigned_abs()) % NAMES.len()].into(),
                other => other.clone(),
            },
            Self::Push(c) => match value {
                Value::String(text) => format!("{text}{c}").into(),
                other => other.clone(),
            },
            Self::Null | Self::Gone => Value::Null,
            Self::Number(value) => (*value).into(),
            Self::Unsigned(value) => (*value).into(),
            Self::Float(value) => (*value).into(),
            Self::Text(value) => value.as_str().into(),
            Self::Empty => Value::Array(Vec::new()),
        }
    }
}

/// Changes the value to which a path through a record leads.
fn change(value: &mut Value, path: &[u8], leaf: &Leaf) {
    let is_end = |value: &Value| !value.is_object() && !value.is_array();
    match (value, path) {
        (Value::Object(object), [step, rest @ ..]) if !object.is_empty() => {
            let place = usize::from(*step) % object.len();
            let key = object.keys().nth(place).expect("a key").clone();
            if matches!(leaf, Leaf::Gone) && (rest.is_empty() || is_end(&object[&key])) {
                object.remove(&key);
            } else {
                change(&mut object[&key], rest, leaf);
            }
        }
        (Value::Array(list), [step, rest @ ..]) if !list.is_empty() => {
            let place = usize::from(*step) % list.len();
            if matches!(leaf, Leaf::Gone) && (rest.is_empty() || is_end(&list[place])) {
                list.remove(place);
            } else {
                change(&mut list[place], rest, leaf);
            }
        }
        (value, _) => *value = leaf.instead_of(value),
    }
}

/// A forger who computes all hashes anew gets past the chain, so records of every content are read and
/// played. What is accepted then is a journal, but never the original one.
#[test]
fn records_with_good_hashes_are_judged_by_what_they_say() {
    check!(1_000, produce::<(u8, [(u8, [u8; 4], Leaf); 2], bool)>(), |(which, changes, both)| {
        let original = &ORIGINALS[usize::from(*which) % ORIGINALS.len()];
        let text = std::str::from_utf8(&original.bytes).expect("UTF-8");
        // `{"hash":"<64 digits>","record":<the record>}`
        let record = |line: &str| line[84..line.len() - 1].to_owned();
        let mut records: Vec<String> = text.lines().map(record).collect();
        for (line, path, leaf) in &changes[..=usize::from(*both)] {
            let line = usize::from(*line) % records.len();
            let mut value: Value = serde_json::from_str(&records[line]).expect("JSON");
            change(&mut value, path, leaf);
            records[line] = value.to_string();
        }
        let mut head = Head::START;
        let mut bytes = String::new();
        for record in records {
            head = head.link(record.as_bytes());
            bytes += &RawRecord::from_stored(record).expect("JSON").line(head);
        }
        let same = bytes.as_bytes() == original.bytes;
        assert_eq!(verify(bytes.as_bytes(), Some(original.head)).is_ok(), same);
        if let Ok(report) = verify(bytes.as_bytes(), None) {
            assert_eq!(report.head, head);
            assert!(report.rounds <= report.opening.config.max_round);
            if let Some(end) = report.end {
                assert_eq!(
                    (end.rounds, end.score.to_bits()),
                    (report.rounds, report.score.to_bits())
                );
            }
        }
    });
}
