//! Golden journals: every score that a rules revision ever gave is still the same.
//!
//! `tests/golden/REVISION/` holds journals of that revision as the server gave them, and `heads.tsv` the
//! head and the score of each. They are never edited and never recorded again: CONTRIBUTING.md says
//! what to do when the rules change.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use swarmbench_boards::competition::verify::{Expected, verify as verify_competition};
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{RULES_REVISION, RuleSet, TaskName};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord, Record, Round, Source};
use swarmbench_journal::replay::{JournalReport, verify};

/// A journal that was recorded once.
struct Golden {
    name: String,
    head: Head,
    score: String,
    bytes: Vec<u8>,
}

impl Golden {
    fn verify(&self, bytes: &[u8], solver: Solver) -> Result<JournalReport, String> {
        verify(bytes, Some(self.head), solver, |_, _| ()).map_err(|error| error.to_string())
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// The names in a folder.
fn names(folder: &Path) -> BTreeSet<String> {
    let entries =
        fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let name = |entry: std::io::Result<fs::DirEntry>| entry.expect("an entry").file_name();
    entries.map(|entry| name(entry).into_string().expect("UTF-8")).collect()
}

/// The rows of a revision's table: name, head and score.
fn table(folder: &Path) -> Vec<[String; 3]> {
    let text = fs::read_to_string(folder.join("heads.tsv")).expect("a table");
    let row = |line: &str| {
        let cells: Vec<_> = line.split('\t').map(str::to_owned).collect();
        cells.try_into().unwrap_or_else(|_| panic!("{line:?} is not a name, a head and a score"))
    };
    text.lines().map(row).collect()
}

fn golden(revision: u32) -> Vec<Golden> {
    let folder = folder().join(revision.to_string());
    let read = |[name, head, score]: [String; 3]| Golden {
        bytes: fs::read(folder.join(format!("{name}.jsonl"))).expect("a journal"),
        head: Head::parse(&head).expect("a head"),
        name,
        score,
    };
    table(&folder).into_iter().map(read).collect()
}

#[test]
fn every_revision_has_its_journals_and_no_file_is_missing_or_extra() {
    let revisions: BTreeSet<String> = (1..=RULES_REVISION).map(|n| n.to_string()).collect();
    let mut folders = names(&folder());
    assert!(
        folders.remove("database"),
        "whole databases: see tests/http/across/golden_database.rs"
    );
    assert!(folders.remove("competitions"), "published files of competitions: see below");
    assert_eq!(folders, revisions, "a folder for every revision up to this one");
    for revision in revisions {
        let folder = folder().join(&revision);
        let rows = table(&folder);
        let mut listed: BTreeSet<_> =
            rows.iter().map(|[name, ..]| format!("{name}.jsonl")).collect();
        assert_eq!(listed.len(), rows.len(), "no name twice in revision {revision}");
        assert!(!listed.is_empty(), "revision {revision} has no journals");
        listed.insert("heads.tsv".to_owned());
        assert_eq!(
            names(&folder),
            listed,
            "the files of revision {revision} are those of its table"
        );
    }
}

#[test]
fn every_journal_plays_to_the_head_and_the_score_that_it_had() {
    for revision in 1..=RULES_REVISION {
        for golden in golden(revision) {
            let report = golden.verify(&golden.bytes, Solver::Both);
            let report = report.unwrap_or_else(|error| panic!("{}: {error}", golden.name));
            assert_eq!(report.opening.rules_revision, revision, "{}", golden.name);
            assert_eq!(report.score.to_string(), golden.score, "{}", golden.name);
        }
    }
}

/// Contents that the journals of a revision need, so that they would show a change.
#[test]
fn every_revision_holds_all_tasks_and_whatever_else_decides_a_score() {
    for revision in 1..=RULES_REVISION {
        let mut played = BTreeSet::new();
        let mut found: BTreeMap<&str, usize> = BTreeMap::new();
        for golden in golden(revision) {
            let report = golden.verify(&golden.bytes, Solver::Flow).expect("a proof");
            let config = &report.opening.config;
            played.insert((config.task.clone(), config.rules.clone()));
            let ending = report.end.as_ref().map_or("none", |end| end.reason.as_str());
            let text = String::from_utf8(golden.bytes).expect("UTF-8");
            for (what, holds) in [
                ("noise", config.noise > 0.0),
                ("a delay", config.max_delay > 0),
                ("centralized control", config.control == "centralized"),
                ("a message to one alone", text.contains(r#""to":"Agent_"#)),
                ("a map that is no square", config.width != config.height),
                ("one agent", config.num_agents == 1),
                ("thirty agents", config.num_agents == 30),
                ("no memory", config.memory == 0),
                ("another window", ![3, 5].contains(&config.view_size)),
                ("a valid answer", text.contains(r#""valid":true,"response":"#)),
                ("an invalid answer", text.contains(r#""valid":false,"response":"#)),
                ("an emoji", text.contains('🐜')),
                ("control characters that became spaces", text.contains("three four five")),
                ("a message that was cut", text.contains(r#"...","#)),
                ("a clock that ran out", text.contains(r#""source":"clock""#)),
                ("time from a bank", text.contains(r#""bank_spent_ms":"#)),
                ("a template of its own", config.custom_template),
                ("task_done", ending == "task_done"),
                ("rounds_played", ending == "rounds_played"),
                ("aborted", ending == "aborted"),
                ("idle", ending == "idle"),
                ("no end", ending == "none"),
                ("several holders", report.seats.is_some()),
                ("open acts", report.end.is_some_and(|end| !end.open_acts.is_empty())),
            ] {
                *found.entry(what).or_default() += usize::from(holds);
            }
        }
        for task in TaskName::ALL {
            for rules in RuleSet::ALL {
                let both = (task.name().to_owned(), rules.name().to_owned());
                assert!(played.contains(&both), "revision {revision} has no {both:?}");
            }
        }
        let missing: Vec<_> = found.iter().filter(|(_, count)| **count == 0).collect();
        assert!(missing.is_empty(), "revision {revision} lacks {missing:?}");
    }
}

/// Without this, a test that accepts any file would look the same.
#[test]
fn a_changed_byte_fails() {
    for golden in (1..=RULES_REVISION).flat_map(golden) {
        let size = golden.bytes.len();
        for place in [0, size / 3, size / 2, size - 200, size - 1] {
            let mut changed = golden.bytes.clone();
            changed[place] ^= 1;
            let result = golden.verify(&changed, Solver::Flow);
            assert!(result.is_err(), "{}: the byte {place} may change", golden.name);
        }
        assert!(golden.verify(&golden.bytes[..size - 1], Solver::Flow).is_err());
    }
}

/// A journal with other rounds, whose hashes fit; none where `change` says that it changed nothing.
fn forged(golden: &Golden, mut change: impl FnMut(&mut Round) -> bool) -> Option<String> {
    rewritten(
        golden,
        |record| if let Record::Round(round) = record { change(round) } else { false },
    )
}

/// A journal with other records.
fn rewritten(golden: &Golden, mut change: impl FnMut(&mut Record) -> bool) -> Option<String> {
    let mut head = Head::START;
    let mut forged = String::new();
    let mut is_forged = false;
    for line in std::str::from_utf8(&golden.bytes).expect("UTF-8").lines() {
        // `{"hash":"<64 digits>","record":<the record>}`
        let mut raw = RawRecord::from_stored(line[84..line.len() - 1].to_owned()).expect("JSON");
        let mut record = raw.read().expect("a record");
        if change(&mut record) {
            is_forged = true;
            raw = RawRecord::write(&record);
        }
        head = head.link(raw.as_str().as_bytes());
        forged.push_str(&raw.line(head));
    }
    is_forged.then_some(forged)
}

fn refused(golden: &Golden, forged: &str, says: &str) {
    let result = verify(forged.as_bytes(), None, Solver::Flow, |_, _| ());
    let said = result.err().map(|error| error.to_string()).unwrap_or_default();
    assert!(said.contains(says), "{}: {said:?}", golden.name);
}

/// Programs of today have to read the format of the first field that is added, which nothing writes yet, and no later one.
#[test]
fn journals_of_the_next_format_are_read_and_later_ones_refused() {
    for golden in (1..=RULES_REVISION).flat_map(golden) {
        let with = |format: u32| {
            let change = |record: &mut Record| {
                let Record::Opening(opening) = record else { return false };
                opening.format = format;
                true
            };
            rewritten(&golden, change).expect("an opening")
        };
        let next = verify(with(2).as_bytes(), None, Solver::Flow, |_, _| ());
        let next = next.unwrap_or_else(|error| panic!("{}: {error}", golden.name));
        assert_eq!(next.score.to_string(), golden.score, "{}", golden.name);
        refused(&golden, &with(3), "journal format 3 is not known");
    }
}

/// A change of the rules shows even where somebody computes all hashes anew: the records hold digests
/// and scores of states that a replay no longer reaches.
#[test]
fn a_score_that_was_not_played_fails_with_good_hashes_too() {
    for golden in (1..=RULES_REVISION).flat_map(golden) {
        let raise = |round: &mut Round| {
            round.score += 1.0;
            round.round == 0
        };
        // One that was done at once has no rounds.
        if let Some(forged) = forged(&golden, raise) {
            refused(&golden, &forged, "the score differs");
        }
    }
}

/// Boards count acts of the clock and not what they do, so a player's act must not pass for one.
#[test]
fn the_clock_does_nothing() {
    let mut journals = 0;
    for golden in (1..=RULES_REVISION).flat_map(golden) {
        let changes: [fn(&mut ActRecord); 3] = [
            |act| act.action = Some("STAY".to_owned()),
            |act| act.message = Some("hello".to_owned()),
            |act| act.valid = false,
        ];
        for change in changes {
            let forged = forged(&golden, |round| {
                let mut acts = round.acts.iter_mut();
                acts.find(|act| act.source == Source::Clock).map(change).is_some()
            });
            if let Some(forged) = forged {
                refused(&golden, &forged, "the clock of");
                journals += 1;
            }
        }
    }
    assert!(journals > 3, "{journals} journals have acts of the clock");
}

/// Published files of competitions, as programs before format 3 wrote them, and `heads.tsv`: name, format, head and
/// commitment of each.
#[test]
fn published_files_of_earlier_versions_verify_as_they_did() {
    let folder = folder().join("competitions");
    let heads = fs::read_to_string(folder.join("heads.tsv")).expect("a table");
    let mut listed = BTreeSet::from(["heads.tsv".to_owned()]);
    let mut formats = BTreeSet::new();
    for line in heads.lines() {
        let [name, format, head, commitment] = line.split('\t').collect::<Vec<_>>()[..] else {
            panic!("{line:?} has no name, format, head and commitment");
        };
        let bytes = fs::read(folder.join(name)).expect("a file");
        let hash = |text| Head::parse(text).expect("a hash");
        let expected = Expected { commitment: Some(hash(commitment).0), head: Some(hash(head)) };
        let report = verify_competition(&*bytes, expected, Solver::Flow, |_| ());
        let report = report.unwrap_or_else(|fault| panic!("{name}: {fault}"));
        assert_eq!(report.competition.format.to_string(), format, "{name}");
        assert!(report.episodes > 0, "{name}");
        formats.insert(format.to_owned());
        listed.insert(name.to_owned());
    }
    assert_eq!(formats, ["1", "2"].map(str::to_owned).into());
    assert_eq!(names(&folder), listed);
}
