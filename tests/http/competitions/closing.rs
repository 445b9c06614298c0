//! The closing time, to the millisecond.

use std::time::Duration;

use serde_json::{Value, json};

use crate::app::{TestApp, number, texts, until};
use crate::cup::{Attempt, Cup, pass_minutes, server};

/// A cup in which one game of four rounds is open at a time.
async fn started(app: &TestApp) -> (Cup, Attempt) {
    let suite = json!({
        "tasks": ["Synchronization"], "seeds": 2,
        "settings": { "num_agents": 2, "max_round": 4, "view_size": 3 },
    });
    let cup = Cup::open(app, json!({ "suite": suite, "parallel": 1 })).await;
    let blue = cup.enter(app, "blue").await;
    let attempt = cup.start(app, &blue).await;
    (cup, attempt)
}

/// Lets every round but the last run until just before the closing time, at 13:00.
async fn until_closing(app: &TestApp, attempt: &Attempt) {
    // Every round takes its whole clock; those that wait wake every ten seconds.
    attempt.act(app, 0).await;
    app.pass(Duration::from_secs(5));
}

async fn games(app: &TestApp, attempt: &Attempt) -> Vec<(String, u64)> {
    let mut all = attempt.episodes(app).await;
    all.reverse();
    let game = |game: &Value| {
        let reason = game["result"]["reason"].as_str().unwrap_or("running").to_owned();
        (reason, number(&game["round"]))
    };
    all.iter().map(game).collect()
}

#[tokio::test]
async fn the_round_that_runs_may_end_and_no_other_begins() {
    let app = server().await;
    let (cup, attempt) = started(&app).await;
    // 12:10: nobody acts for 49 minutes and 55 seconds, but the clocks would run out. So the attempt is started
    // late instead.
    cup.void(&app, &attempt, "a rehearsal").await;
    app.pass(Duration::from_secs(50 * 60 - 5));
    let (blue, red) = (cup.enter(&app, "late").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    let other = cup.start(&app, &red).await;
    until_one_round(&app, &attempt).await;
    app.pass(Duration::from_millis(4_999));
    assert_eq!(cup.show(&app).await["phase"], "open");
    // A round that is resolved just before is followed by another one, ...
    attempt.act(&app, 4).await;
    assert_eq!(number(&attempt.look(&app).await["observations"][0]["round"]), 2);
    app.pass(Duration::from_millis(1));
    assert_eq!(cup.show(&app).await["phase"], "closing");
    let start = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    start.problem(409, "closed").await;
    // ... which may still be played, and is the last.
    assert_eq!(number(&attempt.look(&app).await["observations"][0]["round"]), 2);
    attempt.act(&app, 4).await;
    let seen = attempt.look(&app).await;
    assert_eq!((&seen["observations"], &seen["finished"]), (&json!([]), &json!(true)));
    assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 3)]);
    // The other one has its clock, to the end: its round began at 12:59:55.
    assert_eq!(cup.show(&app).await["phase"], "closing");
    assert_eq!(games(&app, &other).await, [("running".to_owned(), 0)]);
    app.pass(Duration::from_millis(4_999));
    assert_eq!(games(&app, &other).await, [("running".to_owned(), 0)]);
    app.pass(Duration::from_millis(1));
    cup.closed(&app).await;
    assert_eq!(games(&app, &other).await, [("closed".to_owned(), 1)]);
    // What was played counts, what was not counts as 0.
    let rows = cup.rows(&app, None).await;
    assert_eq!(texts(&rows, "run_status")[..2], ["closed", "closed"]);
    let task = &rows[0]["tasks"][0];
    assert_eq!((&task["games"], &task["planned"]), (&json!(1), &json!(2)));
    assert_eq!(rows[0]["run"], attempt.run.as_str());
}

async fn until_one_round(app: &TestApp, attempt: &Attempt) {
    attempt.act(app, 4).await;
    assert_eq!(number(&attempt.look(app).await["observations"][0]["round"]), 1);
}

#[tokio::test]
async fn a_server_that_was_down_over_the_closing_time_catches_up() {
    let mut app = server().await;
    let (cup, attempt) = started(&app).await;
    attempt.act(&app, 4).await;
    app.stop().await;
    pass_minutes(&app, 100).await;
    app.start_again().await;
    // The round that was open gets its full clock again, and is the last.
    let seen = attempt.look(&app).await;
    assert_eq!(number(&seen["observations"][0]["round"]), 1);
    assert_eq!(cup.show(&app).await["phase"], "closing");
    let blue = app.post(&cup.path("/entrants")).json(&json!({ "name": "x", "model": "m" }));
    blue.problem(409, "closed").await;
    app.pass(Duration::from_secs(10));
    cup.closed(&app).await;
    assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 2)]);
    assert_eq!(cup.rows(&app, None).await[0]["run_status"], "closed");
}

#[tokio::test]
async fn a_crash_in_the_last_round_loses_nothing() {
    let app = server().await;
    let (cup, attempt) = started(&app).await;
    until_closing(&app, &attempt).await;
    pass_minutes(&app, 50).await;
    // By now the clocks of the round that was open have run out, after the closing time.
    let shown = cup.closed(&app).await;
    let again = app.after_a_crash().await;
    assert_eq!(cup.show(&again).await, shown);
    assert_eq!(cup.rows(&again, None).await, cup.rows(&app, None).await);
    assert_eq!(cup.export(&again).await, cup.export(&app).await);
}

#[tokio::test]
async fn the_window_of_an_attempt_closes_as_the_competition_does() {
    let app = server().await;
    let windows = json!([{ "closes_at": "2026-03-01T12:20:00Z" }]);
    let suite = json!({ "tasks": ["Synchronization"], "seeds": 2,
        "settings": { "num_agents": 2, "max_round": 4, "view_size": 3 } });
    let change = json!({ "attempts": windows, "suite": suite, "parallel": 1 });
    let cup = Cup::open(&app, change).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    app.pass(Duration::from_mins(10));
    // The clock of the first round has run out, after the closing time.
    until("it ends", async || attempt.look(&app).await["finished"] == true).await;
    assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 1)]);
    let own = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(own["items"][0]["status"], "closed");
    // Its seeds are still sealed.
    assert_eq!(cup.show(&app).await["seeds"], Value::Null);
}
