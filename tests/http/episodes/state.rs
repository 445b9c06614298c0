//! The states of an episode, round by round.

use serde_json::json;

use super::request;
use crate::app::TestApp;

#[tokio::test]
async fn a_state_of_any_round_is_what_was_published_then() {
    let mut app = TestApp::start().await;
    // More rounds than states are kept on the way.
    let rounds = 270;
    let request = json!({ "task": "Foraging", "seed": 4, "num_agents": 2, "max_round": rounds });
    let episode = app.create(request).await;
    let mut published = vec![app.state(&episode).await];
    for round in 0..rounds {
        let action = ["UP", "RIGHT", "RIGHT", "DOWN", "LEFT", "DOWN", "RIGHT"][round * round % 7];
        app.all_act(&episode, action).await;
        published.push(app.state(&episode).await);
    }
    assert!(published.windows(2).any(|pair| pair[0]["agents"] != pair[1]["agents"]));
    for _ in 0..2 {
        for (round, expected) in published.iter().enumerate() {
            let state = app.get(&episode.path(&format!("/state?round={round}"))).ok().await;
            assert_eq!(&state, expected);
        }
        app.restart().await;
    }
}

#[tokio::test]
async fn a_round_that_has_not_come_is_not_found() {
    let app = TestApp::start().await;
    let episode = app.create(request(1, 2)).await;
    app.all_act(&episode, "UP").await;
    let problem = app.get(&episode.path("/state?round=2")).problem(404, "not_found").await;
    assert_eq!(problem["round"], 1);
    app.get(&episode.path("/state?round=-1")).problem(400, "malformed").await;
}
