//! Leaderboards: what is on them, how rows are marked, and that they follow from the journals.

use serde_json::{Value, json};
use swarmbench::run::definition::Definition;
use swarmbench::standings::Standings;
use swarmbench_boards::run::sampling;
use swarmbench_engine::TaskName;
use swarmbench_testkit::needs;

use super::played::{Did, Offline, definition};
use super::{BOARD, board, column, csv, played, records};
use crate::app::program::{swarmbench, text};
use crate::app::{TestApp, list};

#[tokio::test]
async fn a_board_by_hand() {
    let app = played().await;
    let board = board(&app, "suite=small").await;
    assert_eq!((&board["suite"], &board["rules"]), (&json!("small"), &json!("paper")));
    assert_eq!((&board["tasks"], &board["sort"]), (&json!(["Synchronization"]), &json!("total")));
    assert_eq!((&board["pick"], &board["rows"]), (&json!("best"), &json!(4)));
    assert_eq!(column(&board, "/model"), ["steady", "equal", "equal too", "broken off"]);
    assert_eq!(column(&board, "/rank"), [1, 2, 2, 4]);
    assert_eq!(column(&board, "/owner"), ["alice", "the organizer", "=bob", "=bob"]);
    assert_eq!(column(&board, "/vouched"), [false, true, false, false]);
    assert_eq!(column(&board, "/runs"), [2, 1, 1, 1]);
    assert_eq!(column(&board, "/status"), ["finished", "finished", "finished", "aborted"]);
    assert_eq!(column(&board, "/decentralization"), ["declared"; 4]);
    let rows = list(&board["items"]);
    let told = |row: &Value| {
        let task = &row["tasks"]["Synchronization"];
        let number = |field: &str| task[field].as_f64().expect("a number");
        assert_eq!(task["mean"], row["total"], "the only task");
        format!(
            "{:.2} ± {:.2} {}/{}",
            number("mean"),
            number("deviation"),
            task["games"],
            task["planned"]
        )
    };
    // (10 + 6 + 0 + 0) / 4: the broken game does not count, those that were never begun count as 0.
    let expected = ["9.60 ± 0.49 5/5", "7.40 ± 0.49 5/5", "7.40 ± 2.42 5/5", "4.00 ± 4.24 2/4"];
    assert_eq!(rows.iter().map(told).collect::<Vec<_>>(), expected);
    // 3 of 48 answers, and 2 of 50 moves.
    assert_eq!(rows[2]["invalid_share"], json!(3.0 / 48.0));
    assert_eq!(rows[2]["clock_out_share"], json!(2.0 / 50.0));
    assert_eq!(
        (&rows[0]["invalid_share"], &rows[0]["clock_out_share"]),
        (&json!(0.0), &json!(0.0))
    );
    assert_eq!(column(&board, "/voided"), [0, 0, 0, 1]);

    // Seed by seed: 1, 2, 3, 3, 2. The variance of their mean is 0.14, with 4 degrees of freedom.
    let difference = &rows[1]["difference"];
    assert_eq!((&difference["to"], &difference["pairs"]), (&rows[0]["id"], &json!(5)));
    let ends = ["low", "mean", "high"].map(|end| difference[end].as_f64().expect("a number"));
    let half = 3.495_405_932_516_442 * 0.14_f64.sqrt();
    for (end, expected) in ends.into_iter().zip([2.2 - half, 2.2, 2.2 + half]) {
        assert!((end - expected).abs() < 1e-9, "{difference}");
    }
    // The order of two that are equal is not sure at all.
    let tied = &rows[2]["difference"];
    assert!(tied["low"].as_f64() < Some(0.0) && tied["high"].as_f64() > Some(0.0), "{tied}");
    assert_eq!(rows[3]["difference"]["pairs"], 4);
    assert_eq!(rows[0]["difference"], Value::Null);
}

#[tokio::test]
async fn best_last_and_mean_runs() {
    let app = played().await;
    let of = async |pick: &str| {
        let board = board(&app, &format!("suite=small&pick={pick}")).await;
        let rows = list(&board["items"]);
        let row = rows.iter().find(|row| row["model"] == "steady").expect("a row").clone();
        (row["total"].as_f64().expect("a total"), row["tasks"]["Synchronization"]["games"].clone())
    };
    assert_eq!(of("best").await, (9.6, json!(5)));
    assert_eq!(of("last").await, (3.0, json!(5)));
    let (total, games) = of("mean").await;
    assert!((total - 6.3).abs() < 1e-9, "{total}");
    assert_eq!(games, 10);
}

