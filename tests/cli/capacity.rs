//! Large databases, in small.

use serde_json::Value;

use super::{swarmbench, text};

fn json(args: &[&str]) -> Value {
    let output = swarmbench(args);
    assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
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
        "--unfinished",
        "5",
        "--entrants",
        "3",
        "--attempts",
        "40",
        "--db",
        &db,
        "--json",
    ];
    let filled = json(&args);
    let episodes = filled["episodes"].as_u64().expect("a number");
    assert!(episodes >= 545, "{filled}");
    let again = swarmbench(&args);
    assert!(!again.status.success() && text(&again.stderr).contains("exists"));

    let checked = json(&["verify", "--db", &db, "--json"]);
    assert_eq!(checked["episodes"].as_u64(), Some(episodes));
    assert_eq!(checked["sound"], true, "{checked}");

    let dir = folder.path().display().to_string();
    let measured =
        json(&["capacity", "measure", "--db", &db, "--dir", &dir, "--reads", "8", "--json"]);
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
    let measured = json(&[&args[..], &["--json"]].concat());
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
