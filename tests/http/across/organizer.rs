//! The guides of organizers, entrants and judges, done as they are written: all their commands, in their order, at their times.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::app::{DOCUMENT, TestApp, list};
use crate::cup::Attempt;

/// A step of the guide.
enum Step {
    /// The clock is set to this time.
    Time(jiff::Timestamp),
    /// These attempts, by the variables that hold their tokens, are played for a while.
    Play(Vec<String>),
    /// The competition has been closed.
    Closed,
    /// Commands for a shell.
    Commands(String),
}

/// The steps of the guide: its commands, and what is noted between them.
fn steps(guide: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut lines = guide.lines();
    while let Some(line) = lines.next() {
        if line == "```sh" {
            let mut commands = String::new();
            for line in lines.by_ref().take_while(|line| *line != "```") {
                writeln!(commands, "{line}").expect("a string takes everything");
            }
            steps.push(Step::Commands(commands));
            continue;
        }
        let note = line.strip_prefix("<!-- ").and_then(|line| line.strip_suffix(" -->"));
        match note.map(|note| note.split_once(": ").unwrap_or((note, ""))) {
            Some(("time", at)) => steps.push(Step::Time(at.parse().expect("a time"))),
            Some(("play", names)) => {
                steps.push(Step::Play(names.split(' ').map(str::to_owned).collect()));
            }
            Some(("closed", _)) => steps.push(Step::Closed),
            Some((other, _)) => panic!("{other} is no step"),
            None => {}
        }
    }
    steps
}

/// A shell that remembers its variables and functions from one block of commands to the next.
struct Shell {
    folder: tempfile::TempDir,
    server: String,
    /// Nothing for those who have no key yet.
    key: Option<String>,
}

impl Shell {
    fn new(app: &TestApp, key: Option<String>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        Self { folder, server: app.base().to_owned(), key }
    }

    /// Runs commands as they stand in the guide; returns what they say.
    async fn run(&self, commands: &str) -> String {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let state = self.folder.path().join("state");
        let state = state.display();
        // Set by the script: with another PATH in its environment the process would be forked, pages and all.
        let program = swarmbench_testkit::program::program();
        let programs = program.parent().expect("a folder").display();
        let script = format!(
            "set -euo pipefail\nPATH='{programs}':$PATH\n[ -e '{state}' ] && source '{state}'\nset -x\n{commands}\nset +x\n\
             {{ declare -p | grep -E '^declare -- [A-Z]' ; declare -f; }} > '{state}'\n"
        );
        let examples = self.folder.path().join("examples");
        if !examples.exists() {
            std::os::unix::fs::symlink(root.join("examples"), examples).expect("a link");
        }
        let mut shell = Command::new("bash");
        shell.arg("-c").arg(script).current_dir(self.folder.path());
        shell.env("SWARMBENCH_SERVER", &self.server).env_remove("SWARMBENCH_KEY");
        shell.envs(self.key.as_ref().map(|key| ("SWARMBENCH_KEY", key)));
        shell.stdin(Stdio::null());
        // The server continues meanwhile.
        let output = tokio::task::spawn_blocking(move || shell.output()).await;
        let output = output.expect("no panic").expect("there is a bash");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let said = text(&output.stdout) + &text(&output.stderr);
        assert!(output.status.success(), "{commands}\n{said}");
        said
    }

    async fn variable(&self, name: &str) -> String {
        let said = self.run(&format!("echo \"value: ${name}\"")).await;
        let value = said.lines().find_map(|line| line.strip_prefix("value: "));
        value.expect("a value").to_owned()
    }

