//! Runs after a stop, a crash, and a crash between two writes that belong together.

use std::collections::BTreeSet;

use rstest::rstest;
use serde_json::{Value, json};

use super::{
    create, look, play, play_game, seen, send, show, slots, small, stay, stored, text, until, with,
};
use crate::app::{TestApp, list, number};

/// Every game of the plan that counts, and no slot twice.
fn check(shown: &Value) {
    let counted: Vec<_> = list(&shown["games"])
        .iter()
        .filter(|game| game["episode"].is_string() && game["void_reason"].is_null())
        .map(|game| number(&game["slot"]))
        .collect();
    assert_eq!(counted.len(), counted.iter().collect::<BTreeSet<_>>().len(), "{shown}");
}

#[tokio::test]
async fn a_run_goes_on_after_a_stop() {
    let mut app = TestApp::start().await;
    let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
    let first = text(&run.created["games"][0], "episode").to_owned();
    play_game(&app, &run, &first).await;
    until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
    let place = look(&app, &run, "").await;
    let before = show(&app, &run).await;
    app.restart().await;
    assert_eq!(show(&app, &run).await, before);
    // All that waits comes again, whatever the cursor.
    let again = look(&app, &run, &format!("?after={}", text(&place, "cursor"))).await;
    assert_eq!(seen(&again).len(), 4);
    play(&app, &run).await;
    let result = show(&app, &run).await;
    check(&result);
    assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
}

/// After a crash at any moment of a run, what is on the disk is played to the same end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_crash_at_any_moment_leaves_nothing_double_or_forgotten() {
    let app = TestApp::start().await;
    let run = create(&app, with(small(), &json!({ "parallel": 3 }))).await;
    let mut crashes = 0;
    loop {
        let looked = look(&app, &run, "?wait=60").await;
        let over = looked["finished"] == true;
        if !over {
            let acts: Vec<Value> = seen(&looked).iter().take(1).map(stay).collect();
            send(&app, &run, &acts).await;
        }
        let after = app.after_a_crash().await;
        crashes += 1;
        let shown = show(&after, &run).await;
        check(&shown);
        assert!(over || shown["status"] == "running" || crashes > 8, "{shown}");
        play(&after, &run).await;
        let result = show(&after, &run).await;
        check(&result);
        assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
        assert_eq!(stored(&after, "SELECT count(*) FROM results").await, 4);
        if over {
            break;
        }
    }
    assert!(crashes > 16, "{crashes}");
}

/// A crash between the steps that belong together, made by hand.
#[rstest]
#[case::created_but_no_game_opened("DELETE FROM episodes", "running", 2)]
#[case::a_game_has_ended_and_none_was_opened(
    "UPDATE episodes SET status = 'finished', reason = 'rounds_played', ended_at = 1 WHERE slot = 0",
    "running",
    2
)]
#[case::the_run_is_aborted_but_its_games_are_not(
    "UPDATE runs SET status = 'aborted', ended_at = 1",
    "aborted",
    0
)]
#[case::a_game_is_voided_but_has_not_ended(
    "UPDATE episodes SET voided_at = 1, void_reason = 'x' WHERE slot = 0",
    "running",
    2
)]
#[case::the_last_game_has_ended_but_not_the_run(
    "UPDATE episodes SET status = 'finished', reason = 'rounds_played', ended_at = 1",
    "finished",
    0
)]
#[tokio::test]
async fn steps_that_a_crash_interrupted_are_done_at_the_start(
    #[case] change: &'static str,
    #[case] status: &str,
    #[case] running: usize,
) {
    let mut app = TestApp::start().await;
    let mut request = with(small(), &json!({ "parallel": 2 }));
    if status == "finished" {
        request["suite"]["tasks"] = json!(["Synchronization"]);
    }
    let run = create(&app, request).await;
    app.stop().await;
    app.tamper(change).await;
    app.start_again().await;
    let shown = until(&app, &run, |shown| {
        let games = list(&shown["games"]);
        let open = games.iter().filter(|game| game["status"] == "running");
        open.count() == running && shown["status"] == status
    })
    .await;
    check(&shown);
    if status == "running" {
        play(&app, &run).await;
    }
    let result = show(&app, &run).await;
    check(&result);
    assert_eq!(look(&app, &run, "?wait=60").await["finished"], true);
}
