//! Rules for every command: it does not panic where nobody reads, and what it shows is there as JSON, too.

use std::cell::{Cell, OnceCell};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{Serving, empty_competition, text};

/// Every command of the program, by its words: those of `--help`, and of the help of commands that have commands.
fn commands() -> Vec<String> {
    let named = |words: &[&str]| -> Vec<String> {
        let help =
            Command::new(swarmbench_testkit::program::program()).args(words).arg("--help").output();
        let help = text(&help.expect("the binary runs").stdout);
        let Some((_, list)) = help.split_once("Commands:\n") else { return Vec::new() };
        // Further lines about a command are indented further.
        let lines = list.lines().take_while(|line| !line.is_empty());
        let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
        names.filter(|name| !["", "help"].contains(name)).map(str::to_owned).collect()
    };
    let inner = |first: String| match named(&[&first]) {
        inner if inner.is_empty() => vec![first],
        inner => inner.into_iter().map(|second| format!("{first} {second}")).collect(),
    };
    named(&[]).into_iter().flat_map(inner).collect()
}

/// Standard output of a command.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shows {
    /// A table or facts; with `--json` one JSON value.
    Facts,
    /// A table; with `--json` one JSON value a line.
    List,
    /// Something that is no table, such as this.
    Other(&'static str),
}
use Shows::{Facts, List, Other};

/// The arguments of a command, made anew for each time it is run.
type Arguments = fn(&Site) -> Vec<String>;

const CASES: [(&str, Shows, Arguments); 62] = [
    ("demo", Facts, |site| words("--exit --db", [site.new_file("demo.db")])),
    ("serve", Other("runs until it is stopped"), |_| words("--addr no-address", [])),
    ("key create", Facts, |site| words("--name somebody --server", [site.base()])),
    ("key list", Facts, |site| words("--server", [site.base()])),
    ("key revoke", Facts, |site| {
        let created = site.post("keys", true, &json!({ "name": "nobody" }));
        words("--server", [site.base(), string(&created["id"])])
    }),
    ("competition create", Facts, |site| words("", [site.definition()])),
    ("competition list", Facts, |_| Vec::new()),
    ("competition show", Facts, |site| words("", [site.competition()])),
    ("competition codes", Facts, |site| words("", [site.competition(), "a team".to_owned()])),
    ("competition enter", Facts, |site| words("--name newcomer --model m", [site.competition()])),
    ("competition attempt", Facts, |site| {
        let (competition, entrant) = site.entrant();
        words("--entrant", [entrant, competition])
    }),
    ("competition attempts", Facts, |site| words("", [site.attempt().0])),
    ("competition entrants", Facts, |site| words("", [site.entrant().0])),
    ("competition contacts", Facts, |site| words("", [site.entrant().0])),
    ("competition disqualify", Facts, |site| words("--reason because", site.entrant().into())),
    ("competition withdraw", Facts, |site| words("", site.entrant().into())),
    ("competition readmit", Facts, |site| words("", site.entrant().into())),
    ("competition vouch", Facts, |site| words("", site.entrant().into())),
    ("competition void", Facts, |site| words("--reason because", site.attempt().into())),
    ("competition change", Facts, |site| words("--hide", [site.competition()])),
    ("competition cancel", Facts, |site| words("--reason because", [site.competition()])),
    ("competition actions", Facts, |site| words("", [site.competition()])),
    ("competition announce", Facts, |site| words("--text news", [site.competition()])),
    ("competition announcements", Facts, |site| words("", [site.competition()])),
    ("competition list-codes", Facts, |site| words("", [site.invitation()])),
    ("competition revoke-codes", Facts, |site| words("", [site.invitation(), "team".to_owned()])),
    ("competition exclude", Facts, |site| words("--name bot-*", [site.entrant().0])),
    ("competition rename", Facts, |site| words("--name other", site.entrant().into())),
    ("competition erase", Facts, |site| words("", site.entrant().into())),
    ("competition replace-key", Facts, |site| words("", site.entrant_without_key().into())),
    ("competition describe", Facts, |site| words("--contact a@b.c", site.entrant().into())),
    ("competition practice", Facts, |site| words("--seed 7", [site.entrant().0])),
    ("competition members", Facts, |site| words("", site.entrant().into())),
    ("competition add-member", Facts, |site| {
        words("--name Ada", site.entrant_without_key().into())
    }),
    ("competition remove-member", Facts, |site| words("", site.member())),
    ("competition board", Facts, |site| words("", [site.entrant().0])),
    ("competition export", Other("is JSON Lines"), |site| words("", [site.competition()])),
    ("audit", List, |_| Vec::new()),
    ("clock confirm", Facts, |_| Vec::new()),
    ("play", Facts, |_| words("--task foraging --seed 1 --max-round 2", [])),
    ("play", Facts, |_| words("--suite quick", [])),
    ("mcp", Other("speaks with an assistant"), |_| Vec::new()),
    ("eval", Facts, |_| words("--player default --task foraging --max-round 2 --again", [])),
    ("eval", Facts, |_| words("--player default --dry-run", [])),
    ("verify", Facts, |_| words("", [journal()])),
    ("verify", Facts, |site| words("--db", [site.copy()])),
    ("verify", Facts, |site| words("--competition", [site.closed_competition()])),
    ("leaderboard", Facts, |_| Vec::new()),
    ("leaderboard", Facts, |site| words("--db", [site.copy()])),
    ("cross-play", Facts, |_| Vec::new()),
    ("table", Facts, |site| words("--by task --where max_round=30 --db", [site.copy()])),
    ("board rebuild", Facts, |site| words("--db", [site.copy()])),
    ("metrics", Facts, |_| words("", [journal()])),
    ("worth", Facts, |_| words("", [journal()])),
    ("backup", Facts, |site| words("--db", [site.db(), site.new_file("backup.db")])),
    ("migrate", Facts, |site| {
        words("--from", [site.copy(), "--to".to_owned(), site.new_file("moved.db")])
    }),
    ("export", Facts, |site| words("--db", [site.db(), site.new_file("games")])),
    ("replay", Other("writes a film or a picture"), |site| {
        words("--round 1 --png", [site.new_file("moment.png"), journal()])
    }),
    ("replay", Other("writes a picture"), |site| {
        words("--moments 0,2 --picture", [site.new_file("moments.svg"), journal()])
    }),
    ("import", Facts, |site| words("--db", [site.new_file("imports.db"), site.exported()])),
    ("openapi", Other("is JSON"), |_| Vec::new()),
    ("healthcheck", Facts, |_| Vec::new()),
];