    /// Does everything that a guide says; returns what its commands say, and how many blocks of them there are.
    async fn follow(&self, guide: &str, app: &TestApp) -> (String, usize) {
        let mut said = String::new();
        let mut blocks = 0;
        for step in steps(guide) {
            match step {
                Step::Time(at) => {
                    app.pass(Duration::try_from(at.duration_since(app.now())).expect("not back"));
                }
                Step::Commands(commands) => {
                    said += &self.run(&commands).await;
                    blocks += 1;
                }
                Step::Play(names) => {
                    for name in names {
                        let swarm = self.variable(&name).await;
                        let attempt = Attempt { run: String::new(), swarm, number: 1 };
                        for _ in 0..3 {
                            attempt.act(app, 4).await;
                        }
                    }
                }
                Step::Closed => {
                    let id = self.variable("CUP").await;
                    let path = format!("/api/v1/competitions/{id}");
                    for _ in 0..10_000 {
                        if app.get(&path).ok().await["phase"] == "closed" {
                            break;
                        }
                        app.pass(Duration::from_secs(1));
                    }
                }
            }
        }
        (said, blocks)
    }
}

/// Preparation for other readers of the guides: a competition, and a code for it.
async fn prepared(app: &TestApp) -> Shell {
    let organizer = Shell::new(app, Some(app.organizer.clone()));
    organizer
        .run(
            "CUP=$(swarmbench competition create examples/competition.toml)\n\
             CODE=$(swarmbench competition codes \"$CUP\" 'team blue' | grep -o 'invite_[a-z0-9]*')\n\
             JUDGE=$(swarmbench key create --name jury --role judge --server \"$SWARMBENCH_SERVER\")",
        )
        .await;
    organizer
}

