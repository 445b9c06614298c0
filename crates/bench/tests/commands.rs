//! The program as its users run it, on servers in this process and on the server's program.

use std::process::{Command, Output, Stdio};

use serde_json::Value;
use swarmbench::server::{Parts, Server};
use tokio::net::TcpListener;
use tokio::sync::oneshot;

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_swarmbench-bench"));
    command.args(args).stdin(Stdio::null());
    command
}

fn bench(args: &[&str]) -> Output {
    command(args).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Output of a command.
fn json(args: &[&str]) -> Value {
    successful(args, &bench(args))
}

/// Output of the server's program with `--json`.
fn of_server(args: &[&str]) -> Value {
    let output = swarmbench_testkit::program::command(args).output().expect("the binary runs");
    successful(args, &output)
}

fn successful(args: &[&str], output: &Output) -> Value {
    assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
    report(output)
}

/// Runs the command on a server of its own.
fn on_a_server(args: &[&str]) -> Output {
    let folder = tempfile::tempdir().expect("a folder");
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let db = folder.path().join("test.db");
    let server = runtime.block_on(Server::open(&db, Parts::default())).expect("a server");
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).expect("a port");
    let base = format!("http://{}", listener.local_addr().expect("an address"));
    let (stop, stopped) = oneshot::channel::<()>();
    let serving = runtime.spawn(server.run(listener, async { drop(stopped.await) }));
    let dir = folder.path().display().to_string();
    let output = bench(&[args, &["--server", &base, "--dir", &dir]].concat());
    drop(stop);
    runtime.block_on(serving).expect("it ran").expect("it stopped in good order");
    output
}

fn report(output: &Output) -> Value {
    let shown = text(&output.stdout);
    serde_json::from_str(&shown).unwrap_or_else(|_| panic!("{shown} {}", text(&output.stderr)))
}

#[test]
fn a_load_test_measures_everything() {
    let small = [
        "loadtest",
        "all",
        "--turn",
        "0.05",
        "--turns",
        "2",
        "--connections",
        "3",
        "--writers",
        "2",
        "--episodes",
        "1,13",
        "--rounds",
        "2",
        "--connections-max",
        "150",
        "--polls",
        "8",
        "--seats",
        "4",
    ];
    let output = on_a_server(&small);
    let report = report(&output);
    assert!(output.status.success(), "{report}");
    let number = |path: &str| {
        let found = report.pointer(path).unwrap_or_else(|| panic!("{path} is missing in {report}"));
        found.as_f64().unwrap_or_else(|| panic!("{path} is {found}"))
    };
    for path in [
        "/obs/ratio",
        "/obs/server/per_s",
        "/obs/bare/per_s",
        "/acts/0/ratio",
        "/acts/1/ratio",
        "/polls/memory_held_bytes",
    ] {
        assert!(number(path) > 0.0, "{path} in {report}");
    }
    // One act and one round at least are in a commit that resolves one.
    assert!(number("/acts/0/entries_per_commit") >= 1.0, "{report}");
    for (path, value) in [
        ("/obs/answers/errors", 0.0),
        ("/play/0/ended", 1.0),
        ("/play/0/acknowledged/count", 24.0),
        // Too few connections for a seat each.
        ("/play/1/acknowledged/count", 26.0),
        ("/play/1/ended", 13.0),
        ("/play/1/answers/errors", 0.0),
        ("/polls/polls", 8.0),
        ("/polls/counted", 8.0),
        ("/polls/one_by_one/count", 8.0),
        ("/polls/all_at_once/count", 8.0),
    ] {
        assert!((number(path) - value).abs() < 1e-9, "{path} is not {value} in {report}");
    }
}

#[test]
fn a_load_test_that_meets_errors_fails_and_shows_them() {
    let args = ["loadtest", "play", "--episodes", "2", "--key", "nobody"];
    let output = on_a_server(&args);
    assert!(!output.status.success());
    assert!(
        text(&output.stderr).contains("2 episodes were not played"),
        "{}",
        text(&output.stderr)
    );
    let report = report(&output);
    let answers = &report["play"][0]["answers"];
    assert_eq!(answers["errors"], 2, "{report}");
    assert!(answers["samples"][0].as_str().is_some_and(|text| text.contains("401")), "{report}");
}

