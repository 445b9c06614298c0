//! The command line, run as its user runs it.

use std::process::{Command, Output, Stdio};

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
    for command in ["demo", "serve", "play", "verify", "backup", "openapi", "healthcheck"] {
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