#[tokio::test]
async fn the_same_as_csv() {
    let app = played().await;
    let json = board(&app, "suite=small").await;
    let answer = csv(&app, "suite=small").await;
    let named =
        app.get(&format!("{BOARD}?suite=small&format=csv")).header("accept", "application/json");
    assert_eq!(named.send().await.body, answer.body, "the query counts more than the header");
    let head = answer.text().lines().next().expect("a line").to_owned();
    assert_eq!(
        head,
        "suite,suite_digest,rules,rank,reference,imported,table,owner,model,temperature,top_p,prompt_template,vouched,\
         decentralization,runs,run,status,started_at,total,synchronization_mean,synchronization_deviation,\
         synchronization_games,synchronization_planned,difference,difference_low,difference_high,difference_pairs,\
         invalid_share,timeout_share,voided,row,difference_to,row_rules,converted,other_rules,kind,prompt,answer_reader,\
         failed_refusal,failed_content_filter,failed_truncated,failed_tool_call,failed_reasoning_only,failed_rejected,\
         failed_empty,failed_no_marker,failed_unknown_action,sampling,prompt_tokens,completion_tokens,\
         cached_tokens,cache_write_tokens,reasoning_tokens,cost_usd,costs_are_whole,holders"
    );
    let records = records(&answer);
    let rows = list(&json["items"]);
    assert_eq!(records.len(), rows.len());
    for (record, row) in records.iter().zip(&rows) {
        let number = |name: &str| record[name].parse::<f64>().expect("a number");
        assert_eq!(record["model"], row["model"].as_str().expect("a text"));
        assert_eq!(Some(number("total")), row["total"].as_f64());
        let deviation = row.pointer("/tasks/Synchronization/deviation").expect("a field");
        assert_eq!(Some(number("synchronization_deviation")), deviation.as_f64());
        assert_eq!(record["suite_digest"], json["digest"].as_str().expect("a text"));
    }
    // The name of a key is anybody's: no spreadsheet is to run it.
    assert_eq!(records[2]["owner"], "'=bob");
    assert_eq!(records[0]["difference"], "");
}

/// A run whose owner says that people played is marked, and so are the human baselines of the paper; both can be left out.
#[tokio::test]
async fn people_are_marked_and_can_be_left_out() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    let people = json!({ "kind": "human" }).as_object().expect("an object").clone();
    let by_hand = Definition { meta: people.into(), ..definition("by hand", 5) };
    offline.run(by_hand, None, &[Did::Scored(7); 5], "finished").await;
    offline.run(definition("a program", 5), None, &[Did::Scored(6); 5], "finished").await;
    offline.close().await;
    app.start_again().await;
    let all = board(&app, "suite=small").await;
    assert_eq!(column(&all, "/model"), ["by hand", "a program"]);
    assert_eq!(column(&all, "/kind"), [json!("human"), Value::Null]);
    assert_eq!(records(&csv(&app, "suite=small").await)[0]["kind"], "human");
    let programs = board(&app, "suite=small&people=false").await;
    assert_eq!(
        (column(&programs, "/model"), &programs["rows"]),
        (vec![json!("a program")], &json!(1))
    );

    let kinds = |board: &Value| column(board, "/kind").contains(&json!("human"));
    assert!(kinds(&board(&app, "suite=baselines").await), "the human baselines of the paper");
    assert!(!kinds(&board(&app, "suite=baselines&people=false").await));
}