#[test]
fn a_filled_database_is_sound_and_can_be_measured() {
    let folder = tempfile::tempdir().expect("a folder");
    let db = folder.path().join("filled.db").display().to_string();
    let args = [
        "capacity",
        "fill",
        "--episodes",
        "300",
        "--entrants",
        "3",
        "--attempts",
        "40",
        "--db",
        &db,
    ];
    let filled = json(&args);
    let episodes = filled["episodes"].as_u64().expect("a number");
    assert!(episodes >= 540, "{filled}");
    let again = bench(&args);
    assert!(!again.status.success() && text(&again.stderr).contains("exists"));

    let checked = of_server(&["verify", "--db", &db, "--json"]);
    assert_eq!(checked["episodes"].as_u64(), Some(episodes));
    assert_eq!(checked["sound"], true, "{checked}");

    let dir = folder.path().display().to_string();
    let measured = json(&["capacity", "measure", "--db", &db, "--dir", &dir, "--reads", "8"]);
    let cup = &measured["competition"];
    assert_eq!(cup["games"], 200, "{measured}");
    assert!(cup["rounds"].as_u64().is_some_and(|rounds| rounds > 200), "{measured}");
    // All that follows from journals is as the fill has written it.
    assert_eq!(measured["rebuild"]["changed"], 0, "{measured}");
    let reads = &measured["reads"];
    assert_eq!(reads["answers"]["errors"], 0, "{measured}");
    let named = |read: &str| {
        let mut lines = reads["lines"].as_array().expect("lines").iter();
        lines.any(|line| line["read"] == read && line["latency"]["count"] == 8)
    };
    for read in ["leaderboard", "an episode", "its scores", "its board", "50 rows of its board"] {
        assert!(named(read), "{read}: {measured}");
    }
    assert!(!folder.path().join("capacity").exists());

    // The pages of the competition that is open, while its games end.
    let args =
        ["capacity", "measure", "--db", &db, "--ends", "20", "--reading", "2", "--dir", &dir];
    let measured = json(&args);
    let read = &measured["while_games_end"];
    for answers in ["reads", "plays"] {
        assert_eq!(read[answers]["errors"], 0, "{read}");
    }
    assert!(read["ended"].as_u64().is_some_and(|ended| ended > 0), "{read}");
    let lines = read["lines"].as_array().expect("lines");
    assert!(lines.len() > 25 && lines.iter().all(|line| line["latency"]["count"] != 0), "{read}");
    let games = measured["competition"]["games"].as_u64().expect("a number");
    assert!(games >= 240, "{measured}");
    let left = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert!(left <= 4, "the database and its companions, and nothing else");
}

#[test]
fn errors_say_what_to_do_next() {
    for (args, expected) in [
        (&["loadtest", "--server", "http://127.0.0.1:1"][..], "does a server run there?"),
        (&["loadtest", "--server", "https://localhost"], "http://127.0.0.1:8080"),
        (&["capacity", "measure", "--db", "no.db"], "`swarmbench-bench capacity fill` makes one"),
        (&["capacity", "measure", "--db", "Cargo.toml", "--program", "none"], "cargo build"),
        (&["instructions", "--spread", "1"], "1 is not in 2..=65535"),
    ] {
        let output = bench(args);
        let said = text(&output.stderr);
        assert!(!output.status.success(), "{args:?}");
        assert!(said.contains(expected), "{args:?} said {said}");
    }
}

#[test]
fn commands_bear_a_closed_pipe() {
    let folder = tempfile::tempdir().expect("a folder");
    let db = |name: &str| folder.path().join(name).display().to_string();
    let closed = || {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        Stdio::from(writer)
    };
    for (name, stdout, stderr) in
        [("out.db", closed(), Stdio::piped()), ("error.db", Stdio::piped(), closed())]
    {
        let mut fill = command(&["capacity", "fill", "--episodes", "100", "--db", &db(name)]);
        let child = fill.stdout(stdout).stderr(stderr).spawn();
        let output = child.and_then(std::process::Child::wait_with_output);
        let output = output.expect("the binary runs");
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
}
