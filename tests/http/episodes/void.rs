//! Episodes are voided by organizers.

use serde_json::json;

use crate::app::{TestApp, fields};

#[tokio::test]
async fn an_episode_without_a_run_is_voided_too() {
    let app = TestApp::builder().keys().start().await;
    let episode = app.create_with(&app.organizer, json!({ "task": "Foraging" })).await;
    let call = app.post(&episode.path("/void")).token(&app.organizer);
    let voided = call.json(&json!({ "reason": "power cut" })).ok().await;
    assert_eq!(
        (&voided["status"], &voided["void_reason"]),
        (&json!("aborted"), &json!("power cut"))
    );
    let call = app.post(&episode.path("/void")).token(&app.organizer);
    let problem = call.json(&json!({ "reason": "" })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["reason"]);
    let call = app.post("/api/v1/episodes/ep_0/void").token(&app.organizer);
    call.json(&json!({ "reason": "x" })).problem(404, "not_found").await;
}
