//! Runs are aborted by their owners.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::{Value, json};

use super::{create, look, play, play_game, send, show, slots, small, text, until, with};
use crate::app::{TestApp, check_problem};

#[tokio::test]
async fn an_aborted_run_has_what_it_has() {
    let app = TestApp::with_manual_clock().await;
    let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
    let first = text(&run.created["games"][0], "episode").to_owned();
    play_game(&app, &run, &first).await;
    let before = until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
    assert_eq!((&before["status"], &before["played"]), (&json!("running"), &json!(1)));
    // Before the end the means are of what has ended.
    assert_eq!(before["tasks"][0]["mean"], before["games"][0]["score"]);
    assert_eq!(before["tasks"][1]["mean"], Value::Null);

    // Both open games are seen; the next event of them is their end.
    let seen = |place: &Value| {
        let all = place["observations"].as_array().expect("observations").iter();
        all.map(|seen| text(seen, "episode").to_owned()).collect::<BTreeSet<_>>().len()
    };
    let mut place = look(&app, &run, "").await;
    while seen(&place) < 2 {
        place = look(&app, &run, "").await;
    }
    let place = format!("?wait=60&after={}", text(&place, "cursor"));
    let abort = app.delete(&run.path("")).token(&run.token);
    let (looked, aborted) = tokio::join!(look(&app, &run, &place), abort.ok());
    assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(true)));
    assert_eq!(aborted["status"], "aborted");
    assert_eq!(slots(&aborted, "aborted"), [1, 2]);
    assert_eq!(slots(&aborted, "planned"), [3]);
    assert_eq!((&aborted["played"], &aborted["planned"]), (&json!(3), &json!(4)));
    // What was never played counts as 0.
    assert_eq!(aborted["tasks"][1]["mean"], 0.0);
    assert_eq!(aborted["total"], aborted["tasks"][0]["mean"]);
    let act = json!({
        "episode": aborted["games"][1]["episode"], "agent": "Agent_0", "round": 0, "action": "UP",
    });
    check_problem(&send(&app, &run, &[act]).await[0], 409, "episode_over");

    // Once more changes nothing, and neither does time.
    assert_eq!(app.delete(&run.path("")).token(&run.token).ok().await, aborted);
    app.pass(Duration::from_secs(200_000));
    assert_eq!(show(&app, &run).await, aborted);
}

#[tokio::test]
async fn a_finished_run_is_not_aborted() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    play(&app, &run).await;
    app.delete(&run.path("")).token(&run.token).problem(409, "episode_over").await;
    assert_eq!(show(&app, &run).await["status"], "finished");
}
