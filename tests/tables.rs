//! Tables as their users make them: the real program, on exports written by hand.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::{Map, Value, json};
use tempfile::TempDir;

/// An export of these games.
struct Export {
    folder: TempDir,
    games: Vec<Value>,
}

/// A game that finished, with what differs from the usual.
fn game(task: &str, model: &str, seed: u64, score: f64, other: &Value) -> Value {
    let mut row = json!({
        "episode": "", "task": task, "model": model, "seed": seed, "rules": "paper",
        "control": "decentralized", "mixed": false, "num_agents": 12, "width": 10, "height": 10,
        "view_size": 5, "memory": 5, "max_round": 100, "noise": 0.0, "max_delay": 0,
        "agent_meta": "{}", "prompt_template": null, "status": "finished", "score": score,
        "void_reason": null,
    });
    let other = other.as_object().cloned().unwrap_or_default();
    row.as_object_mut().expect("an object").extend(other);
    row
}

impl Export {
    fn of(games: Vec<Value>) -> Self {
        Self { folder: tempfile::tempdir().expect("a folder"), games }
    }

    fn write(&self) -> PathBuf {
        let mut lines = String::new();
        for (number, game) in self.games.iter().enumerate() {
            let mut game: Map<String, Value> = game.as_object().expect("an object").clone();
            game.insert("episode".to_owned(), format!("ep_{number}").into());
            lines += &Value::Object(game).to_string();
            lines.push('\n');
        }
        fs::write(self.folder.path().join("episodes.jsonl"), lines).expect("written");
        self.folder.path().to_owned()
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(swarmbench_testkit::program::program())
            .args(args)
            .arg("--from")
            .arg(self.write())
            .env_remove("SWARMBENCH_SERVER")
            .stdin(Stdio::null())
            .output()
            .expect("the binary runs")
    }

