//! The page of one episode.

use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::{TestApp, number};

#[tokio::test]
async fn an_episode_is_shown_as_it_stands() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request(2, 2)).await;
    assert_eq!(
        app.show(&episode).await,
        json!({
            "id": episode.id, "status": "running", "task": "Synchronization", "model": "unnamed",
            "round": 0, "score": 0.0, "created_at": "2026-03-01T12:00:00.000Z", "ended_at": null,
            "result": null, "config": episode.config, "run": null, "void_reason": null, "fork": null,
            "people": false, "mixed": false,
        })
    );
    app.pass(std::time::Duration::from_millis(1500));
    finish(&app, &episode).await;
    let shown = app.show(&episode).await;
    assert_eq!((&shown["status"], number(&shown["round"])), (&json!("finished"), 2));
    assert_eq!(shown["ended_at"], "2026-03-01T12:00:01.500Z");
    assert_eq!(shown["result"]["rounds"], 2);
    assert_eq!(shown["result"]["score"], shown["score"]);
}

#[tokio::test]
async fn a_player_does_not_learn_the_seed_before_the_end() {
    let app = TestApp::start().await;
    let episode = app.create(with(request(1, 1), "visibility", json!("owner"))).await;
    let seed = || async {
        let shown = app.get(&episode.path("")).token(episode.seat(0)).ok().await;
        shown["config"]["seed"].clone()
    };
    assert_eq!(seed().await, Value::Null);
    assert_eq!(app.show(&episode).await["config"]["seed"], 9);
    finish(&app, &episode).await;
    assert_eq!(seed().await, 9);
}
