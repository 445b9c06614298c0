//! Reading data that others wrote: whole, with files missing and broken, and made to do harm.

mod reserved;
mod sample;

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};
use swarmbench::dataset::bounds::Bounds;
use swarmbench::dataset::format::AgentRow;
use swarmbench::dataset::imported;
use swarmbench::dataset::read::{Problem, ReadError, Skipped, Taker, read};
use swarmbench::dataset::tables::TableName;
use swarmbench::store::Store;
use swarmbench::store::entries::ImportRow;
use swarmbench::store::imports::ImportFilter;
use tempfile::TempDir;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use sample::Size;

/// Whatever was read.
#[derive(Default)]
struct Collected {
    games: Vec<ImportRow>,
    problems: Vec<Problem>,
    progress: Vec<(u64, u64)>,
}

impl Taker for Collected {
    fn game(&mut self, game: ImportRow) -> anyhow::Result<()> {
        self.games.push(game);
        Ok(())
    }

    fn problem(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    fn progress(&mut self, done: u64, of: u64) {
        self.progress.push((done, of));
    }
}

impl Collected {
    fn of(path: &Path, bounds: &Bounds) -> Self {
        let mut taken = Self::default();
        read(path, bounds, &mut taken).expect("it can be read");
        taken
    }

    /// Problem of a file.
    fn problem(&self, file: &str) -> &str {
        let found: Vec<_> = self.problems.iter().filter(|problem| problem.file == file).collect();
        assert_eq!(found.len(), 1, "{file} in {:?}", self.problems);
        &found[0].problem
    }
}

/// A folder with the small sample.
fn small() -> (TempDir, Vec<PathBuf>) {
    let folder = TempDir::new().expect("a folder");
    let batches = sample::write(folder.path(), Size::SMALL);
    (folder, batches)
}

/// All files below a folder, by name.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

/// Puts a folder into an archive.
fn pack(folder: &Path, archive: &Path) {
    let mut zip = ZipWriter::new(File::create(archive).expect("a file"));
    for file in files(folder) {
        let name = file.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
        zip.start_file(name, SimpleFileOptions::default()).expect("a place");
        zip.write_all(&std::fs::read(&file).expect("a file")).expect("written");
    }
    zip.finish().expect("an archive");
}

/// Makes an archive of these files.
fn archive(entries: &[(&str, &[u8])]) -> (TempDir, PathBuf) {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("data.zip");
    let mut zip = ZipWriter::new(File::create(&path).expect("a file"));
    for (name, bytes) in entries {
        zip.start_file(*name, SimpleFileOptions::default()).expect("a place");
        zip.write_all(bytes).expect("written");
    }
    zip.finish().expect("an archive");
    (folder, path)
}

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

/// The first run of a batch.
fn first_run(batch: &Path) -> String {
    let index = json_of(&batch.join("meta_log.json"));
    index.as_object().expect("an object").keys().next().expect("a run").clone()
}

fn file(batch: &Path, kind: &str, run: &str) -> PathBuf {
    batch.join(format!("{kind}_log_{run}.json"))
}

/// Changes a file of JSON.
fn change(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value = json_of(path);
    change(&mut value);
    std::fs::write(path, value.to_string()).expect("written");
}

/// The name of a file in a problem.
fn told(path: &Path) -> String {
    let mut parts = path.components().rev().map(|part| part.as_os_str().to_string_lossy());
    let (name, folder) = (parts.next().expect("a name"), parts.next().expect("a folder"));
    format!("{folder}/{name}")
}

#[test]
fn a_folder_and_an_archive_of_it_hold_the_same_games() {
    let (folder, batches) = small();
    let from_folder = Collected::of(folder.path(), &Bounds::default());
    assert_eq!(from_folder.problems, []);
    assert_eq!(from_folder.games.len(), 8);
    assert_eq!(from_folder.progress.last(), Some(&(8, 8)));
    let place = TempDir::new().expect("a folder");
    let archive = place.path().join("data.zip");
    pack(folder.path(), &archive);
    let from_archive = Collected::of(&archive, &Bounds::default());
    assert_eq!(from_archive.problems, []);
    assert_eq!(from_archive.games, from_folder.games);
    // A batch may also lie at the top.
    assert_eq!(Collected::of(&batches[0], &Bounds::default()).games.len(), 4);
}

/// Everything that the files tell is kept.
#[test]
fn what_was_read_is_what_was_written() {
    let (folder, batches) = small();
    let taken = Collected::of(folder.path(), &Bounds::default());
    let mut compared = 0;
    for game in &taken.games {
        let batch = &batches[usize::from(
            game.task != json_of(&batches[0].join("meta_log.json"))[&game.run_id]["task"],
        )];
        let meta =
            serde_json::to_value(imported::meta(&game.meta).expect("settings")).expect("JSON");
        assert_eq!(meta, json_of(&batch.join("meta_log.json"))[&game.run_id]);
        assert_eq!(Value::from(game.seed), meta["seed"]);
        let states = json_of(&file(batch, "game", &game.run_id));
        let states = states.as_array().expect("a list");
        assert_eq!((game.rounds.len(), game.resolved as usize), (states.len(), states.len() - 1));
        assert_eq!(Value::from(game.score), states.last().expect("a state")["score"]);
        let mut acts = Vec::new();
        for (round, state) in game.rounds.iter().zip(states) {
            let row = imported::game_row(&game.task, round).expect("a state");
            assert_eq!(&serde_json::to_value(row).expect("JSON"), state);
            let shown = imported::state(&game.task, round).expect("a state");
            let rows: Vec<String> = (state["grid"].as_array().expect("rows").iter())
                .map(|row| {
                    row.as_array().expect("cells").iter().filter_map(Value::as_str).collect()
                })
                .collect();
            assert_eq!(shown.grid, rows);
            let more = |row: AgentRow| {
                acts.push(row);
                Ok(())
            };
            imported::each_act(round, 12, more).expect("acts");
            compared += 1;
        }
        assert_eq!(acts.len() as u64, game.acts);
        let mut read = serde_json::to_value(&acts).expect("JSON");
        for act in read.as_array_mut().expect("a list") {
            // A whole number of seconds is written as one.
            assert_eq!(act["api_call_time"], 0.0);
            act["api_call_time"] = json!(0);
        }
        assert_eq!(read, json_of(&file(batch, "agent", &game.run_id)));
    }
    assert_eq!(compared, 8 * 6);
}

#[test]
fn what_is_missing_or_broken_is_told_by_name_and_the_rest_is_read() {
    let (folder, batches) = small();
    let index = json_of(&batches[0].join("meta_log.json"));
    let runs: Vec<&String> = index.as_object().expect("an object").keys().collect();
    let [cut, without_acts, missing, alone] = runs[..] else { panic!("four runs") };
    // States that break off.
    let states = file(&batches[0], "game", cut);
    let text = std::fs::read(&states).expect("a file");
    std::fs::write(&states, &text[..text.len() / 2]).expect("written");
    // Acts that break off: the game is there, its acts are not.
    let acts = file(&batches[0], "agent", without_acts);
    let text = std::fs::read(&acts).expect("a file");
    std::fs::write(&acts, &text[..text.len() - 2]).expect("written");
    // Settings without logs.
    for kind in ["game", "agent"] {
        std::fs::remove_file(file(&batches[0], kind, missing)).expect("removed");
    }
    // Logs without settings.
    change(&batches[0].join("meta_log.json"), |index| {
        index.as_object_mut().expect("an object").remove(alone.as_str());
    });
    // A batch whose index breaks off after its first run.
    let index = batches[1].join("meta_log.json");
    let text = std::fs::read_to_string(&index).expect("a file");
    let second = text.match_indices("\"17460").nth(1).expect("a second run").0;
    std::fs::write(&index, &text[..second + 40]).expect("written");
    // Files of no interest.
    std::fs::write(batches[1].join("notes.txt"), "nothing").expect("written");

    let taken = Collected::of(folder.path(), &Bounds::default());
    let names: Vec<(&str, u64)> =
        taken.games.iter().map(|game| (game.run_id.as_str(), game.acts)).collect();
    assert_eq!(names, [(without_acts.as_str(), 0), (first_run_of(&text).as_str(), 60)]);
    assert!(taken.problem(&told(&states)).starts_with("is truncated"), "{:?}", taken.problems);
    let said = taken.problem(&told(&acts));
    assert!(said.starts_with("is truncated") && said.contains("without its acts"), "{said}");
    assert_eq!(taken.problem(&told(&file(&batches[0], "game", missing))), "is missing");
    assert!(taken.problem(&told(&file(&batches[0], "game", alone))).contains("meta_log.json"));
    let said = taken.problem(&told(&index));
    assert!(said.starts_with("is truncated") && said.contains("1 runs"), "{said}");
    // The runs behind the place where the index breaks off are reported, too.
    assert_eq!(taken.problems.len(), 5 + 3, "{:?}", taken.problems);
}

fn first_run_of(index: &str) -> String {
    index[2..].split('"').next().expect("a run").to_owned()
}

#[test]
fn what_cannot_be_is_told_and_skipped() {
    type Change = fn(&mut Value);
    let in_states: [(Change, &str); 19] = [
        (|rows| rows[1]["score"] = json!("high"), "invalid type"),
        (|rows| rows[2]["round"] = json!(7), "round 7 stands where round 2 was expected"),
        (|rows| rows[1]["grid"][3] = json!([".", "."]), "10 rows of 10 cells"),
        (|rows| rows[1]["grid"][3][4] = json!("AB"), "not one character"),
        (|rows| rows[1]["grid"][3][4] = json!("\u{7}"), "not one character"),
        (|rows| rows[0]["agents"][2]["id"] = json!("Agent\n2"), "not the name of an agent"),
        (|rows| rows[3]["agents"][2]["id"] = json!("Agent_99"), "not those of the rounds before"),
        (|rows| rows[0]["agents"] = json!([]), "0 agents, not 12"),
        (
            |rows| rows[1]["agents"][3]["x"] = json!(11),
            "round 1: Agent_3 is outside of the map of 10 × 10 cells, at x 11, y ",
        ),
        (|rows| rows[1]["agents"][3]["y"] = json!(-2), "round 1: Agent_3 is outside of the map"),
        (|rows| rows[2]["score"] = json!(-0.5), "round 2: the score falls from 0 to -0.5"),
        (|rows| rows[0]["score"] = json!(-1), "round 0: the score must be from 0 to 12, is -1"),
        (|rows| rows[5]["score"] = json!(12.5), "round 5: the score must be from 0 to 12, is 12.5"),
        (
            |rows| {
                let said = json!({ "round": 0, "agent_name": "Agent_3", "message": "hi" });
                rows[1]["messages"] = json!([said, said]);
            },
            "round 1: \"Agent_3\" has a second message",
        ),
        (
            |rows| {
                let said = json!({ "round": 0, "agent_name": "Agent_99", "message": "hi" });
                rows[1]["messages"] = json!([said]);
            },
            "round 1: a message is of \"Agent_99\"",
        ),
        (|rows| rows[0]["agents"][2]["id"] = json!("Agent_1"), "two agents have the name"),
        (|rows| rows[1]["task"] = json!("Chess"), "its task is"),
        (|rows| *rows = json!({ "round": 0 }), "expected a list"),
        (|rows| *rows = json!([]), "no states"),
    ];
    for (changed, expected) in in_states {
        let (_folder, batches) = small();
        let states = file(&batches[0], "game", &first_run(&batches[0]));
        change(&states, changed);
        let taken = Collected::of(&batches[0], &Bounds::default());
        assert_eq!((taken.games.len(), taken.problems.len()), (3, 1), "{:?}", taken.problems);
        assert!(taken.problems[0].problem.contains(expected), "{:?}", taken.problems);
        assert_eq!(taken.problems[0].skipped, Skipped::Game);
        assert_eq!(taken.problems[0].file, states.file_name().expect("a name").to_string_lossy());
    }
    let in_settings: [(Change, &str); 8] = [
        (|meta| meta["task"] = json!("Chess"), "is not known"),
        (|meta| meta["model"] = json!(7), "neither a name nor a list"),
        (|meta| meta["model"] = json!(""), "1 to 200 characters"),
        (|meta| meta["num_agents"] = json!(-1), "invalid value"),
        (|meta| meta["width"] = json!(0), "width must be from 1 to 1024, is 0"),
        (|meta| meta["seed"] = json!(1.5), "invalid type"),
        (|meta| *meta = json!("none"), "invalid type"),
        (
            |meta| {
                meta.as_object_mut().expect("an object").remove("height");
            },
            "missing field `height`",
        ),
    ];
    for (changed, expected) in in_settings {
        let (_folder, batches) = small();
        let run = first_run(&batches[0]);
        change(&batches[0].join("meta_log.json"), |index| changed(&mut index[&run]));
        let taken = Collected::of(&batches[0], &Bounds::default());
        assert_eq!((taken.games.len(), taken.problems.len()), (3, 1), "{:?}", taken.problems);
        let said = taken.problem("meta_log.json");
        assert!(said.contains(expected) && said.contains(&run), "{said}");
    }
    let in_acts: [(Change, &str); 7] = [
        (|rows| rows[5]["round"] = json!(99), "round 99, agent \"Agent_5\": there is no state"),
        (|rows| rows[5]["agent_id"] = json!("Agent_99"), "no agent of this run"),
        (
            |rows| rows[17]["action"] = json!("FLY"),
            "round 1, agent \"Agent_5\": the action \"FLY\" is not known",
        ),
        (
            |rows| {
                let row = rows[5].clone();
                rows.as_array_mut().expect("a list").push(row);
            },
            "round 0, agent \"Agent_5\": it has a second act",
        ),
        (|rows| rows[6] = rows[5].clone(), "round 0, agent \"Agent_5\": it has a second act"),
        (|rows| rows[5]["view"] = json!("wall"), "invalid type"),
        (|rows| rows[5]["total_llm_tokens"] = json!("many"), "invalid type"),
    ];
    for (changed, expected) in in_acts {
        let (_folder, batches) = small();
        let acts = file(&batches[0], "agent", &first_run(&batches[0]));
        change(&acts, changed);
        let taken = Collected::of(&batches[0], &Bounds::default());
        assert_eq!((taken.games.len(), taken.problems.len()), (4, 1), "{:?}", taken.problems);
        assert!(taken.problems[0].problem.contains(expected), "{:?}", taken.problems);
        assert_eq!(taken.problems[0].skipped, Skipped::Acts);
        assert_eq!(taken.games.iter().filter(|game| game.acts == 0).count(), 1);
    }
}

/// Agents leave the map in Transport alone, and stay on the cell to which they went.
#[test]
fn an_agent_that_has_escaped_is_on_the_next_cell_outside() {
    for (batch, task, whole) in [(0, "Transport", 4), (1, "Pursuit", 3)] {
        let (_folder, batches) = small();
        let run = first_run(&batches[batch]);
        assert_eq!(json_of(&batches[batch].join("meta_log.json"))[&run]["task"], task);
        change(&file(&batches[batch], "game", &run), |rows| {
            rows[4]["agents"][3] = json!({ "id": "Agent_3", "x": 10, "y": -1 });
        });
        let taken = Collected::of(&batches[batch], &Bounds::default());
        assert_eq!(taken.games.len(), whole, "{:?}", taken.problems);
    }
}

#[test]
fn what_the_toolkit_writes_for_agents_that_have_escaped_is_read() {
    let (_folder, batches) = small();
    change(&file(&batches[0], "agent", &first_run(&batches[0])), |rows| {
        rows[5]["action"] = json!("");
        rows[6]["action"] = Value::Null;
    });
    assert_eq!(Collected::of(&batches[0], &Bounds::default()).problems, []);
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let (folder, _) = small();
    let before = Collected::of(folder.path(), &Bounds::default()).games;
    for path in files(folder.path()) {
        let text = std::fs::read(&path).expect("a file");
        std::fs::write(&path, ["\u{feff}".as_bytes(), &text].concat()).expect("written");
    }
    let taken = Collected::of(folder.path(), &Bounds::default());
    assert_eq!((taken.games, taken.problems), (before, Vec::new()));
}

#[test]
fn no_column_has_a_reserved_word_for_its_name() {
    let words: Vec<String> = reserved::WORDS.split_whitespace().map(str::to_lowercase).collect();
    for word in ["to", "at", "end", "start", "value", "result"] {
        assert!(words.iter().any(|reserved| reserved == word), "{word}");
    }
    for table in TableName::ALL {
        for (number, (name, _)) in table.columns().iter().enumerate() {
            assert!(!words.iter().any(|word| word == name), "{name} in {}", table.name());
            let others = &table.columns()[..number];
            assert!(others.iter().all(|(other, _)| other != name), "{name} is there twice");
        }
    }
}

#[test]
fn run_ids_are_checked_before_they_become_names_of_files() {
    for bad in ["../../secret", "a/b", "a\\b", "..", "a.b", "a\u{0}", "a\n", "", &"x".repeat(129)] {
        let (_folder, batches) = small();
        let run = first_run(&batches[0]);
        change(&batches[0].join("meta_log.json"), |index| {
            let index = index.as_object_mut().expect("an object");
            let meta = index.remove(&run).expect("a run");
            index.insert(bad.to_owned(), meta);
        });
        let taken = Collected::of(&batches[0], &Bounds::default());
        assert_eq!(taken.games.len(), 3, "{bad:?}");
        assert!(taken.problem("meta_log.json").contains("is not one"), "{bad:?}");
    }
    let (_folder, path) =
        archive(&[("../../game_log_../x.json", b"[]"), ("game_log_a..b.json", b"[]")]);
    let taken = Collected::of(&path, &Bounds::default());
    assert!(taken.games.is_empty());
    assert_eq!(taken.problems.len(), 1, "{:?}", taken.problems);
    assert!(taken.problem("game_log_a..b.json").contains("is not one"));
}

#[test]
fn archives_are_bounded() {
    // So many entries that the directory is not even read.
    let names: Vec<String> = (0..30).map(|n| format!("{n}.txt")).collect();
    let entries: Vec<(&str, &[u8])> = names.iter().map(|name| (name.as_str(), &b""[..])).collect();
    let (_folder, path) = archive(&entries);
    let bounds = Bounds { entries_max: 29, ..Bounds::default() };
    let error = read(&path, &bounds, &mut Collected::default()).expect_err("too many");
    assert!(matches!(error.downcast_ref(), Some(ReadError::Entries { most: 29, .. })), "{error}");
    assert!(read(&path, &Bounds { entries_max: 30, ..bounds }, &mut Collected::default()).is_ok());

    // A bomb: it grows by much more than a game does. The bytes that come are counted.
    let meta = json!({ "r": {
        "model": "m", "task": "Pursuit", "num_agents": 1, "max_round": 1, "width": 1, "height": 1, "seed": 1,
        "view_size": 1,
    }});
    let meta = meta.to_string();
    let spaces = vec![b' '; 8 * 1024 * 1024];
    let bomb: [(&str, &[u8]); 2] =
        [("meta_log.json", meta.as_bytes()), ("game_log_r.json", &spaces)];
    let (_folder, path) = archive(&bomb);
    let taken = Collected::of(&path, &Bounds::default());
    assert!(taken.problem("game_log_r.json").contains("500 times"), "{:?}", taken.problems);
    let bounds = Bounds { file_bytes_max: 1024 * 1024, ..Bounds::default() };
    assert!(Collected::of(&path, &bounds).problem("game_log_r.json").contains("1048576 bytes"));
    let bounds = Bounds { total_bytes_max: 1024 * 1024, ..Bounds::default() };
    assert!(Collected::of(&path, &bounds).problem("game_log_r.json").contains("together"));

    // JSON within JSON, and archives within archives.
    let deep = "[".repeat(100_000);
    let deep_meta = format!("{{\"r\": {{\"x\": {deep}");
    let inner = std::fs::read(&path).expect("an archive");
    let nested: [(&str, &[u8]); 4] = [
        ("a/meta_log.json", meta.as_bytes()),
        ("a/game_log_r.json", deep.as_bytes()),
        ("b/meta_log.json", deep_meta.as_bytes()),
        ("b/inner.zip", &inner),
    ];
    let (_folder, path) = archive(&nested);
    let taken = Collected::of(&path, &Bounds::default());
    assert!(taken.games.is_empty());
    assert!(taken.problem("a/game_log_r.json").contains("more than 16 arrays and objects"));
    assert!(taken.problem("b/meta_log.json").contains("more than 16 arrays and objects"));
    assert!(taken.problem("b/inner.zip").contains("not opened"));
}

/// A game with much in it is refused before it is in memory.
#[test]
fn games_are_bounded() {
    let (_folder, batches) = small();
    let run = first_run(&batches[0]);
    let all = Bounds::default();
    for (bounds, file, problem) in [
        (Bounds { row_bytes_max: 600, ..all }, "game", "an element has more than 600 bytes"),
        (Bounds { row_values_max: 90, ..all }, "game", "an element has more than 90 values"),
        (Bounds { state_bytes_max: 700, ..all }, "game", "700 bytes (state_bytes_max)"),
        (Bounds { state_bytes_max: 1800, ..all }, "agent", "1800 bytes (state_bytes_max)"),
        (Bounds { game_bytes_max: 2000, ..all }, "game", "2000 bytes (game_bytes_max)"),
    ] {
        let taken = Collected::of(&batches[0], &bounds);
        let said = taken.problem(&format!("{file}_log_{run}.json"));
        assert!(said.contains(problem), "{said}");
    }
    for (bounds, problem) in [
        (Bounds { index_bytes_max: 400, ..all }, "it has more than 400 bytes"),
        (Bounds { settings_bytes_max: 100, ..all }, "an element has more than 100 bytes"),
    ] {
        let said = Collected::of(&batches[0], &bounds);
        assert!(said.problem("meta_log.json").contains(problem), "{:?}", said.problems);
    }
    // Settings of a few bytes would take a hundred times as many as values.
    change(&batches[0].join("meta_log.json"), |index| {
        index[&run]["more"] = json!(vec![json!({ "": 0 }); 9000]);
    });
    let said = Collected::of(&batches[0], &all);
    assert!(said.problem("meta_log.json").contains("more than 8192 values"), "{:?}", said.problems);
    // The directory of an archive stays in memory, names and comments included.
    let place = TempDir::new().expect("a folder");
    let archive = place.path().join("data.zip");
    pack(&batches[0], &archive);
    let bounds = Bounds { directory_bytes_max: 200, ..all };
    let error = read(&archive, &bounds, &mut Collected::default()).expect_err("too large");
    assert!(error.to_string().contains("directory is too large"), "{error}");
}

#[test]
fn what_is_no_archive_is_refused() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("data.zip");
    for bytes in [&b"Dear reader, this is no archive."[..], b"", b"PK\x05\x06"] {
        std::fs::write(&path, bytes).expect("written");
        let error =
            read(&path, &Bounds::default(), &mut Collected::default()).expect_err("no archive");
        assert!(error.to_string().contains("data.zip"), "{error}");
    }
    let (_folder, whole) = archive(&[("meta_log.json", b"{}")]);
    let bytes = std::fs::read(whole).expect("an archive");
    for length in 0..bytes.len() {
        std::fs::write(&path, &bytes[..length]).expect("written");
        assert!(
            read(&path, &Bounds::default(), &mut Collected::default()).is_err(),
            "{length} bytes"
        );
    }
}

