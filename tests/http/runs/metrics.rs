//! Metrics of a run, and of boards.

use serde_json::{Value, json};

use super::{create, play, show, small, text};
use crate::app::{TestApp, list, number};

#[tokio::test]
async fn a_run_has_the_metrics_of_its_games_and_their_means() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    let path = format!("/api/v1/runs/{}/metrics", run.id);
    let none = app.get(&path).ok().await;
    assert_eq!((&none["items"], &none["tasks"]), (&json!([]), &json!({})));
    play(&app, &run).await;
    let all = app.get(&path).ok().await;
    let games = list(&all["items"]);
    let ids = |games: &[Value], field: &str| -> Vec<String> {
        games.iter().map(|game| text(game, field).to_owned()).collect()
    };
    let planned = list(&show(&app, &run).await["games"]);
    assert_eq!(ids(&games, "episode"), ids(&planned, "episode"));
    for game in &games {
        let path = format!("/api/v1/episodes/{}/metrics", text(game, "episode"));
        assert_eq!(&app.get(&path).ok().await, game);
        // All stay.
        assert_eq!(game["values"]["stillness"], json!({ "value": 1.0, "rounds": 2 }));
    }
    let paths = |task: &str| -> Vec<f64> {
        let of = games.iter().filter(|game| game["task"] == task);
        of.map(|game| game["values"]["crowding"]["value"].as_f64().expect("a number")).collect()
    };
    for task in ["Synchronization", "Foraging"] {
        let [a, b] = paths(task)[..] else { panic!("two seeds") };
        let mean = &all["tasks"][task]["crowding"];
        assert_eq!((mean["mean"].as_f64(), number(&mean["games"])), (Some(f64::midpoint(a, b)), 2));
        assert_eq!(all["tasks"][task].get("question_share"), None, "nobody said anything");
    }
    // Page by page.
    let (mut paged, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = app.get(&format!("{path}?limit=3{cursor}")).ok().await;
        paged.extend(list(&page["items"]));
        let Some(next) = page["next_cursor"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    assert_eq!(paged, games);
    for wrong in ["limit=0", "limit=201", "cursor=x", "definition=x"] {
        app.get(&format!("{path}?{wrong}")).problem(400, "malformed").await;
    }
}

#[tokio::test]
async fn a_board_shows_the_metrics_that_are_named() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    play(&app, &run).await;
    let all = app.get(&format!("/api/v1/runs/{}/metrics", run.id)).ok().await;
    let path = "/api/v1/leaderboard?suite=small&metrics=crowding,question_share";
    let board = app.get(path).ok().await;
    assert_eq!(board["metrics"], json!(["crowding", "question_share"]));
    assert_eq!(board["metrics_method"]["embedder"], "hash-1");
    let row = &board["items"][0];
    for task in ["Synchronization", "Foraging"] {
        let expected = all["tasks"][task]["crowding"]["mean"].as_f64().expect("a mean");
        let found = row["metrics"][task]["crowding"].as_f64().expect("a mean");
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        assert_eq!(row["metrics"][task]["question_share"], Value::Null);
    }
    let csv = app.get(&format!("{path}&format=csv")).send().await.text();
    let header = csv.lines().next().expect("a header");
    assert!(header.ends_with("foraging_crowding,foraging_question_share"), "{header}");
    // Without the query the board has none.
    let plain = app.get("/api/v1/leaderboard?suite=small").ok().await;
    assert_eq!((plain.get("metrics"), plain["items"][0].get("metrics")), (None, None));
    for wrong in ["metrics=score", "metrics=", "metrics=stillness,", "metrics=stillness,stillness"]
    {
        let problem = app.get(&format!("/api/v1/leaderboard?suite=small&{wrong}"));
        problem.problem(400, "malformed").await;
    }
    let all = swarmbench_analysis::Metric::ALL.map(swarmbench_analysis::Metric::name);
    let many = all[..17].join(",");
    let path = format!("/api/v1/leaderboard?suite=small&metrics={many}");
    app.get(&path).problem(400, "malformed").await;
}
