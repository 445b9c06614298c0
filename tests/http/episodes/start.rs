//! Episodes that wait for a manual start.

use serde_json::json;

use super::{finish, request, with};
use crate::app::{TestApp, number};

#[tokio::test]
async fn a_manual_episode_waits_for_its_start() {
    let mut app = TestApp::start().await;
    let episode = app.create(with(request(2, 1), "start", json!("manual"))).await;
    let act = json!({ "round": 0, "action": "SWITCH" });
    for _ in 0..2 {
        assert_eq!(app.show(&episode).await["status"], "waiting");
        let seen = app.obs(episode.seat(0)).await;
        assert_eq!((&seen["status"], number(&seen["round"])), (&json!("waiting"), 0));
        app.post("/act").token(episode.seat(0)).json(&act).problem(409, "round_ahead").await;
        app.restart().await;
    }
    for _ in 0..2 {
        let started = app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
        assert_eq!(started["status"], "running");
        // Starting it again changes nothing.
        app.act(episode.seat(0), &act).await;
    }
    app.restart().await;
    assert_eq!(app.show(&episode).await["status"], "running");
    assert_eq!(app.obs(episode.seat(0)).await["acted"], true);
    finish(&app, &episode).await;
    let shown = app.show(&episode).await;
    assert_eq!(shown["result"]["reason"], "rounds_played");
}

/// A layout that solves the task leaves nothing to act in; its creator sees that at once.
#[tokio::test]
async fn a_manual_start_of_a_solved_layout_is_its_end() {
    let app = TestApp::start().await;
    let solved = json!({ "task": "Flocking", "rules": "reference", "seed": 578, "num_agents": 3,
        "start": "manual" });
    let episode = app.create(solved).await;
    assert_eq!(app.show(&episode).await["status"], "waiting");
    let started = app.post(&episode.path("/start")).ok().await;
    assert_eq!(
        (&started["status"], &started["result"]["reason"]),
        (&json!("finished"), &json!("task_done"))
    );
}