#[tokio::test]
async fn unknown_values_are_refused_with_what_is_allowed() {
    let app = played().await;
    for (query, expected) in [
        ("suite=large", "suite must be one of"),
        ("suite=small&rules=chess", "rules must be one of paper, reference"),
        ("suite=small&task=Pursuit", "task must be one of Synchronization"),
        ("suite=small&sort=owner", "sort must be one of total, Synchronization"),
        ("suite=small&pick=first", "pick must be one of best, last, mean"),
        ("format=xml", "format must be one of json, csv"),
        ("limit=0", "limit must be from 1 to 1000"),
        ("cursor=1", "cursor must be the next_cursor"),
        ("reference=maybe", "cannot be read"),
        ("colour=red", "cannot be read"),
    ] {
        let problem = app.get(&format!("{BOARD}?{query}")).problem(400, "malformed").await;
        let detail = problem["detail"].as_str().expect("a text");
        assert!(detail.contains(expected), "{query}: {detail}");
    }
    for query in ["task=Chess", "rules=chess", "cursor=x", "format=xml", "limit=1001"] {
        app.get(&format!("/api/v1/cross-play?{query}")).problem(400, "malformed").await;
    }
}

#[tokio::test]
async fn pages_are_parts_of_the_whole() {
    let app = played().await;
    let whole = list(&board(&app, "").await["items"]);
    assert_eq!(whole.len(), 13, "nobody but the paper");
    let (mut found, mut cursor) = (Vec::new(), String::new());
    loop {
        let query = format!("limit=4{cursor}");
        let page = board(&app, &query).await;
        assert!(list(&page["items"]).len() <= 4);
        found.extend(list(&page["items"]));
        let Some(next) = page["next_cursor"].as_str() else { break };
        let answer = csv(&app, &query).await;
        assert_eq!(answer.header("x-next-cursor"), next);
        cursor = format!("&cursor={next}");
    }
    assert_eq!(found, whole);
}

#[tokio::test]
async fn rows_of_other_rules_are_converted_and_marked() {
    let app = TestApp::start().await;
    let people = async |rules: &str| {
        let board = board(&app, &format!("suite=baselines&rules={rules}")).await;
        assert_eq!(board["rows"], 16);
        let mut rows = list(&board["items"]).into_iter();
        let row = rows.find(|row| row["table"] == "humans").expect("they are there");
        let flocking = &row["tasks"]["Flocking"];
        assert_eq!(row["rules"], "paper");
        let marks = [row["converted"].clone(), row["other_rules"].clone()];
        (flocking["mean"].clone(), flocking["deviation"].clone(), marks)
    };
    assert_eq!(people("paper").await, (json!(11.7), json!(2.33), [json!([]), json!([])]));
    let marks = [json!(["Flocking"]), json!(["Flocking"])];
    assert_eq!(people("reference").await, (json!(23.4), json!(4.66), marks));
}

/// Games with other settings or rules have a board of their own, even if their suites share a name.
#[needs(own_server)]
#[tokio::test]
async fn suites_of_one_name_and_other_settings_are_kept_apart() {
    let mut app = played().await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    let mut other = definition("elsewhere", 5);
    other.suite.settings.noise = 0.5;
    let digest = other.suite.digest();
    offline.run(other, None, &[Did::Scored(1); 5], "finished").await;
    let mut reference = definition("by other rules", 5);
    reference.suite.rules = "reference".to_owned();
    offline.run(reference, None, &[Did::Scored(2); 5], "finished").await;
    offline.close().await;
    app.start_again().await;
    let problem = app.get(&format!("{BOARD}?suite=small")).problem(400, "malformed").await;
    let detail = problem["detail"].as_str().expect("a text");
    assert!(detail.contains(&format!("small@{digest}")) && detail.contains("several"), "{detail}");
    let first = definition("", 5).suite.digest();
    assert!(detail.contains(&format!("small@{first}")), "{detail}");
    assert_eq!(board(&app, &format!("suite=small@{first}")).await["rows"], 4);
    let alone = board(&app, &format!("suite=small@{digest}")).await;
    assert_eq!(
        (column(&alone, "/model"), column(&alone, "/owner")),
        (vec![json!("elsewhere")], vec![Value::Null])
    );
    let alone = board(&app, "suite=small&rules=reference").await;
    assert_eq!(column(&alone, "/model"), ["by other rules"]);
}