/// A shell that knows some variables of the organizer's.
async fn with(organizer: &Shell, app: &TestApp, key: Option<String>, names: &[&str]) -> Shell {
    let shell = Shell::new(app, key);
    for name in names {
        let value = organizer.variable(name).await;
        shell.run(&format!("{name}='{value}'")).await;
    }
    shell
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guide_of_entrants_is_done_as_it_is_written() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let organizer = prepared(&app).await;
    let entrant = with(&organizer, &app, None, &["CUP", "CODE"]).await;
    let guide = include_str!("../../../docs/organise/entrant.md");
    let (said, blocks) = entrant.follow(guide, &app).await;
    assert_eq!(blocks, 8);
    assert!(said.contains("verified: the seeds are those of the published commitment"), "{said}");
    assert!(said.contains("blue whales"), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guide_of_judges_is_done_as_it_is_written() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let organizer = prepared(&app).await;
    let entrants = include_str!("../../../docs/organise/entrant.md");
    let (played, _) = entrants.split_once("## 4").expect("a part after the attempt");
    let entrant = with(&organizer, &app, None, &["CUP", "CODE"]).await;
    entrant.follow(played, &app).await;
    let key = organizer.variable("JUDGE").await;
    let judge = with(&organizer, &app, Some(key), &["CUP"]).await;
    let guide = include_str!("../../../docs/organise/judge.md");
    let (said, blocks) = judge.follow(guide, &app).await;
    assert_eq!(blocks, 4);
    assert!(said.contains("refused, as it should be"), "{said}");
    assert!(said.contains("judges read"), "the refusal names the rule: {said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guide_is_done_as_it_is_written() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let shell = Shell::new(&app, Some(app.organizer.clone()));
    let guide = include_str!("../../../docs/organise/organizer.md");
    let (said, blocks) = shell.follow(guide, &app).await;
    assert!(blocks > 10, "{blocks} blocks of commands");
    let cup = shell.variable("CUP").await;
    let shown = app.get(&format!("/api/v1/competitions/{cup}")).ok().await;
    let commitment = shell.variable("COMMITMENT").await;
    assert_eq!((&shown["phase"], &shown["commitment"]), (&json!("closed"), &json!(commitment)));
    assert!(said.contains("verified: the seeds are those of the published commitment"), "{said}");
    assert!(said.contains("the board follows from the scores"), "{said}");
    for expected in ["two entrants of one team", "the disk was full", "not vouched for", "declared"]
    {
        assert!(said.contains(expected), "{expected} is missing in {said}");
    }
    let board = app.get(&format!("/api/v1/competitions/{cup}/board")).ok().await;
    let row = |row: &Value| (row["rank"].as_u64(), row["entrant"]["name"].clone());
    let mut rows: Vec<_> = list(&board["items"]).iter().map(row).collect();
    assert_eq!(rows.pop(), Some((None, json!("green"))));
    assert_eq!(rows.len(), 2);
    let csv = std::fs::read_to_string(shell.folder.path().join("board.csv")).expect("a file");
    assert_eq!(csv.lines().count(), 4);
}

const EXAMPLE: &str = include_str!("../../../examples/competition.toml");

/// The example is a competition that the server takes, with every field that there is.
#[tokio::test]
async fn the_example_has_every_field() {
    let fields = &DOCUMENT["components"]["schemas"]["CompetitionRequest"]["properties"];
    for field in fields.as_object().expect("a schema").keys() {
        let named = [format!("{field} ="), format!("[{field}]"), format!("[[{field}]]")];
        assert!(named.iter().any(|named| EXAMPLE.contains(named)), "{field} is missing");
    }
}

/// The field that a line of the example gives as a comment.
fn commented(line: &str) -> Option<&str> {
    let (name, _) = line.strip_prefix("# ")?.split_once(" = ")?;
    name.chars().all(|letter| letter.is_ascii_lowercase() || letter == '_').then_some(name)
}

#[tokio::test]
async fn each_commented_field_of_the_example_can_be_uncommented_where_it_stands() {
    let app = crate::cup::server().await;
    let shell = Shell::new(&app, Some(app.organizer.clone()));
    let fields: Vec<&str> = EXAMPLE.lines().filter_map(commented).collect();
    for field in ["attempts_per_day", "terms", "public_seeds", "memory", "max_delay"] {
        assert!(fields.contains(&field), "{field} is no comment: {fields:?}");
    }
    let with = |is: &dyn Fn(&str) -> bool| {
        let uncommented = |line: &'static str| match commented(line) {
            Some(field) if is(field) => &line["# ".len()..],
            _ => line,
        };
        EXAMPLE.lines().map(uncommented).collect::<Vec<_>>().join("\n")
    };
    let alone = fields.iter().map(|field| with(&|other| other == *field));
    for definition in alone.chain([with(&|_| true)]) {
        let file = shell.folder.path().join("cup.toml");
        std::fs::write(file, definition).expect("a file");
        shell.run("swarmbench competition create cup.toml").await;
    }
}

#[tokio::test]
async fn who_creates_a_competition_is_told_where_entrants_enter_and_that_it_is_open_already() {
    let app = crate::cup::server().await;
    let shell = Shell::new(&app, Some(app.organizer.clone()));
    let said = shell.run("CUP=$(swarmbench competition create examples/competition.toml)").await;
    let id = shell.variable("CUP").await;
    assert!(said.contains("opens at 2027-03-01T12:00:00.000Z, and closes at"), "{said}");
    assert!(said.contains(&format!("on the page /competitions/{id} of this server")), "{said}");
    assert!(said.contains(&format!("{}/ is good on this machine alone", app.base())), "{said}");
    let past = EXAMPLE.replacen("opens_at = 2027-", "opens_at = 2025-", 1);
    std::fs::write(shell.folder.path().join("past.toml"), past).expect("a file");
    let said = shell.run("swarmbench competition create past.toml").await;
    assert!(said.contains("is open already, as its opens_at, 2025-03-01T12:00:00.000Z,"), "{said}");
}

#[tokio::test]
async fn terms_are_given_as_a_text_or_in_a_file() {
    let app = crate::cup::server().await;
    let shell = prepared(&app).await;
    let change = "swarmbench competition change \"$CUP\"";
    let said = shell.run(&format!("{change} --terms-text 'Be fair: <b>all</b>.'")).await;
    assert!(said.contains("version 1") && said.contains("Be fair: <b>all</b>."), "{said}");
    let said =
        shell.run(&format!("echo 'Be quick.' > terms.txt\n{change} --terms terms.txt")).await;
    assert!(said.contains("version 2") && said.contains("Be quick."), "{said}");
    let said = shell.run(&format!("{change} --terms 'Be fair.' && exit 9 || true")).await;
    assert!(said.contains("--terms takes a file, --terms-text a text; Be fair."), "{said}");
}
