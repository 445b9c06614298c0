//! The command line, run as its user runs it.

mod commands;
mod mcp;
mod migrate;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::{Value, json};
use swarmbench_boards::competition::export::{Line, Writer};
use swarmbench_boards::competition::sealed::Sealed;
use swarmbench_journal::chain::Head;
use swarmbench_protocol::suite::SuiteSettings;

fn swarmbench(args: &[&str]) -> Output {
    Command::new(swarmbench_testkit::program::program())
        .args(args)
        .stdin(Stdio::null())
        .output()
        .expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_demo_plays_all_tasks_and_tells_how_to_join() {
    let folder = tempfile::tempdir().expect("a folder");
    let db = folder.path().join("demo.db");
    let output = swarmbench(&["demo", "--exit", "--db", &db.display().to_string()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let shown = text(&output.stdout);
    for expected in [
        "Transport",
        "Pursuit",
        "Synchronization",
        "Foraging",
        "Flocking",
        "100.00",
        "task_done",
        "curl",
        "/docs",
        &db.display().to_string(),
    ] {
        assert!(shown.contains(expected), "{expected:?} is missing in {shown}");
    }
    assert!(db.exists());
}

#[test]
fn commands_that_have_moved_name_their_successors() {
    for (args, expected) in [
        (
            &["figure", "trends", "--from", "games", "--out", "trends.svg"][..],
            "`swarmbench figure trends` has moved to Python: swarmseat-analysis trends GAMES --out FILE\n",
        ),
        (
            &["figure", "frame", "game.jsonl", "--rounds", "0"],
            "`swarmbench figure frame` has moved: swarmbench replay GAME --moments ROUND,… --picture FILE\n",
        ),
        (
            &["figure", "--help"],
            "`swarmbench figure` has moved to Python: swarmseat-analysis --help\n",
        ),
        (
            &["correlations", "--matrix", "--from", "games"],
            "`swarmbench correlations` has moved to Python: swarmseat-analysis correlations GAMES\n",
        ),
        (
            &["loadtest", "acts"],
            "`swarmbench loadtest` has moved: cargo run --release -p swarmbench-bench -- loadtest …\n",
        ),
    ] {
        let output = swarmbench(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert_eq!((text(&output.stderr).as_str(), text(&output.stdout).as_str()), (expected, ""));
    }
}

#[test]
fn errors_say_what_to_do_next() {
    for (args, expected) in [
        (&["play", "--task", "Chess"][..], "the tasks are Transport, Pursuit"),
        (&["play", "--task", "Transport", "--player", "nobody"], "push-and-leave"),
        (
            &["play", "--task", "Transport", "--server", "http://127.0.0.1:1"],
            "`swarmbench serve` starts one",
        ),
        (
            &[
                "serve",
                "--addr",
                "0.0.0.0:0",
                "--db",
                concat!(env!("CARGO_TARGET_TMPDIR"), "/never.db"),
            ],
            "swarmbench key create",
        ),
        (&["verify", "no-such-file.jsonl"], "no-such-file.jsonl"),
        (&["verify", "Cargo.toml"], "line 1: not a line of a journal"),
        (&["verify", "-", "--head", "12"], "64 hexadecimal digits"),
        (&["play", "--task", "Transport", "--server", "127.0.0.1:1"], "http://127.0.0.1:8080"),
        (&["healthcheck", "--server", "http://127.0.0.1:1/api/v1"], "without a path"),
        (&["play", "--task", "transport", "--rules", "mine"], "the rule sets are paper, reference"),
        (&["play", "--task", "transport", "--seed", "abc"], "must be a whole number"),
        (
            &["play", "--task", "transport", "--player-seed", "-1"],
            "must be a whole number, 0 or more",
        ),
        (
            &["eval", "--player", "default", "--noise", "-1", "--dry-run"],
            "a probability from 0 to 1",
        ),
        (&["eval", "--player", "default", "--seeds", "-1"], "a number is from 0 to"),
        (&["demo", "--port", "-1"], "-1 is not in 0..=65535"),
        (&["serve", "--addr", "8080"], "an address and a port, such as 127.0.0.1:8080"),
        (
            &["serve", "--addr", "127.0.0.1:0", "--db", "no-folder/x.db"],
            "no folder no-folder: create it",
        ),
    ] {
        let output = swarmbench(args);
        let said = text(&output.stderr);
        assert!(!output.status.success(), "{args:?}");
        assert!(said.contains(expected), "{args:?} said {said}");
    }
}

/// Files that nest deeper than any stack.
#[test]
fn files_that_nest_deep_are_errors_of_the_commands_that_read_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = Serving::start(&folder.path().join("deep.db"), &[]);
    let times = 100_000;
    let (lists, names) =
        (["[".repeat(times), "]".repeat(times)].concat(), vec!["a"; times].join("."));
    let hash = "0".repeat(64);
    for (name, content, commands) in [
        ("lists.json", lists.clone(), &["import", "verify --competition"][..]),
        (
            "record.jsonl",
            format!("{{\"hash\":\"{hash}\",\"record\":{lists}}}\n"),
            &["verify", "metrics", "replay --html x"],
        ),
        ("rows.jsonl", format!("{{\"a\":{lists}}}\n"), &["table main --from"]),
        ("lists.toml", format!("a = {lists}"), &["eval", "competition create"]),
        ("tables.toml", format!("a = {}", "{a=".repeat(times)), &["eval", "competition create"]),
        ("names.toml", format!("{names} = 1"), &["eval", "competition create"]),
        ("headers.toml", format!("[[{names}]]"), &["eval", "competition create"]),
    ] {
        let file = folder.path().join(name);
        std::fs::write(&file, content).expect("a file");
        for command in commands {
            let mut args: Vec<&str> = command.split(' ').collect();
            let file = file.display().to_string();
            args.push(&file);
            if command.starts_with("competition") {
                args.extend(["--server", &server.base]);
            }
            let output = swarmbench(&args);
            let said = text(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{command} {name}: {said}");
            assert!(said.starts_with("error: "), "{command} {name}: {said}");
        }
    }
}

#[tokio::test]
async fn a_negative_seed_is_refused_with_the_range() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = Serving::start(&folder.path().join("seeds.db"), &[]);
    let refused =
        swarmbench(&["play", "--task", "foraging", "--seed", "-1", "--server", &server.base]);
    let said = text(&refused.stderr);
    assert!(said.contains("seed must be from 0 to 9007199254740991, is -1"), "{said}");
}

#[tokio::test]
async fn a_database_of_another_program_is_refused_and_stays_as_it_is() {
    use sqlx::{ConnectOptions, Connection};
    let folder = tempfile::tempdir().expect("a folder");
    let [other, letter] = ["other.db", "letter.db"].map(|name| folder.path().join(name));
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&other);
    let mut made = options.create_if_missing(true).connect().await.expect("a database");
    sqlx::query("CREATE TABLE recipes (name TEXT)").execute(&mut made).await.expect("a table");
    made.close().await.expect("it is written");
    std::fs::write(&letter, "Dear reader, this is a letter.").expect("a file");
    for file in [&other, &letter] {
        let was = std::fs::read(file).expect("a file");
        let db = file.display().to_string();
        for args in [
            &["serve", "--addr", "127.0.0.1:0"][..],
            &["key", "create", "--name", "alice"],
            &["leaderboard"],
            &["verify"],
            &["table", "main"],
        ] {
            let output = swarmbench(&[args, &["--db", &db]].concat());
            let said = text(&output.stderr);
            assert!(
                !output.status.success() && said.contains("not a database of this program"),
                "{args:?}: {said}"
            );
        }
        assert_eq!(std::fs::read(file).expect("a file"), was);
    }
}

/// A competition that nobody entered.
fn empty_competition() -> String {
    let sealed = Sealed { salt: [1; 32], seeds: vec![[2; 16], [3; 16]] };
    let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
    let window = json!({ "opens_at": "2026-03-01T12:00:00Z", "closes_at": "2026-03-02T12:00:00Z" });
    let definition = json!({
        "name": "a cup", "description": "", "tasks": ["Foraging"], "seeds": 2, "rules": "paper",
        "settings": SuiteSettings { round_deadline_ms: Some(1000), ..SuiteSettings::default() },
        "idle_timeout_ms": 1000, "opens_at": window["opens_at"], "closes_at": window["closes_at"],
        "entry": "anybody", "attempts": [window], "parallel": 1, "counts": "best", "board": "public",
        "entries_per_key": 1,
    });
    let records = [
        json!({
            "kind": "competition", "format": 1, "id": "cmp_1", "definition": definition,
            "created_at": "2026-03-01T11:00:00Z", "revealed_at": "2026-03-02T12:00:01Z",
            "commitment": hex(&sealed.commitment()), "salt": hex(&sealed.salt),
            "seeds": sealed.seeds.iter().map(|seed| hex(seed)).collect::<Vec<_>>(),
        }),
        json!({ "kind": "board", "rows": [] }),
        json!({ "kind": "end", "episodes": 0 }),
    ];
    let mut writer = Writer::default();
    let line = |record: Value| writer.line(&Line::parse(&record.to_string()).expect("a record"));
    records.map(line).concat()
}

/// Runs `verify`, which has to succeed; returns what it says.
fn verified(args: &[&str]) -> String {
    let output = swarmbench(&[&["verify"], args].concat());
    assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The hash that `verify` shows in a row of its table.
fn hash_in<'a>(said: &'a str, row: &str) -> &'a str {
    let line = said.lines().find(|line| line.contains(row)).expect("the row");
    line.split_whitespace().find(|word| word.len() == 64).expect("a hash")
}

#[test]
fn verify_names_what_it_has_not_proven() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/1");
    let heads = std::fs::read_to_string(folder.join("heads.tsv")).expect("heads");
    let mut game = heads.lines().next().expect("a game").split('\t');
    let mut field = || game.next().expect("a field");
    let file = folder.join(format!("{}.jsonl", field())).display().to_string();
    let head = field();
    let said = verified(&[&file]);
    for expected in ["not proven", "anybody can write", "What a head proves", "result.journal_head"]
    {
        assert!(said.contains(expected), "{expected:?} is missing in {said}");
    }
    assert!(!verified(&[&file, "--head", head]).contains("not proven"));

    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cup.jsonl");
    std::fs::write(&file, empty_competition()).expect("a file");
    let file = file.display().to_string();
    let said = verified(&["--competition", &file]);
    let (head, commitment) = (hash_in(&said, "head of the file"), hash_in(&said, "commitment"));
    for (args, unproven) in [
        (vec![], vec!["the published file", "chosen afterwards"]),
        (vec!["--commitment", commitment], vec!["the published file"]),
        (vec!["--head", head], vec!["chosen afterwards"]),
        (vec!["--head", head, "--commitment", commitment], vec![]),
    ] {
        let said = verified(&[&["--competition", &file], &args[..]].concat());
        assert_eq!(said.matches("not proven").count(), unproven.len(), "{args:?}: {said}");
        assert!(unproven.iter().all(|text| said.contains(text)), "{args:?}: {said}");
    }
}