#[tokio::test]
async fn the_papers_rows_are_marked_and_a_model_stands_between_them() {
    let mut app = TestApp::builder().manual_clock().start().await;
    let bare = board(&app, "").await;
    assert_eq!((&bare["suite"], &bare["rows"]), (&json!("standard"), &json!(13)));
    assert_eq!(column(&bare, "/reference"), vec![true; 13]);
    assert!(list(&bare["items"])[0]["note"].as_str().expect("a note").contains("public toolkit"));
    assert_eq!(board(&app, "reference=false").await["rows"], 0);
    assert_eq!(board(&app, "rules=reference").await["rows"], 13);
    assert_eq!(board(&app, "suite=quick").await["rows"], 0);

    app.stop().await;
    let mut offline = Offline::open(&app).await;
    // Synchronization with twelve agents, five games with 20 points each, and nothing else: 20.00 in all.
    let model = played::standard("a model");
    let plan = model.suite.plan();
    let did =
        |name: &str| if name == "Synchronization" { Did::Together(20) } else { Did::NotBegun };
    let games: Vec<Did> = plan.iter().map(|game| did(&game.task)).collect();
    offline.run(model, None, &games, "aborted").await;
    offline.close().await;
    app.start_again().await;
    let board_now = board(&app, "").await;
    let rows = list(&board_now["items"]);
    let place = rows.iter().position(|row| row["model"] == "a model").expect("it is there");
    let around: Vec<_> =
        rows[place - 1..=place + 1].iter().map(|row| row["model"].clone()).collect();
    assert_eq!(around, ["gpt-4.1", "a model", "deepseek-v3"]);
    let row = &rows[place];
    assert_eq!(
        (&row["rank"], &row["total"], &row["status"]),
        (&json!(5), &json!(20.0), &json!("aborted"))
    );
    assert_eq!(
        row["tasks"]["Pursuit"],
        json!({ "mean": 0.0, "deviation": 0.0, "games": 0, "planned": 5 })
    );
    assert_eq!(row["difference"], Value::Null, "the paper's games cannot be compared seed by seed");
    let one = board(&app, "task=Synchronization").await;
    assert_eq!(column(&one, "/model")[..2], ["a model", "claude-3.7-sonnet"]);
}

#[tokio::test]
async fn boards_follow_from_the_journals_to_the_byte() {
    let mut app = played().await;
    let queries =
        ["suite=small", "suite=small&pick=mean", "suite=small&pick=last&sort=Synchronization"];
    let mut before = Vec::new();
    for query in queries {
        before.push((
            app.get(&format!("{BOARD}?{query}")).send().await.body,
            csv(&app, query).await.body,
        ));
    }
    let db = app.db();
    let refused = swarmbench(&["board", "rebuild", "--db", &db]).await;
    assert!(!refused.status.success());
    assert!(
        text(&refused.stderr).contains("a server runs on this database"),
        "{}",
        text(&refused.stderr)
    );

    app.stop().await;
    let shown = swarmbench(&["leaderboard", "--db", &db, "--suite", "small"]).await;
    for (args, expected) in [(&[][..], "None has changed"), (&["--replay"], "None has changed")] {
        let output = swarmbench(&[&["board", "rebuild", "--db", &db], args].concat()).await;
        let said = text(&output.stdout);
        assert!(output.status.success(), "{}", text(&output.stderr));
        // Five runs: 5 + 5 + 5 + 5 + 3 games, and one of the running run.
        assert!(said.contains("24 results") && said.contains(expected), "{said}");
    }
    // A damaged table is rebuilt.
    app.tamper(
        "UPDATE results SET score = 99 WHERE episode = 1; DELETE FROM results WHERE episode > 20;",
    )
    .await;
    let output = swarmbench(&["board", "rebuild", "--db", &db]).await;
    assert!(text(&output.stdout).contains("5 have changed"), "{}", text(&output.stdout));
    let again = swarmbench(&["leaderboard", "--db", &db, "--suite", "small"]).await;
    assert_eq!(text(&again.stdout), text(&shown.stdout));
    assert!(text(&shown.stdout).contains("broken off ?"), "{}", text(&shown.stdout));
    app.start_again().await;
    for (query, (json, table)) in queries.iter().zip(&before) {
        assert_eq!(text(&app.get(&format!("{BOARD}?{query}")).send().await.body), text(json));
        assert_eq!(text(&csv(&app, query).await.body), text(table));
    }
}

