//! Attempts are voided.

use std::collections::BTreeSet;

use serde_json::json;

use crate::app::{fields, number};
use crate::cup::{Attempt, Cup, server};

#[tokio::test]
async fn a_voided_attempt_may_be_played_again_on_the_same_seeds() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "attempts": 1, "parallel": 4 })).await;
    let blue = cup.enter(&app, "blue").await;
    let broken = cup.start(&app, &blue).await;
    broken.act(&app, 4).await;
    let voided = cup.void(&app, &broken, "a power cut").await;
    assert_eq!((&voided["status"], &voided["voided"]), (&json!("aborted"), &json!("a power cut")));
    // The first reason stays.
    assert_eq!(cup.void(&app, &broken, "something else").await["voided"], "a power cut");
    let again = cup.start(&app, &blue).await;
    assert_eq!((again.number, again.run == broken.run), (1, false));
    let seeds = async |attempt: &Attempt| -> BTreeSet<u64> {
        let episodes = attempt.episodes(&app).await;
        episodes.iter().map(|episode| number(&episode["config"]["seed"])).collect()
    };
    assert_eq!(seeds(&again).await, seeds(&broken).await);
    again.play(&app, 4).await;
    let rows = cup.rows(&app, None).await;
    assert_eq!((&rows[0]["attempts"], &rows[0]["voided_attempts"]), (&json!(1), &json!(1)));
    assert_eq!(rows[0]["run"], again.run.as_str());
    let call = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    call.problem(409, "closed").await;
    let path = cup.path("/attempts/run_0/void");
    let call = app.post(&path).token(&app.organizer).json(&json!({ "reason": "x" }));
    call.problem(404, "not_found").await;
    let path = cup.path(&format!("/attempts/{}/void", again.run));
    let call = app.post(&path).token(&app.organizer).json(&json!({ "reason": "" }));
    assert_eq!(fields(&call.problem(422, "invalid").await), ["reason"]);
    let call = app.post(&path).token(&blue.key).json(&json!({ "reason": "mine" }));
    call.problem(403, "forbidden").await;
}