/// A journal of another model, as anybody may write one.
fn journal_of(model: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/1/abandoned.jsonl");
    let journal = std::fs::read_to_string(file).expect("a journal");
    let model = format!(r#""model":{}"#, json!(model));
    let mut head = Head::START;
    let lines = journal.lines().map(|line| {
        let record = line.split_once(r#""record":"#).expect("a record").1;
        let record = record.strip_suffix('}').expect("an end");
        let record = record.replacen(r#""model":"abandoned""#, &model, 1);
        head = head.link(record.as_bytes());
        format!("{{\"hash\":\"{head}\",\"record\":{record}}}\n")
    });
    lines.collect()
}

/// Foreign text reaches a terminal as text: it sets no title, moves no cursor, and turns nothing around.
#[test]
fn what_others_wrote_is_not_obeyed_by_a_terminal() {
    let folder = tempfile::tempdir().expect("a folder");
    let name = "\u{1b}]0;owned\u{7}me \u{202e}em\u{9b}2J";
    let file = folder.path().join("game.jsonl");
    std::fs::write(&file, journal_of(name)).expect("a file");
    let file = file.display().to_string();
    let said = verified(&[&file]);
    assert!(said.contains(r"\u001b]0;owned\u0007me \u202eem\u009b2J"), "{said}");
    // Data are what they are.
    let said = verified(&[&file, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(json["model"], name);
    assert!(said.contains('\u{202e}'), "{said}");
    let journal = folder.path().join("journal.jsonl");
    std::fs::write(&journal, "{\"record\":{\"kind\":\"\u{1b}\u{202e}\"}}\n").expect("a file");
    let journal = journal.display().to_string();
    let missing = format!("no-such{name}");
    for args in
        [["verify", &missing], ["import", &missing], ["replay", &journal], ["verify", &journal]]
    {
        let said = text(&swarmbench(&args).stderr);
        let hidden = |c: char| c != '\n' && (c.is_control() || c == '\u{202e}');
        assert!(!said.is_empty() && !said.contains(hidden), "{args:?}: {said:?}");
    }
}

/// Without a terminal there is a line for a game, not one for a round.
#[test]
fn play_writes_a_line_where_nobody_watches() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = Serving::start(&folder.path().join("play.db"), &[]);
    let game = ["play", "--task", "Foraging", "--max-round", "30", "--num-agents", "2"];
    let output = swarmbench(&[&game[..], &["--server", &server.base]].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stderr);
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains("is opened: ep_"), "{said}");
}

/// A database has journals and is none: every command that reads one says what to do with it, whatever its name is.
#[test]
fn a_database_in_the_place_of_a_journal_is_called_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let db = folder.path().join("games").display().to_string();
    let made = swarmbench(&["key", "create", "--name", "k", "--role", "organizer", "--db", &db]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let journal = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/1/abandoned.jsonl");
    let journal = journal.display().to_string();
    for args in [
        &["verify", &db][..],
        &["verify", "--competition", &db],
        &["verify", &journal, "--parent", &db],
        &["replay", &db, "--html", "never.html"],
        &["replay", &db, "--gif", "never.gif"],
        &["metrics", &db],
        &["replay", &db, "--moments", "0", "--picture", "never.svg"],
    ] {
        let said = text(&swarmbench(args).stderr);
        for expected in
            [format!("{db} is a database"), format!("verify --db {db}"), format!("serve --db {db}")]
        {
            assert!(said.contains(&expected), "{args:?}: {said}");
        }
    }
    // Any other file is named for what it is not.
    let file = folder.path().join("bytes");
    std::fs::write(&file, [0xff, 0xfe]).expect("a file");
    let said = swarmbench(&["replay", &file.display().to_string(), "--gif", "never.gif"]);
    assert!(text(&said.stderr).contains("this is no journal"), "{}", text(&said.stderr));
}

/// A device or a pipe has no end, or nobody at its other one.
#[test]
fn files_without_an_end_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
    assert!(made.success());
    let db = folder.path().join("games.db").display().to_string();
    let journal = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/1/abandoned.jsonl");
    let journal = journal.display().to_string();
    for file in ["/dev/zero", &pipe.display().to_string()] {
        let system = format!("@{file}");
        for args in [
            &["verify", file][..],
            &["verify", "--competition", file],
            &["verify", &journal, "--parent", file],
            &["replay", file, "--html", "never.html"],
            &["metrics", file],
            &["import", file, "--db", &db],
            &["eval", file, "--dry-run"],
            &["eval", "--player", "default", "--prompt-template", file, "--dry-run"],
            &["eval", "--model", "m", "--system", &system, "--dry-run"],
            &["table", "main", "--from", file],
        ] {
            let output = swarmbench(args);
            let said = text(&output.stderr);
            assert!(!output.status.success() && said.contains(file), "{args:?}: {said}");
            assert!(output.status.code().is_some_and(|code| code < 100), "{args:?}: {said}");
        }
    }
    let output = swarmbench(&["verify", &folder.path().display().to_string()]);
    assert!(text(&output.stderr).contains("not a regular file"), "{}", text(&output.stderr));
}

#[test]
fn help_teaches() {
    let shown = text(&swarmbench(&["--help"]).stdout);
    for command in [
        "demo",
        "serve",
        "key",
        "clock",
        "play",
        "eval",
        "verify",
        "backup",
        "openapi",
        "healthcheck",
    ] {
        assert!(shown.contains(command), "{shown}");
        let help = swarmbench(&[command, "--help"]);
        assert!(help.status.success());
        assert!(text(&help.stdout).contains("Usage:"));
    }
}

#[test]
fn the_openapi_document_is_printed() {
    let printed = text(&swarmbench(&["openapi"]).stdout);
    assert_eq!(printed, swarmbench::http::openapi::document());
}

/// A server in a process of its own; it is ended with the test.
struct Serving {
    process: Child,
    log: PathBuf,
    base: String,
}

impl Serving {
    /// Starts `swarmbench serve` and reads off its log where it listens.
    fn start(db: &Path, args: &[&str]) -> Self {
        let log = db.with_extension("log");
        let process = Command::new(swarmbench_testkit::program::program())
            .args(["serve", "--addr", "127.0.0.1:0", "--db", &db.display().to_string()])
            .args(args)
            .env("RUST_LOG", "trace")
            .stdin(Stdio::null())
            .stderr(File::create(&log).expect("a log"))
            .spawn()
            .expect("the binary runs");
        let mut serving = Self { process, log, base: String::new() };
        while serving.base.is_empty() {
            let ended = serving.process.try_wait().expect("a process");
            assert!(ended.is_none(), "it ended: {}", serving.logged());
            let logged = serving.logged();
            let told = logged
                .split("documentation at ")
                .nth(1)
                .and_then(|rest| rest.split("/docs").next());
            told.unwrap_or_default().clone_into(&mut serving.base);
            std::thread::yield_now();
        }
        serving
    }

    fn logged(&self) -> String {
        std::fs::read_to_string(&self.log).expect("a log")
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        // It may have ended by itself.
        drop(self.process.kill());
        drop(self.process.wait());
    }
}

#[test]
fn keys_are_made_where_the_server_is_stopped_and_by_organizers() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("keys.db");
    let db = path.display().to_string();
    let make = ["key", "create", "--name", "alice", "--role", "organizer", "--db", &db];
    let made = swarmbench(&make);
    let organizer = text(&made.stdout).trim().to_owned();
    assert!(organizer.starts_with("secret_"), "{}", text(&made.stderr));
    assert!(text(&made.stderr).contains("cannot be shown again"));

    let server = Serving::start(&path, &[]);
    let refused = swarmbench(&make);
    let said = text(&refused.stderr);
    assert!(!refused.status.success() && said.contains("--server"), "{said}");
    let behind = |key: &str, args: &[&str]| {
        Command::new(swarmbench_testkit::program::program())
            .arg("key")
            .args(args)
            .args(["--server", &server.base])
            .env("SWARMBENCH_KEY", key)
            .output()
            .expect("the binary runs")
    };
    let made = behind(&organizer, &["create", "--name", "team blue", "--expires", "30d"]);
    let member = text(&made.stdout).trim().to_owned();
    assert!(member.starts_with("secret_"), "{}", text(&made.stderr));
    let refused = behind(&member, &["list"]);
    assert!(text(&refused.stderr).contains("organizer"), "{}", text(&refused.stderr));
    let listed = text(&behind(&organizer, &["list"]).stdout);
    assert!(listed.contains("team blue") && listed.contains("alice"), "{listed}");
    let id = listed.lines().find(|line| line.contains("team blue")).expect("a row");
    let id = id.split_whitespace().find(|word| word.starts_with("key_")).expect("an id");
    let revoked = behind(&organizer, &["revoke", id]);
    assert!(text(&revoked.stdout).contains("is revoked"), "{}", text(&revoked.stderr));

    // What was done while the server was stopped is in the audit log, too.
    let log = Command::new(swarmbench_testkit::program::program())
        .args(["audit", "--json", "--server", &server.base])
        .env("SWARMBENCH_KEY", &organizer)
        .output()
        .expect("the binary runs");
    let log = text(&log.stdout);
    let entry = |line: &str| {
        let entry: Value = serde_json::from_str(line).expect("JSON");
        (entry["who"] == "local", entry["action"].as_str().expect("a text").to_owned())
    };
    let audit: Vec<_> = log.lines().map(entry).collect();
    let [revoke, create] = ["key.revoke", "key.create"].map(str::to_owned);
    assert_eq!(audit, [(false, revoke), (false, create.clone()), (true, create)]);

    let play = |key: &str| {
        Command::new(swarmbench_testkit::program::program())
            .args([
                "play",
                "--task",
                "Synchronization",
                "--max-round",
                "2",
                "--server",
                &server.base,
            ])
            .env("SWARMBENCH_KEY", key)
            .output()
            .expect("the binary runs")
    };
    assert!(!play(&member).status.success());
    let played = play(&organizer);
    assert!(played.status.success(), "{}", text(&played.stderr));
}

#[test]
fn an_organizer_confirms_the_clock() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("clock.db");
    let db = path.display().to_string();
    let [organizer, member] = ["organizer", "member"].map(|role| {
        let made = swarmbench(&["key", "create", "--name", role, "--role", role, "--db", &db]);
        text(&made.stdout).trim().to_owned()
    });
    let server = Serving::start(&path, &[]);
    let confirm = |key: &str| {
        Command::new(swarmbench_testkit::program::program())
            .args(["clock", "confirm", "--server", &server.base])
            .env("SWARMBENCH_KEY", key)
            .output()
            .expect("the binary runs")
    };
    let refused = confirm(&member);
    let said = text(&refused.stderr);
    assert!(!refused.status.success() && said.contains("organizer"), "{said}");
    let confirmed = confirm(&organizer);
    let shown = text(&confirmed.stdout);
    assert!(confirmed.status.success(), "{}", text(&confirmed.stderr));
    assert!(shown.contains("before  20") && shown.contains("was not in doubt"), "{shown}");
}

