//! Leaderboards and cross-play.

mod cross_play;
mod leaderboard;
mod played;

use serde_json::{Value, json};

use self::played::{Did, Offline, definition};
use crate::app::{HttpAnswer, TestApp, list};

const BOARD: &str = "/api/v1/leaderboard";

async fn board(app: &TestApp, query: &str) -> Value {
    app.get(&format!("{BOARD}?{query}")).ok().await
}

async fn csv(app: &TestApp, query: &str) -> HttpAnswer {
    let answer = app.get(&format!("{BOARD}?{query}")).header("accept", "text/csv").send().await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "text/csv; charset=utf-8");
    answer
}

/// The records of a table, each with its columns by name.
fn records(answer: &HttpAnswer) -> Vec<std::collections::BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_reader(&answer.body[..]);
    reader.deserialize().map(|record| record.expect("well-formed CSV")).collect()
}

/// One field of all rows.
fn column(board: &Value, field: &str) -> Vec<Value> {
    list(&board["items"])
        .iter()
        .map(|row| row.pointer(field).cloned().unwrap_or(Value::Null))
        .collect()
}

/// A server with an organizer, `alice` and `bob`, over which runs were played: `small` is five games of
/// Synchronization with one agent, whose light scores as often as it changes.
async fn played() -> TestApp {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    app.key(json!({ "name": "alice" })).await;
    app.key(json!({ "name": "=bob" })).await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    let alice = offline.owner("alice").await;
    let bob = offline.owner("=bob").await;
    let organizer = offline.owner("the organizer").await;
    // The paper's own example.
    let scores = [9, 10, 10, 10, 9].map(Did::Scored);
    offline.run(definition("steady", 5), alice, &scores, "finished").await;
    // A worse run of the same player, later.
    let scores = [1, 2, 3, 4, 5].map(Did::Scored);
    offline.run(definition("steady", 5), alice, &scores, "finished").await;
    // Two with the same total; one of them had invalid answers and clocks that ran out.
    let scores = [8, 8, 7, 7, 7].map(Did::Scored);
    offline.run(definition("equal", 5), organizer, &scores, "finished").await;
    let scores = [
        Did::Scored(10),
        Did::Scored(9),
        Did::Scored(9),
        Did::Wrong { score: 5, invalid: 3, late: 2 },
        Did::Scored(4),
    ];
    offline.run(definition("equal too", 5), bob, &scores, "finished").await;
    // Broken off: a game to its end, one aborted with what it had, one broken by the host, two never begun.
    let games = [Did::Scored(10), Did::Aborted(6), Did::Voided(9), Did::NotBegun, Did::NotBegun];
    offline.run(definition("broken off", 5), bob, &games, "aborted").await;
    // Not over yet, so not on the board.
    offline.open_run(definition("going on", 5), alice, &[Did::Scored(10)]).await;
    offline.close().await;
    app.start_again().await;
    app
}
