//! The board at the end, in every format.

use std::path::Path;

use super::bench::Bench;

const SMALL: [&str; 8] =
    ["--seeds", "1..4", "--max-round", "6", "--num-agents", "3", "--player", "random,default"];

#[tokio::test]
async fn a_board_is_shown_in_every_format_and_they_agree() {
    let bench = Bench::new();
    let call = async |more: &[&str]| bench.eval(&[&SMALL[..], more].concat()).await.ends(0);
    let table = call(&["--output", "board.md", "--format", "markdown", "--board", "long"]).await;
    let shown = table.says(&[
        "built-in/random",
        "built-in/default",
        "Flocking",
        "swarmbench leaderboard --suite",
    ]);
    let markdown = bench.read("board.md");
    let lines: Vec<&str> = markdown.lines().collect();
    assert_eq!(lines[0], "| model | task | mean ± deviation | least | most | games | seeds |");
    assert_eq!(lines.len(), 2 + 2 * 5, "{markdown}");
    let json: serde_json::Value =
        serde_json::from_str(&call(&["--format", "json"]).await.out).expect("JSON");
    assert_eq!(json["rows"][0]["seeds"], serde_json::json!([1, 2, 3]));
    assert_eq!(json["settings"], serde_json::json!({ "max_round": 6, "num_agents": 3 }));
    let csv = call(&["--format", "csv"]).await.out;
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let headings = reader.headers().expect("headings").clone();
    let column =
        |name: &str| headings.iter().position(|heading| heading == name).expect("a column");
    let records: Vec<_> = reader.records().map(|record| record.expect("a record")).collect();
    assert_eq!(records.len(), 10);
    let cells = json["rows"].as_array().expect("rows").iter().flat_map(|row| {
        row["tasks"].as_array().expect("tasks").iter().map(move |cell| (row, cell))
    });
    for (((row, cell), record), line) in cells.zip(&records).zip(&lines[2..]) {
        let number = |name: &str| cell[name].as_f64().expect("a number");
        let (mean, deviation) = (number("mean"), number("deviation"));
        assert_eq!(record[column("mean")].parse(), Ok(mean));
        assert_eq!(record[column("deviation")].parse(), Ok(deviation));
        let (model, task) =
            (row["model"].as_str().expect("a name"), cell["task"].as_str().expect("a task"));
        assert_eq!((&record[column("model")], &record[column("task")]), (model, task));
        let (least, most) = (number("least"), number("most"));
        let expected = format!(
            "| {model} | {task} | {mean:.2} ± {deviation:.2} | {least:.2} | {most:.2} | 3 | 1..4 |"
        );
        assert_eq!(*line, expected);
        assert!(shown.out.contains(&format!("{mean:.2} ± {deviation:.2}")), "{}", shown.out);
    }
}

#[tokio::test]
async fn columns_of_csv_have_names_of_their_own_whatever_varies() {
    let bench = Bench::new();
    let varied = ["--max-round", "3,4", "--answer-reader", "last-marker,first-marker"];
    let usual = ["--seeds", "1", "--num-agents", "3", "--player", "random", "--format", "csv"];
    for more in [&varied[..], &["--max-round", "3"]] {
        let csv = bench.eval(&[&usual[..], more].concat()).await.ends(0).out;
        let header = csv.lines().next().expect("a header");
        let mut names: Vec<&str> = header.split(',').collect();
        assert_eq!(names.iter().filter(|name| **name == "answer_reader").count(), 1, "{header}");
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{header}");
    }
}

/// The table of the baselines comes from one command; here with few and short games.
#[tokio::test]
async fn baselines_are_a_row_for_each_player_and_task() {
    let bench = Bench::new();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/eval/baselines.toml");
    let file = file.display().to_string();
    let args =
        [&file, "--db", "baselines.db", "--verify", "--format", "markdown", "--output", "table.md"];
    let short = ["--seeds", "0..2", "--max-round", "4"];
    bench.eval(&[&args[..], &short].concat()).await.ends(0).says(&["verified:", "table.md"]);
    let table = bench.read("table.md");
    for player in swarmbench_players::all() {
        for task in player.tasks {
            let row = format!("| built-in/{} | {} | ", player.name, task.name());
            assert_eq!(table.matches(&row).count(), 1, "{row} in {table}");
        }
    }
}

/// Settings that vary are numbers where they are numbers, on the board and before it is played.
#[tokio::test]
async fn json_has_settings_in_their_types() {
    let bench = Bench::new();
    let varied = ["--player", "random", "--task", "Foraging", "--seeds", "1", "--max-round", "2"];
    let varied = [&varied[..], &["--num-agents", "2,3", "--noise", "0.25", "--map-size", "9"]];
    let board = bench.board(&varied.concat()).await;
    let shared = serde_json::json!({ "map_size": "9x9", "max_round": 2, "noise": 0.25 });
    assert_eq!(board["settings"], shared);
    let rows = board["rows"].as_array().expect("rows");
    let varied_of: Vec<_> = rows.iter().map(|row| row["varied"].clone()).collect();
    assert_eq!(varied_of, [serde_json::json!([2]), serde_json::json!([3])]);
    let planned = bench.board(&[&varied.concat()[..], &["--dry-run"]].concat()).await;
    assert_eq!(planned["runs"][1]["settings"], serde_json::json!({ "num_agents": 3 }));
}