#[tokio::test]
async fn a_run_is_played_and_one_that_was_left_is_played_to_its_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = Serving::start(&folder.path().join("runs.db"), &[]);
    let play = |args: &[&str], token: Option<&str>| {
        let mut command = Command::new(swarmbench_testkit::program::program());
        command.arg("play").args(args).args(["--server", &server.base]);
        if let Some(token) = token {
            command.env("SWARMBENCH_RUN_TOKEN", token);
        }
        command.output().expect("the binary runs")
    };
    let played = play(&["--suite", "quick", "--rules", "reference", "--parallel", "2"], None);
    let said = text(&played.stdout);
    assert!(played.status.success(), "{}", text(&played.stderr));
    let id = said.split_whitespace().find(|word| word.starts_with("run_")).expect("an id");
    assert!(said.contains("finished: ") && said.contains("5/5"), "{said}");

    // The table is what the server says, and the games are those that `play --task` plays.
    let client = reqwest::Client::new();
    let get = async |path: String| -> serde_json::Value {
        let call = client.get(format!("{}/api/v1/{path}", server.base));
        call.send().await.expect("an answer").json().await.expect("JSON")
    };
    let run = get(format!("runs/{}", id.trim_end_matches(';'))).await;
    assert_eq!(
        (&run["model"], &run["suite"]["rules"]),
        (&"built-in/default".into(), &"reference".into())
    );
    let total = run["total"].as_f64().expect("a total");
    assert!(said.contains(&format!("{total:.2}")), "{said}");
    let alone = ["--task", "Foraging", "--seed", "27", "--max-round", "20", "--rules", "reference"];
    assert!(play(&alone, None).status.success());
    let episode = &get("episodes?task=Foraging&limit=1".to_owned()).await["items"][0];
    let task = &run["tasks"][3];
    assert_eq!((&task["task"], &task["mean"]), (&"Foraging".into(), &episode["score"]));

    // Somebody else began a run; its client has gone. First with its token, then with a new one.
    let suite = serde_json::json!({ "name": "x", "seeds": [1], "settings": { "max_round": 2 } });
    let request = serde_json::json!({ "suite": suite, "model": "m" });
    for with_token in [true, false] {
        let call = client.post(format!("{}/api/v1/runs", server.base)).json(&request);
        let left: serde_json::Value =
            call.send().await.expect("an answer").json().await.expect("JSON");
        let id = left["id"].as_str().expect("an id");
        let token = left["swarm_token"].as_str().filter(|_| with_token);
        let played = play(&["--run", id, "--player", "random"], token);
        assert!(played.status.success(), "{}", text(&played.stderr));
        assert!(text(&played.stdout).contains("5/5"), "{}", text(&played.stdout));
        assert_eq!(get(format!("runs/{id}")).await["status"], "finished");
    }
    let wrong = play(&["--suite", "chess"], None);
    assert!(!wrong.status.success() && text(&wrong.stderr).contains("standard, quick, baselines"));
}