    /// Output of a command, which has to succeed.
    #[track_caller]
    fn shown(&self, args: &[&str]) -> String {
        let output = self.run(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// The error of a command, which has to fail and to write nothing else.
    #[track_caller]
    fn refused(&self, args: &[&str]) -> String {
        let output = self.run(args);
        assert!(!output.status.success() && output.stdout.is_empty(), "{args:?}: {output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    }
}

/// Scores of one model in one task.
fn games(task: &str, model: &str, scores: &[f64], other: &Value) -> Vec<Value> {
    let seeds = 27..;
    seeds.zip(scores).map(|(seed, &score)| game(task, model, seed, score, other)).collect()
}

#[test]
fn the_main_table_has_n_in_each_cell_and_says_which_games_count() {
    let mut export = Export::of(games("Pursuit", "a", &[9.0, 10.0, 10.0, 10.0, 9.0], &json!({})));
    export.games.extend(games("Foraging", "a", &[1.0, 2.0], &json!({})));
    export.games.extend(games("Pursuit", "b", &[12.0; 5], &json!({})));
    export.games.extend(games("Foraging", "b", &[3.0; 4], &json!({})));
    export.games.push(game("Pursuit", "b", 99, 50.0, &json!({ "status": "aborted" })));
    export.games.push(game("Pursuit", "b", 98, 50.0, &json!({ "void_reason": "host" })));

    let csv = export.shown(&["table", "main", "--format", "csv"]);
    assert_eq!(
        csv.lines().collect::<Vec<_>>(),
        [
            "model,Pursuit_mean,Pursuit_deviation,Pursuit_n,Foraging_mean,Foraging_deviation,\
             Foraging_n,total",
            "b,12,0,5,3,0,4,15",
            "a,9.6,0.4898979485566356,5,1.5,0.5,2,11.1",
        ]
    );
    let table = export.shown(&["table", "main"]);
    for expected in ["9.60 ± 0.49 (5)", "1.50 ± 0.50 (2)", "1 aborted, 1 voided", "view_size 5"] {
        assert!(table.contains(expected), "{expected} is missing in {table}");
    }
    // Parts of a table may be chosen freely.
    let by_task = export.shown(&["table", "--by", "task", "--where", "model=a", "--format", "csv"]);
    assert!(by_task.contains("Foraging,1.5,0.5,2"), "{by_task}");
}

#[test]
fn different_settings_are_refused_with_what_to_do() {
    let mut export = Export::of(games("Pursuit", "a", &[1.0, 2.0], &json!({})));
    export.games.extend(games("Pursuit", "a", &[3.0], &json!({ "view_size": 7, "noise": 0.2 })));
    let error = export.refused(&["table", "main"]);
    for expected in [
        "differ in view_size: 5 (2 games), 7 (1 game), and also in noise",
        "--where view_size='5'",
        "--rows model,task,view_size",
    ] {
        assert!(error.contains(expected), "{expected} is missing in {error}");
    }
    export.shown(&["table", "main", "--where", "view_size=5"]);
    export.shown(&["table", "--by", "model,view_size,noise"]);

    let hot = json!({ "agent_meta": json!({ "temperature": 1.5 }).to_string() });
    let mut export = Export::of(games("Pursuit", "a", &[1.0], &json!({})));
    export.games.extend(games("Pursuit", "a", &[2.0], &hot));
    let error = export.refused(&["table", "main"]);
    assert!(
        error.contains("games of a differ in temperature: 1.5 (1 game), none (1 game)"),
        "{error}"
    );
    export.shown(&["table", "main", "--ignore", "temperature"]);

    // Two teams of one name, whose members were asked in different ways.
    let of = |effort| {
        let meta = json!({ "eval": { "effort": effort } });
        let holders = json!([{ "model": "b", "seats": 12, "agent_meta": meta }]).to_string();
        json!({ "team": r#"{"b":12}"#, "team_holders": holders })
    };
    let mut export = Export::of(games("Pursuit", "12 b", &[1.0], &of("low")));
    export.games.extend(games("Pursuit", "12 b", &[2.0], &of("high")));
    let error = export.refused(&["table", "main"]);
    assert!(error.contains("games of 12 b differ in team_holders: "), "{error}");

    // Columns of one table have the same settings too, though no cell mixes them.
    let mut export = Export::of(games("Pursuit", "a", &[1.0], &json!({})));
    export.games.extend(games("Pursuit", "b", &[2.0], &json!({ "memory": 0 })));
    assert!(export.refused(&["table", "main"]).contains("differ in memory"));
    // Nor are models averaged.
    assert!(export.refused(&["table", "--by", "task"]).contains("differ in model"));
}

#[test]
fn values_of_two_embedders_never_meet() {
    let of = |embedder| json!({ "homogeneity": 0.5, "embedder": embedder, "metrics_revision": 1 });
    let mut export = Export::of(games("Pursuit", "a", &[1.0], &of("hash-1")));
    export.games.extend(games("Pursuit", "b", &[2.0], &of("another")));
    for args in [
        &["table", "main", "--value", "homogeneity"][..],
        &["table", "--by", "model,embedder", "--value", "homogeneity"],
    ] {
        let error = export.refused(args);
        assert!(error.contains("another (1 game), hash-1 (1 game). They are never"), "{error}");
    }
    let chosen = ["table", "main", "--value", "homogeneity", "--where", "embedder=hash-1"];
    assert!(export.shown(&chosen).contains("0.50 ± 0.00 (1)"));
    // Scores have no embedder.
    export.shown(&["table", "main"]);
}

#[test]
fn latex_takes_any_name() {
    let export = Export::of(games("Pursuit", "a_b & {c} 5% \\x", &[1.0, 2.0], &json!({})));
    let latex = export.shown(&["table", "main", "--format", "latex"]);
    assert!(
        latex.contains(
            "a\\_b \\& \\{c\\} 5\\% \\textbackslash{}x & $1.50 \\pm 0.50$ (2) & $1.50$ \\\\"
        ),
        "{latex}"
    );
    assert!(latex.contains("\\toprule") && latex.contains("\\bottomrule"), "{latex}");
}

#[test]
fn nothing_to_show_is_a_sentence() {
    let none = Export::of(Vec::new());
    assert!(none.refused(&["table", "main"]).contains("there are no games"));
    let export = Export::of(games("Pursuit", "a", &[1.0, 2.0], &json!({})));
    for (args, expected) in [
        (&["table", "main", "--where", "view_size=9"][..], "view_size is 5 (2 games)"),
        (&["table", "main", "--where", "view_sizes=9"], "most similar are view_size"),
        (&["table", "main", "--value", "pushes"], "export them again"),
        (&["table", "main", "--value", "model"], "model is text"),
        (&["table", "rules"], "baselines.toml"),
        (&["table", "sampling"], "no game has the column temperature\n"),
        (&["table", "centralized"], "no game has centralized control"),
        (&["table", "noise"], "these games have none"),
    ] {
        let error = export.refused(args);
        assert!(error.contains(expected), "{args:?}: {error}");
    }
    let aborted = Export::of(games("Pursuit", "a", &[1.0], &json!({ "status": "aborted" })));
    assert!(aborted.refused(&["table", "main"]).contains("no game is finished: 1 aborted"));
}

#[test]
fn formulas_of_the_paper() {
    let mut export =
        Export::of(games("Pursuit", "a", &[8.8], &json!({ "control": "centralized" })));
    export.games.extend(games("Foraging", "a", &[8.2], &json!({ "control": "centralized" })));
    export.games.extend(games("Pursuit", "a", &[0.0], &json!({})));
    export.games.extend(games("Foraging", "a", &[5.8], &json!({})));
    let table = export.shown(&["table", "centralized"]);
    assert!(table.contains("+41.4 %") && table.matches(" %").count() == 1, "{table}");

    // The five tasks of o4-mini. The paper's change, +0.4 %, is that of rounded averages.
    let tasks = ["Pursuit", "Synchronization", "Foraging", "Flocking", "Transport"];
    let noisy = json!({ "noise": 0.2, "max_delay": 4 });
    let mut export = Export::of(Vec::new());
    for (task, quiet, loud) in tasks
        .iter()
        .zip([9.6, 2.8, 4.8, 8.9, 0.52])
        .zip([12.0, 1.8, 4.6, 8.3, 0.0])
        .map(|((task, quiet), loud)| (*task, quiet, loud))
    {
        export.games.extend(games(task, "o4-mini", &[quiet], &json!({})));
        export.games.extend(games(task, "o4-mini", &[loud], &noisy));
    }
    let table = export.shown(&["table", "noise"]);
    for expected in ["5.32", "5.34", "+0.3 %"] {
        assert!(table.contains(expected), "{expected} is missing in {table}");
    }

    // The highest mean of a row is bold, and games of the other sheet are not in it.
    let mut export = Export::of(Vec::new());
    for (temperature, top_p, score) in [(0.0, 1.0, 3.0), (1.0, 1.0, 5.0), (1.0, 0.3, 6.0)] {
        let meta = json!({ "temperature": temperature, "top_p": top_p }).to_string();
        export.games.extend(games("Pursuit", "a", &[score], &json!({ "agent_meta": meta })));
    }
    let markdown = export.shown(&["table", "sampling", "--format", "markdown"]);
    for expected in [
        "| Pursuit | 3.00 ± 0.00 (1) | **5.00 ± 0.00 (1)** |",
        "| Pursuit | **6.00 ± 0.00 (1)** | 5.00 ± 0.00 (1) |",
    ] {
        assert!(markdown.contains(expected), "{expected} is missing in {markdown}");
    }
}