/// Commands that write what is for programs alone.
const FOR_PROGRAMS: [(&str, Arguments); 2] =
    [("completions", |_| words("bash", [])), ("man", |site| words("", [site.new_file("man")]))];

fn words<const N: usize>(first: &str, more: [String; N]) -> Vec<String> {
    first.split_whitespace().map(str::to_owned).chain(more).collect()
}

fn string(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("{value} is not a text")).to_owned()
}

/// A recorded game.
fn journal() -> String {
    concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/1/pursuit-paper.jsonl").to_owned()
}

/// A server with some games, and files for commands.
struct Site {
    folder: TempDir,
    organizer: String,
    server: Serving,
    files: Cell<usize>,
    exported: OnceCell<String>,
    copied: OnceCell<String>,
    runtime: tokio::runtime::Runtime,
    client: reqwest::Client,
}

impl Site {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let db = folder.path().join("site.db");
        let created = super::swarmbench(&[
            "key",
            "create",
            "--name",
            "alice",
            "--role",
            "organizer",
            "--db",
            &path(&db),
            "--json",
        ]);
        let created: Value = serde_json::from_slice(&created.stdout).expect("JSON");
        let organizer = string(&created["secret"]);
        let server = Serving::start(&db, &[]);
        let site = Self {
            folder,
            organizer,
            server,
            files: Cell::new(0),
            exported: OnceCell::new(),
            copied: OnceCell::new(),
            runtime: tokio::runtime::Runtime::new().expect("a runtime"),
            client: reqwest::Client::new(),
        };
        let games =
            "eval --player default --task foraging,synchronization --seeds 0..3 --max-round 30";
        site.json(&words(games, []));
        site
    }

    fn base(&self) -> String {
        self.server.base.clone()
    }

    fn db(&self) -> String {
        path(&self.folder.path().join("site.db"))
    }

    /// A path at which nothing is.
    fn new_file(&self, name: &str) -> String {
        self.files.set(self.files.get() + 1);
        path(&self.folder.path().join(format!("{}-{name}", self.files.get())))
    }

    fn command(&self, args: &[String]) -> Command {
        let mut command = Command::new(swarmbench_testkit::program::program());
        command.args(args).stdin(Stdio::null());
        command.env("SWARMBENCH_SERVER", &self.server.base);
        command.env("SWARMBENCH_KEY", &self.organizer);
        command
    }

    /// Output of a command with `--json`.
    fn json(&self, args: &[String]) -> Value {
        let output = self.command(&[args, &["--json".to_owned()]].concat()).output();
        let output = output.expect("the binary runs");
        assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
        serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{args:?}: {error}: {}", text(&output.stdout)))
    }

    /// Answer of the server to a request, by which a command finds something to work on sooner than by another
    /// command.
    fn post(&self, path: &str, is_organizer: bool, body: &Value) -> Value {
        let mut call = self.client.post(format!("{}/api/v1/{path}", self.base())).json(body);
        if is_organizer {
            call = call.bearer_auth(&self.organizer);
        }
        self.runtime.block_on(async {
            let answer = call.send().await.expect("an answer");
            let (status, body) = (answer.status(), answer.text().await.expect("a text"));
            assert!(status.is_success(), "{path}: {status} {body}");
            serde_json::from_str(&body).expect("JSON")
        })
    }

    /// A database that no server uses.
    fn copy(&self) -> String {
        let copied = self.copied.get_or_init(|| {
            let copied = self.new_file("copied.db");
            self.json(&words("backup --db", [self.db(), copied.clone()]));
            copied
        });
        let copy = self.new_file("copy.db");
        std::fs::copy(copied, &copy).expect("a copy");
        copy
    }

    /// Games as files, exported once: commands only read them.
    fn exported(&self) -> String {
        let export = || {
            let folder = self.new_file("exported");
            self.json(&words("export --db", [self.db(), folder.clone()]));
            folder
        };
        self.exported.get_or_init(export).clone()
    }

    fn definition(&self) -> String {
        let file = self.new_file("cup.toml");
        let definition = "name = \"a cup\"\nopens_at = 2026-01-01T00:00:00Z\n\
            closes_at = 2100-01-01T00:00:00Z\n[suite]\ntasks = [\"foraging\"]\nseeds = 2\n\
            [clocks]\nround_deadline_s = 60\n";
        std::fs::write(&file, definition).expect("a file");
        file
    }

    fn competition(&self) -> String {
        let definition = json!({
            "name": "a cup", "opens_at": "2026-01-01T00:00:00Z", "closes_at": "2100-01-01T00:00:00Z",
            "suite": { "tasks": ["Foraging"], "seeds": 2 }, "clocks": { "round_deadline_s": 60 },
        });
        string(&self.post("competitions", true, &definition)["id"])
    }

    /// A competition and an entrant of it.
    fn entrant(&self) -> (String, String) {
        self.entered(true)
    }

    /// A competition and an entrant of it for which a key was made.
    fn entrant_without_key(&self) -> (String, String) {
        self.entered(false)
    }

    fn entered(&self, has_key: bool) -> (String, String) {
        let competition = self.competition();
        let path = format!("competitions/{competition}/entrants");
        let entered = self.post(&path, has_key, &json!({ "name": "newcomer", "model": "m" }));
        (competition, string(&entered["id"]))
    }

    /// A competition, an entrant of it, and a member of its team.
    fn member(&self) -> [String; 3] {
        let (competition, entrant) = self.entrant_without_key();
        let path = format!("competitions/{competition}/entrants/{entrant}/members");
        let member = string(&self.post(&path, true, &json!({ "name": "Ada" }))["id"]);
        [competition, entrant, member]
    }

    /// A competition with an invitation code for `team`.
    fn invitation(&self) -> String {
        let competition = self.competition();
        let path = format!("competitions/{competition}/codes");
        self.post(&path, true, &json!({ "labels": ["team"] }));
        competition
    }

    /// A competition and the run of an attempt in it.
    fn attempt(&self) -> (String, String) {
        let (competition, entrant) = self.entrant();
        let path = format!("competitions/{competition}/attempts");
        let started = self.post(&path, true, &json!({ "entrant": entrant }));
        (competition, string(&started["run"]))
    }

    fn closed_competition(&self) -> String {
        let file = self.new_file("cup.jsonl");
        std::fs::write(&file, empty_competition()).expect("a file");
        file
    }
}

