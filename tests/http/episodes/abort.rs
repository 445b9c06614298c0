//! Episodes are aborted by their creators.

use serde_json::json;

use super::{finish, request, with};
use crate::app::{TestApp, number, verified};

#[tokio::test]
async fn an_aborted_episode_keeps_what_was_played() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 5)).await;
    app.all_act(&episode, "SWITCH").await;
    app.act(episode.seat(1), &json!({ "round": 1, "action": "UP" })).await;
    let aborted = app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    assert_eq!((&aborted["status"], number(&aborted["round"])), (&json!("aborted"), 1));
    assert_eq!(aborted["result"]["reason"], "aborted");
    // A second time changes nothing.
    assert_eq!(app.delete(&episode.path("")).token(&episode.swarm).ok().await, aborted);
    let act = json!({ "round": 1, "action": "STAY" });
    app.post("/act").token(episode.seat(0)).json(&act).problem(409, "episode_over").await;
    let report = verified(&app.journal(&episode).await);
    let end = report.end.expect("an end");
    assert_eq!((end.status.as_str(), end.rounds), ("aborted", 1));
    let left: Vec<_> = end.open_acts.iter().map(|act| act.agent.as_str()).collect();
    assert_eq!(left, ["Agent_1"]);
}

#[tokio::test]
async fn an_episode_that_has_ended_is_neither_aborted_nor_started() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 1)).await;
    finish(&app, &episode).await;
    let before = app.show(&episode).await;
    let abort = app.delete(&episode.path("")).token(&episode.swarm);
    assert_eq!(abort.problem(409, "episode_over").await["round"], 1);
    let start = app.post(&episode.path("/start")).token(&episode.swarm);
    assert_eq!(start.problem(409, "episode_over").await["round"], 1);
    assert_eq!(app.show(&episode).await, before);
}

#[tokio::test]
async fn a_waiting_episode_can_be_aborted() {
    let app = TestApp::start().await;
    let episode = app.create(with(request(2, 1), "start", json!("manual"))).await;
    let aborted = app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    assert_eq!((&aborted["status"], number(&aborted["round"])), (&json!("aborted"), 0));
    verified(&app.journal(&episode).await);
}

#[tokio::test]
async fn only_the_creator_starts_and_aborts() {
    let app = TestApp::start().await;
    let stranger = app.create(request(1, 1)).await;
    let request = with(with(request(1, 1), "visibility", json!("owner")), "start", json!("manual"));
    let episode = app.create(request).await;
    let calls = || [app.delete(&episode.path("")), app.post(&episode.path("/start"))];
    for call in calls() {
        call.problem(404, "not_found").await;
    }
    for call in calls() {
        call.token(&stranger.swarm).problem(404, "not_found").await;
    }
    for call in calls() {
        call.token(episode.seat(0)).problem(403, "forbidden").await;
    }
    assert_eq!(app.show(&episode).await["status"], "waiting");
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    app.delete(&episode.path("")).token(&episode.swarm).ok().await;
}

#[tokio::test]
async fn a_token_of_another_episode_aborts_no_public_one() {
    let app = TestApp::start().await;
    let (one, other) = (app.create(request(1, 1)).await, app.create(request(1, 1)).await);
    app.delete(&one.path("")).token(&other.swarm).problem(403, "forbidden").await;
    app.delete(&one.path("")).token(other.seat(0)).problem(403, "forbidden").await;
    assert_eq!(app.show(&one).await["status"], "running");
}