/// Logs, errors, pages and the database contain no token.
#[tokio::test]
async fn tokens_are_shown_once_and_nowhere_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tokens.db");
    let db = path.display().to_string();
    let made = swarmbench(&["key", "create", "--name", "o", "--role", "organizer", "--db", &db]);
    let organizer = text(&made.stdout).trim().to_owned();
    let server = Serving::start(&path, &[]);
    let client = reqwest::Client::new();
    let mut answers = Vec::new();
    let mut secrets = vec![organizer.clone()];

    let create = client
        .post(format!("{}/api/v1/episodes", server.base))
        .bearer_auth(&organizer)
        .json(&serde_json::json!({ "task": "Synchronization", "num_agents": 2, "max_round": 1 }));
    let created: serde_json::Value =
        create.send().await.expect("an answer").json().await.expect("JSON");
    let id = created["id"].as_str().expect("an id").to_owned();
    secrets.push(created["swarm_token"].as_str().expect("a token").to_owned());
    for seat in created["seats"].as_array().expect("seats") {
        secrets.push(seat["token"].as_str().expect("a token").to_owned());
    }
    let act = serde_json::json!({ "round": 0, "action": "SWITCH" });
    let (episode, round) = (format!("/api/v1/episodes/{id}"), "/api/v1/episodes");
    for token in &secrets {
        for path in
            ["/obs?prompt=true", "/swarm/obs", "/obs?seed", round, "/api/v1/keys", "/metrics"]
        {
            let call = client.get(format!("{}{path}", server.base)).bearer_auth(token);
            answers.push(call.send().await.expect("an answer").text().await.expect("text"));
        }
        for body in [act.to_string(), "{".to_owned(), "{\"seed\":1}".to_owned()] {
            for path in ["/act", "/swarm/act", round, "/api/v1/keys"] {
                let call = client.post(format!("{}{path}", server.base)).bearer_auth(token);
                let call = call.header("content-type", "application/json").body(body.clone());
                answers.push(call.send().await.expect("an answer").text().await.expect("text"));
            }
        }
        // One character is wrong.
        let wrong = &token[..token.len() - 1];
        let call = client.get(format!("{}/obs", server.base)).bearer_auth(wrong);
        answers.push(call.send().await.expect("an answer").text().await.expect("text"));
    }
    for rest in ["", "/state", "/journal", "/events"] {
        let call = client.get(format!("{}{episode}{rest}", server.base));
        answers.push(call.send().await.expect("an answer").text().await.expect("text"));
    }
    assert!(answers.iter().any(|answer| answer.contains("\"valid\":true")), "nobody acted");
    assert!(answers.iter().any(|answer| answer.contains("event: finished")), "it did not end");

    let log = server.logged();
    assert!(log.contains("POST") && log.contains(&id), "the log says too little to tell");
    drop(server);
    let mut kept = Vec::new();
    for file in std::fs::read_dir(folder.path()).expect("a folder") {
        kept.extend(std::fs::read(file.expect("a file").path()).expect("a file"));
    }
    for secret in &secrets {
        // Without its last characters, lest a part of it is somewhere.
        let secret = &secret[..secret.len() - 8];
        assert!(!log.contains(secret), "a token is in the log");
        assert!(!answers.iter().any(|answer| answer.contains(secret)), "a token is in an answer");
        let secret = secret.as_bytes();
        assert!(!kept.windows(secret.len()).any(|part| part == secret), "a token is on the disk");
    }
}