/// A changed byte is found by the archive's sums, or makes files unreadable; it never becomes another game.
#[test]
fn a_changed_byte_makes_no_other_game() {
    let folder = TempDir::new().expect("a folder");
    let size = Size { tasks: 1, models: 1, seeds: 1, rounds: 2, prompt: 20 };
    sample::write(&folder.path().join("data"), size);
    let archive = folder.path().join("data.zip");
    pack(&folder.path().join("data"), &archive);
    let bytes = std::fs::read(&archive).expect("an archive");
    let original = Collected::of(&archive, &Bounds::default()).games;
    let [original] = &original[..] else { panic!("one game") };
    let (mut whole, mut others) = (0, 0);
    for place in (0..bytes.len()).step_by(7) {
        let mut changed = bytes.clone();
        changed[place] ^= 1 << (place % 8);
        std::fs::write(&archive, changed).expect("written");
        let mut taken = Collected::default();
        match read(&archive, &Bounds::default(), &mut taken) {
            Ok(()) if taken.games.is_empty() => others += 1,
            Ok(()) => {
                let game = &taken.games[0];
                assert_eq!(game.id, original.id, "byte {place}");
                assert!(game.acts == 0 || game == original, "byte {place}");
                whole += 1;
            }
            Err(_) => others += 1,
        }
    }
    // Names and times of entries may change without harm.
    assert!(whole > 0 && others > 0, "{whole} {others}");
}