#[tokio::test]
async fn a_journal_that_was_changed_is_found_and_nothing_is_rebuilt() {
    let mut app = played().await;
    let before = app.get(&format!("{BOARD}?suite=small")).send().await.body;
    app.stop().await;
    let db = app.db();
    let refused = async |args: &[&str]| {
        let output = swarmbench(&[&["board", "rebuild", "--db", &db], args].concat()).await;
        assert!(!output.status.success(), "{}", text(&output.stdout));
        text(&output.stderr)
    };
    // An end that its rounds do not lead to is found at once.
    app.tamper("UPDATE rounds SET score = 50 WHERE episode = 2 AND round = 9;").await;
    let said = refused(&[]).await;
    assert!(said.contains("ep_") && said.contains("its rounds say 10 and 50"), "{said}");
    // Where a forger thought of that, it takes a replay.
    let forged = "UPDATE episodes SET ending = replace(ending, '\"score\":10.0', '\"score\":50.0') WHERE key = 2;";
    app.tamper(forged).await;
    let said = refused(&["--replay"]).await;
    assert!(said.contains("ep_") && said.contains("line 11"), "{said}");
    app.start_again().await;
    assert_eq!(app.get(&format!("{BOARD}?suite=small")).send().await.body, before);
}

/// Attempts in competitions are on this board once their seeds are revealed, unless their entrant has left.
#[tokio::test]
async fn sealed_results_are_not_on_the_board_before_they_are_revealed() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    let owner = offline.owner("the organizer").await;
    offline.run(definition("attempt", 5), owner, &[Did::Scored(7); 5], "finished").await;
    offline.close().await;
    app.tamper(
        "INSERT INTO competitions (key, id, definition, salt, seeds, commitment, opens_at, closes_at, created_at)
         SELECT 1, 'cmp_1', '{}', hash, hash, hash, 0, 1, 0 FROM keys;
         INSERT INTO entries (key, id, competition, owner, name, model, declaration, status, vouched, registered_at)
         VALUES (1, 'ent_1', 1, 1, 'team blue', 'attempt', '{}', 'active', TRUE, 0);
         UPDATE runs SET entry = 1, attempt = 1;",
    )
    .await;
    app.start_again().await;
    let problem = app.get(&format!("{BOARD}?suite=small")).problem(400, "malformed").await;
    assert!(!problem["detail"].as_str().expect("a text").contains("small"), "{problem}");
    app.stop().await;
    app.tamper("UPDATE competitions SET revealed_at = 2;").await;
    app.start_again().await;
    let revealed = board(&app, "suite=small").await;
    assert_eq!(
        (column(&revealed, "/owner"), column(&revealed, "/vouched")),
        (vec![json!("team blue")], vec![json!(true)])
    );
    app.stop().await;
    app.tamper("UPDATE entries SET status = 'disqualified';").await;
    app.start_again().await;
    app.get(&format!("{BOARD}?suite=small")).problem(400, "malformed").await;
}

/// A board that was read once is updated by later commits.
#[needs(own_server)]
#[tokio::test]
async fn a_board_has_what_is_durable() {
    let mut app = played().await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    let standings = Standings::new(offline.store.clone());
    let names = async || {
        let question = swarmbench_boards::collection::Question {
            suite: Some("small".to_owned()),
            ..Default::default()
        };
        let ranked = standings.boards().await.expect("boards").ranked(&question).expect("a board");
        let name = |row: &swarmbench_boards::rank::RankedRow| {
            let shown = row.shown().expect("a run");
            let task = shown.task(TaskName::Synchronization).expect("a task");
            format!("{} {}/{}", shown.run.player.model, task.games, task.planned)
        };
        ranked.rows.iter().map(name).collect::<Vec<_>>()
    };
    let first = names().await;
    assert_eq!(first, ["steady 5/5", "equal 5/5", "equal too 5/5", "broken off 2/4"]);
    let run = offline.open_run(definition("newer", 5), None, &[Did::Scored(10); 5]).await;
    assert_eq!(names().await, first, "it is not over");
    offline.end(run, "finished").await;
    let all = ["newer 5/5", "steady 5/5", "equal 5/5", "equal too 5/5", "broken off 2/4"];
    assert_eq!(names().await, all);
    // The host finds out later that it broke a game.
    offline.void_last(1).await;
    assert_eq!(names().await[0], "newer 4/4");
    // A run may be closed while a game is running: it is not over before that one is.
    let did = [Did::Scored(10), Did::Scored(10), Did::GoesOn];
    let run = offline.open_run(definition("closed", 5), None, &did).await;
    offline.end(run, "closed").await;
    assert_eq!(names().await.len(), 5);
    offline.abort_last().await;
    assert_eq!(names().await[5], "closed 3/5");
    // More changes than are kept one by one.
    offline.void_last(5000).await;
    assert_eq!(names().await[4], "closed 2/4");
    offline.close().await;
}