fn path(path: &std::path::Path) -> String {
    path.display().to_string()
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

#[test]
fn every_command_shows_its_facts_as_json_and_bears_closed_pipes() {
    let site = Site::new();
    for command in commands() {
        let mut found = false;
        for (_, shows, args) in CASES.iter().filter(|(words, ..)| *words == command) {
            found = true;
            check(&site, &command, *shows, *args);
        }
        for (_, args) in FOR_PROGRAMS.iter().filter(|(words, _)| *words == command) {
            found = true;
            check(&site, &command, Other("is for programs"), *args);
        }
        assert!(found, "`swarmbench {command}` has no case in this test");
    }
}

fn check(site: &Site, command: &str, shows: Shows, args: Arguments) {
    let run = |stdout: Stdio, stderr: Stdio, option: &str| -> Output {
        let args = [words(command, []), args(site), words(option, [])].concat();
        let child = site.command(&args).stdout(stdout).stderr(stderr).spawn();
        child.and_then(std::process::Child::wait_with_output).expect("the binary runs")
    };
    let whole =
        run(Stdio::piped(), Stdio::piped(), if matches!(shows, Other(_)) { "" } else { "--json" });
    let (shown, said) = (text(&whole.stdout), text(&whole.stderr));
    let is_json = |text: &str| serde_json::from_str::<Value>(text).is_ok();
    match shows {
        Facts => assert!(is_json(&shown), "{command}: {shown}{said}"),
        List => {
            assert!(shown.lines().count() > 0, "{command}: {said}");
            assert!(shown.lines().all(is_json), "{command}: {shown}");
        }
        Other(_) => {}
    }
    if !matches!(shows, Other(_)) {
        assert!(whole.status.success(), "{command}: {said}");
        let help = site.command(&words(command, ["--help".to_owned()])).output();
        let help = text(&help.expect("the binary runs").stdout);
        assert!(help.contains("--json"), "{command}: {help}");
    }
    // As text, to a reader that has gone.
    let cut = run(closed(), Stdio::piped(), "");
    let said = text(&cut.stderr);
    assert!(!said.contains("panicked"), "{command}: {said}");
    assert_eq!(cut.status.code(), whole.status.code(), "{command}: {said}");
    let silent = run(Stdio::piped(), closed(), "");
    assert_eq!(silent.status.code(), whole.status.code(), "{command}: {}", text(&silent.stdout));
}

#[test]
fn a_server_whose_log_nobody_reads_serves() {
    let folder = tempfile::tempdir().expect("a folder");
    let db: PathBuf = folder.path().join("silent.db");
    let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = free.expect("a port").to_string();
    let mut process = Command::new(swarmbench_testkit::program::program())
        .args(["serve", "--addr", &address, "--db", &path(&db)])
        .env("RUST_LOG", "trace")
        .stdin(Stdio::null())
        .stderr(closed())
        .spawn()
        .expect("the binary runs");
    let server = format!("http://{address}");
    let answered = || {
        let asked = super::swarmbench(&["healthcheck", "--server", &server]);
        asked.status.success()
    };
    let mut left = 100;
    while !answered() {
        left -= 1;
        assert!(left > 0, "it does not answer");
        assert!(process.try_wait().expect("a process").is_none(), "it ended");
    }
    // Every request is logged, or would be.
    assert!((0..3).all(|_| answered()));
    process.kill().and_then(|()| process.wait()).expect("it ends");
}

#[test]
fn what_cannot_be_written_is_an_error() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("Linux has one");
    let output = Command::new(swarmbench_testkit::program::program())
        .arg("openapi")
        .stdout(full)
        .output()
        .expect("the binary runs");
    assert!(!output.status.success());
    assert!(text(&output.stderr).contains("No space left"), "{}", text(&output.stderr));
}