#[cfg(unix)]
#[test]
fn links_are_not_followed() {
    let (folder, _batches) = small();
    let place = TempDir::new().expect("a folder");
    std::os::unix::fs::symlink(folder.path(), place.path().join("batch")).expect("a link");
    assert!(Collected::of(place.path(), &Bounds::default()).games.is_empty());
}

/// Runs the program as its user does.
fn swarmbench(args: &[&str], db: &Path) -> Output {
    let mut command = Command::new(swarmbench_testkit::program::program());
    command.args(args).arg("--db").arg(db).stdin(Stdio::null()).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Rows in the tables of a database.
async fn kept(db: &Path) -> Vec<(String, u64, f64)> {
    let store = Store::open_to_read(db).await.expect("it opens");
    let games = store.list_imports(&ImportFilter::default(), None, 1000).await.expect("a list");
    store.close().await;
    games.into_iter().map(|game| (game.id, game.acts, game.score)).collect()
}

#[tokio::test]
async fn the_same_data_again_changes_nothing_and_acts_that_were_missing_are_added() {
    let (folder, batches) = small();
    let place = TempDir::new().expect("a folder");
    let db = place.path().join("games.db");
    let acts = file(&batches[0], "agent", &first_run(&batches[0]));
    let whole = std::fs::read(&acts).expect("a file");
    std::fs::write(&acts, &whole[..100]).expect("written");
    let from = folder.path().display().to_string();

    let output = swarmbench(&["import", &from], &db);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains(&told(&acts)), "{}", text(&output.stderr));
    assert!(
        text(&output.stdout).contains("8 games imported with 420 acts"),
        "{}",
        text(&output.stdout)
    );
    let first = kept(&db).await;
    assert_eq!(first.len(), 8);

    let output = swarmbench(&["import", &from], &db);
    assert!(output.status.success() && text(&output.stdout).contains("8 were there already"));
    assert_eq!(kept(&db).await, first);

    std::fs::write(&acts, whole).expect("written");
    let output = swarmbench(&["import", &from], &db);
    let said = text(&output.stdout);
    assert!(
        said.contains(
            "0 games imported with 60 acts, 1 completed, 7 were there already; 0 problems, 0 games skipped"
        ),
        "{said}"
    );
    let second = kept(&db).await;
    assert_eq!(second.iter().map(|game| game.1).sum::<u64>(), 480);
    assert_eq!(second.len(), 8);

    // What comes out again is what went in.
    let out = place.path().join("out");
    let output = swarmbench(&["export", "--imported", &out.display().to_string()], &db);
    assert!(!output.status.success(), "both batches use the same run ids");
    let out = place.path().join("out-2");
    let task = json_of(&batches[0].join("meta_log.json"))[&first_run(&batches[0])]["task"].clone();
    let args = ["export", "--imported", "--task", task.as_str().expect("a name")];
    let output = swarmbench(&[&args[..], &[&out.display().to_string()]].concat(), &db);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let taken = Collected::of(&out, &Bounds::default());
    assert_eq!(taken.problems, []);
    assert_eq!(taken.games, Collected::of(&batches[0], &Bounds::default()).games);

    let states = file(&batches[1], "game", &first_run(&batches[1]));
    std::fs::remove_file(&states).expect("removed");
    let output = swarmbench(&["import", &from], &db);
    assert_eq!(output.status.code(), Some(1), "a game is skipped");
    let said = text(&output.stdout);
    assert!(said.contains("7 were there already; 1 problems, 1 games skipped"), "{said}");

    let out = place.path().join("out-3");
    let args = ["export", "--imported", "--model", "modle-1", &out.display().to_string()];
    let output = swarmbench(&args, &db);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        said.contains(
            "no game matches --imported --model modle-1; models that have games: \"model-1\", \"model-0\""
        ),
        "{said}"
    );
    assert!(!out.exists() && !out.with_extension("partial").exists());

    // Nothing is made where nothing can be read, or nothing is there to be written.
    let (missing, new) = (place.path().join("missing"), place.path().join("new.db"));
    let output = swarmbench(&["import", &missing.display().to_string()], &new);
    let said = text(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("there is no folder"), "{said}");
    assert!(!new.exists());
    for with in [&["export"][..], &["export", "--format", "jsonl"]] {
        let out = place.path().join("out-4");
        let output = swarmbench(&[with, &[&out.display().to_string()]].concat(), &db);
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(1) && said.contains("no games to export"), "{said}");
        assert!(!out.exists() && !out.with_extension("partial").exists());
    }

    let empty = TempDir::new().expect("a folder");
    let output = swarmbench(&["import", &empty.path().display().to_string()], &db);
    assert!(!output.status.success() && text(&output.stderr).contains("no game"));
}