#[needs(own_server)]
#[tokio::test]
async fn games_from_files_are_marked_and_only_shown_where_they_are_asked_for() {
    let mut app = played().await;
    app.stop().await;
    let offline = Offline::open(&app).await;
    let standings = Standings::new(offline.store.clone());
    let question = swarmbench_boards::collection::Question {
        suite: Some("small".to_owned()),
        imported: true,
        ..Default::default()
    };
    let rows = async || {
        standings.boards().await.expect("boards").ranked(&question).expect("a board").rows.len()
    };
    assert_eq!(rows().await, 4);
    offline.import("from files", 27, 8.0).await;
    offline.import("from files", 42, 9.0).await;
    offline.import("from files", 43, 99.0).await;
    assert_eq!(rows().await, 5);
    offline.close().await;
    app.start_again().await;
    assert_eq!(board(&app, "suite=small").await["rows"], 4);
    let all = board(&app, "suite=small&imported=true").await;
    assert_eq!(column(&all, "/imported"), [false, true, false, false, false]);
    let row = &list(&all["items"])[1];
    assert_eq!((&row["model"], &row["vouched"]), (&json!("from files"), &json!(false)));
    assert_eq!(
        (&row["rank"], &row["total"], &row["difference"]),
        (&json!(2), &json!(8.5), &Value::Null)
    );
    // The seed that is not of the suite is left out, and those that are missing count nowhere.
    let score = json!({ "mean": 8.5, "deviation": 0.5, "games": 2, "planned": 5 });
    assert_eq!(row["tasks"]["Synchronization"], score);
    // What is below is compared with what was played here.
    assert_eq!(list(&all["items"])[2]["difference"]["to"], list(&all["items"])[0]["id"]);
}

#[tokio::test]
async fn the_command_line_shows_a_board_of_a_server() {
    let app = played().await;
    let server = app.base().to_owned();
    let output = swarmbench(&["leaderboard", "--server", &server, "--suite", "small"]).await;
    let shown = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    for expected in [
        "small@",
        "steady ?",
        "by alice",
        "2 runs",
        "9.60",
        "±0.49",
        "equal",
        "broken off ?",
        "aborted, declared",
        "2/4",
        "1 not counted",
        "6.2 % invalid",
        "4.0 % out of time",
        "95 %:",
    ] {
        assert!(shown.contains(expected), "{expected:?} is missing in\n{shown}");
    }
    assert!(!shown.contains("equal ?"), "an organizer vouches for it:\n{shown}");
    let output =
        swarmbench(&["leaderboard", "--server", &server, "--suite", "small", "--csv"]).await;
    assert_eq!(text(&output.stdout), csv(&app, "suite=small").await.text());
    let output = swarmbench(&["leaderboard", "--server", &server, "--no-reference"]).await;
    assert!(text(&output.stdout).contains("no run has finished"), "{}", text(&output.stdout));
    let output = swarmbench(&["leaderboard", "--server", &server]).await;
    assert!(text(&output.stdout).contains("gemini-2.0-flash *"), "{}", text(&output.stdout));
    let output = swarmbench(&["leaderboard", "--server", &server, "--pick", "worst"]).await;
    assert!(text(&output.stderr).contains("pick must be one of best, last, mean"));
    let db = app.db();
    let output = swarmbench(&["leaderboard", "--db", &db]).await;
    assert!(text(&output.stderr).contains("name it with --server"), "{}", text(&output.stderr));
}

