//! The command line, run as its user runs it.

use std::process::{Command, Output, Stdio};

use serde_json::Value;
use swarmbench::server::{Parts, Server};
use tokio::net::TcpListener;
use tokio::sync::oneshot;

fn swarmbench(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_swarmbench"))
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
fn errors_say_what_to_do_next() {
    for (args, expected) in [
        (&["play", "--task", "Chess"][..], "the tasks are Transport, Pursuit"),
        (&["play", "--task", "Transport", "--player", "nobody"], "push-and-leave"),
        (
            &["play", "--task", "Transport", "--server", "http://127.0.0.1:1"],
            "`swarmbench serve` starts one",
        ),
        (&["loadtest", "--server", "http://127.0.0.1:1"], "does a server run there?"),
        (&["loadtest", "--server", "https://localhost"], "http://127.0.0.1:8080"),
        (&["serve", "--addr", "0.0.0.0:0", "--db", "never.db"], "--open"),
        (&["verify", "no-such-file.jsonl"], "no-such-file.jsonl"),
        (&["verify", "Cargo.toml"], "line 1: not a line of a journal"),
        (&["verify", "-", "--head", "12"], "64 hexadecimal digits"),
    ] {
        let output = swarmbench(args);
        let said = text(&output.stderr);
        assert!(!output.status.success(), "{args:?}");
        assert!(said.contains(expected), "{args:?} said {said}");
    }
}

#[test]
fn help_teaches() {
    let shown = text(&swarmbench(&["--help"]).stdout);
    for command in ["demo", "serve", "play", "verify", "loadtest", "openapi", "healthcheck"] {
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
    let output = swarmbench(&[args, &["--server", &base, "--dir", &dir]].concat());
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
        "--json",
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
        "--slow-connections",
        "16",
        "--slow-time",
        "0.2",
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
        "/slow/during/looked/count",
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
        ("/slow/kept/0/clients", 8.0),
        ("/slow/kept/3/clients", 2.0),
    ] {
        assert!((number(path) - value).abs() < 1e-9, "{path} is not {value} in {report}");
    }
}

#[test]
fn a_load_test_that_meets_errors_fails_and_shows_them() {
    let args = ["loadtest", "play", "--json", "--episodes", "2", "--key", "nobody"];
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
