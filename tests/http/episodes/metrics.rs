//! Metrics of an episode.

use serde_json::{Value, json};

use super::request;
use crate::app::program::{printed, swarmbench};
use crate::app::{Episode, TestApp};

/// A game of two rounds in which everybody says something.
async fn played(app: &TestApp) -> Episode {
    let request = json!({ "task": "Synchronization", "num_agents": 3, "max_round": 2, "seed": 3 });
    let episode = app.create(request).await;
    for (round, says) in ["UP at 12?", "up at 9"].into_iter().enumerate() {
        for token in episode.seats() {
            let act = json!({ "round": round, "action": "UP", "message": says });
            app.act(token, &act).await;
        }
    }
    episode
}

fn value(metrics: &Value, metric: &str) -> (Option<f64>, u64) {
    let of = &metrics["values"][metric];
    (of["value"].as_f64(), of["rounds"].as_u64().expect("a number of rounds"))
}

#[tokio::test]
async fn values_follow_from_what_was_played() {
    let app = TestApp::start().await;
    let episode = played(&app).await;
    let metrics = app.get(&episode.path("/metrics")).ok().await;
    assert_eq!(
        (&metrics["definition"], &metrics["metrics_revision"], &metrics["embedder"]),
        (&json!("paper"), &json!(1), &json!("hash-1"))
    );
    assert_eq!((&metrics["rounds"], &metrics["status"]), (&json!(2), &json!("finished")));
    assert_eq!(value(&metrics, "question_share"), (Some(0.5), 2));
    assert_eq!(value(&metrics, "message_length"), (Some(8.0), 2));
    assert_eq!(value(&metrics, "digit_share"), (Some(f64::midpoint(2.0 / 9.0, 1.0 / 7.0)), 2));
    assert_eq!(value(&metrics, "direction_entropy"), (Some(0.0), 2));
    assert_eq!(value(&metrics, "homogeneity"), (Some(1.0), 2));
    // The toolkit's figures have 0 where all say the same, and this page of one game has 12 of its other values.
    let toolkit = app.get(&episode.path("/metrics?definition=toolkit")).ok().await;
    assert_eq!(value(&toolkit, "homogeneity"), (Some(0.0), 2));
    assert_eq!(toolkit["values"].as_object().expect("values").len(), 13);
    app.get(&episode.path("/metrics?definition=other")).problem(400, "malformed").await;
}

#[tokio::test]
async fn a_running_episode_has_the_metrics_of_its_rounds_so_far() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 3)).await;
    let none = app.get(&episode.path("/metrics")).ok().await;
    assert_eq!((value(&none, "stillness"), &none["rounds"]), ((None, 0), &json!(0)));
    app.all_act(&episode, "STAY").await;
    let one = app.get(&episode.path("/metrics")).ok().await;
    assert_eq!((value(&one, "stillness"), &one["status"]), ((Some(1.0), 1), &json!("running")));
    app.all_act(&episode, "UP").await;
    let two = app.get(&episode.path("/metrics")).ok().await;
    assert_eq!(value(&two, "stillness"), (Some(0.5), 2));
}

#[tokio::test]
async fn a_series_has_a_value_for_each_state_page_by_page() {
    let app = TestApp::start().await;
    let episode = played(&app).await;
    let all = app.get(&episode.path("/metrics?series=true")).ok().await["series"].take();
    assert_eq!((&all["from"], &all["length"], &all["next"]), (&json!(0), &json!(3), &Value::Null));
    assert_eq!(all["counts"]["moves_up"], json!([null, 3, 3]));
    assert_eq!(all["counts"]["explored"][0], json!(3));
    assert_eq!(all["values"]["message_length"], json!([null, 9.0, 7.0]));
    let page = app.get(&episode.path("/metrics?series=true&from=1&states=1")).ok().await;
    let page = &page["series"];
    assert_eq!((&page["length"], &page["next"]), (&json!(1), &json!(2)));
    assert_eq!(page["values"]["message_length"], json!([9.0]));
    // Pages are cut from the same series, in both definitions.
    for definition in ["paper", "toolkit"] {
        let path = format!("/metrics?series=true&definition={definition}");
        let all = app.get(&episode.path(&path)).ok().await["series"].take();
        for from in 0..3 {
            let page = app.get(&episode.path(&format!("{path}&from={from}&states=1"))).ok().await;
            for kind in ["counts", "values"] {
                for (name, values) in all[kind].as_object().expect("lists") {
                    assert_eq!(page["series"][kind][name], json!([values[from]]), "{name} {from}");
                }
            }
        }
    }
    app.get(&episode.path("/metrics?series=true&from=3")).problem(404, "not_found").await;
    for wrong in ["series=true&states=0", "series=true&states=1001", "from=1"] {
        app.get(&episode.path(&format!("/metrics?{wrong}"))).problem(400, "malformed").await;
    }
}

/// Metrics are computed after the end, whether anybody reads them or not, and once more by the rebuild.
#[tokio::test]
async fn a_game_is_measured_after_its_end_and_again_by_the_rebuild() {
    let mut app = TestApp::start().await;
    let episode = played(&app).await;
    let first = app.get(&episode.path("/metrics")).ok().await;
    app.stop().await;
    let stored = "SELECT count(*) FROM metrics";
    assert_eq!(app.count(stored).await, 1);
    app.tamper("DELETE FROM metrics").await;
    app.tamper("INSERT INTO unmeasured (episode) SELECT key FROM episodes").await;
    app.start_again().await;
    while app.count("SELECT count(*) FROM unmeasured").await > 0 {
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    assert_eq!(app.count(stored).await, 1);
    app.stop().await;
    app.tamper("UPDATE metrics SET measured = replace(measured, '0.5', '0.75')").await;
    let output = swarmbench(&["board", "rebuild", "--db", &app.db()]).await;
    assert!(printed(&output).contains("1 games were measured."), "{}", printed(&output));
    app.start_again().await;
    assert_eq!(app.get(&episode.path("/metrics")).ok().await, first);
}

/// The program shows what the server says, and computes the same from the journal.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_program_measures_a_journal_as_the_server_does() {
    let app = TestApp::start().await;
    let episode = played(&app).await;
    let place = tempfile::tempdir().expect("a folder");
    let file = place.path().join("game.jsonl").display().to_string();
    std::fs::write(&file, app.journal(&episode).await).expect("written");
    for (query, options) in [
        ("", &["--format", "json"][..]),
        (
            "?definition=toolkit&series=true",
            &["--format", "json", "--definition", "toolkit", "--series"],
        ),
    ] {
        let said = app.get(&episode.path(&format!("/metrics{query}"))).ok().await;
        for game in
            [&["metrics", &file][..], &["metrics", episode.id.as_str(), "--server", app.base()]]
        {
            let output = swarmbench(&[game, options].concat()).await;
            let printed: Value = serde_json::from_slice(&output.stdout).expect("JSON");
            assert_eq!(printed, said, "{game:?} {options:?}");
        }
    }
    let table = printed(&swarmbench(&["metrics", &file]).await);
    assert!(table.contains("Mean message length") && table.contains("8.0000"), "{table}");
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
    let wrong = printed(&swarmbench(&["metrics", "nothing.jsonl"]).await);
    assert!(wrong.contains("is no file, and no id of an episode"), "{wrong}");
}