/// Over HTTP from the beginning: what is played is on the board as soon as it is over, with the numbers of its own page.
#[tokio::test]
async fn a_run_is_on_the_board_with_the_numbers_of_its_own_page() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let (key, _) = app.key(json!({ "name": "alice" })).await;
    let request = json!({
        "suite": {
            "name": "two", "tasks": ["Foraging", "Synchronization"], "seeds": [4, 9],
            "settings": { "num_agents": 1, "max_round": 3 },
        },
        "model": "a model", "temperature": 0.5, "top_p": 0.9,
    });
    let run = app.post("/api/v1/runs").token(&key).json(&request).ok().await;
    let token = run["swarm_token"].as_str().expect("a token").to_owned();
    let path = format!("/api/v1/runs/{}", run["id"].as_str().expect("an id"));
    app.get(&format!("{BOARD}?suite=two")).problem(400, "malformed").await;
    loop {
        let seen = app.get("/swarm/obs?wait=60").token(&token).ok().await;
        if seen["finished"] == true {
            break;
        }
        let act = |seen: &Value| {
            let switches = seen["light_on"].is_boolean();
            let action =
                if switches { json!({ "action": "SWITCH" }) } else { json!({ "response": "hm" }) };
            let mut act = json!({
                "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"],
            });
            act.as_object_mut()
                .expect("an object")
                .extend(action.as_object().expect("one").clone());
            act
        };
        let acts: Vec<Value> = list(&seen["observations"]).iter().map(act).collect();
        app.post("/swarm/act").token(&token).json(&json!({ "acts": acts })).ok().await;
    }
    let page = app.get(&path).token(&key).ok().await;
    assert_eq!(page["status"], "finished");
    let found = board(&app, "suite=two").await;
    let row = &list(&found["items"])[0];
    assert_eq!(found["tasks"], json!(["Foraging", "Synchronization"]), "in the order of the suite");
    assert_eq!((&row["run"], &row["owner"]), (&page["id"], &json!("alice")));
    assert_eq!((&row["temperature"], &row["top_p"]), (&json!(0.5), &json!(0.9)));
    // Three rounds of one light in two games; nothing was carried.
    assert_eq!((&row["total"], &row["invalid_share"]), (&json!(3.0), &json!(0.5)));
    for task in list(&page["tasks"]) {
        let shown = &row["tasks"][task["task"].as_str().expect("a name")];
        for (field, there) in [
            ("mean", "mean"),
            ("deviation", "deviation"),
            ("games", "played"),
            ("planned", "planned"),
        ] {
            assert_eq!(shown[field], task[there], "{field} of {task}");
        }
    }
    assert_eq!(page["total"], row["total"]);
    // The host finds that it broke a game: the board does without it at once.
    let episode = list(&page["games"])[0]["episode"].as_str().expect("an id").to_owned();
    let void = app.post(&format!("/api/v1/episodes/{episode}/void")).token(&app.organizer);
    void.json(&json!({ "reason": "a test" })).ok().await;
    let row = list(&board(&app, "suite=two").await["items"])[0].clone();
    assert_eq!((&row["voided"], &row["tasks"]["Foraging"]["planned"]), (&json!(1), &json!(1)));
}

#[test]
fn what_an_evaluation_samples_with_is_told_in_short() {
    let told = |eval: Value| sampling(eval.as_object().expect("an object"));
    assert_eq!(told(json!({ "identity": "0", "prompt_revision": 2 })), None);
    assert_eq!(told(json!({ "extra": { "user": "me" } })), None);
    assert_eq!(
        told(json!({
            "extra": { "user": "me", "top_k": 20, "chat_template_kwargs": { "enable_thinking": false } },
            "max_tokens": 64, "effort": "low",
        })),
        Some(
            "effort low, max_tokens 64, top_k 20, chat_template_kwargs {\"enable_thinking\":false}"
                .to_owned()
        )
    );
    // Long ones that differ at their end differ.
    let long =
        |end: &str| told(json!({ "extra": { "logit_bias": format!("{}{end}", "ä".repeat(500)) } }));
    let (one, other) = (long("1").expect("a text"), long("2").expect("a text"));
    assert!(one != other && one.len() < 200 && one.starts_with("logit_bias ää"), "{one}");
}
