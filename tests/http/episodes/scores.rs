//! The score of an episode in equal steps.

use serde_json::{Value, json};

use super::request;
use crate::app::TestApp;

#[tokio::test]
async fn scores_are_those_of_the_states() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 7)).await;
    let none = app.get(&episode.path("/scores")).ok().await;
    assert_eq!((&none["scores"], &none["every"]), (&json!([0.0]), &json!(1)));
    for _ in 0..7 {
        app.all_act(&episode, "SWITCH").await;
    }
    let mut scores = Vec::new();
    for round in 0..=7 {
        scores.push(
            app.get(&episode.path(&format!("/state?round={round}"))).ok().await["score"].take(),
        );
    }
    assert_ne!(scores[0], scores[7]);
    let all = app.get(&episode.path("/scores")).ok().await;
    assert_eq!((&all["scores"], &all["rounds"]), (&json!(scores), &json!(7)));
    let some = app.get(&episode.path("/scores?points=3")).ok().await;
    let expected: Vec<&Value> = [0, 3, 6, 7].map(|round| &scores[round]).into();
    assert_eq!((&some["every"], &some["scores"]), (&json!(3), &json!(expected)));
    for points in ["0", "1001"] {
        let path = episode.path(&format!("/scores?points={points}"));
        let problem = app.get(&path).problem(400, "malformed").await;
        assert_eq!(problem["limit"]["name"], "page_items_max");
    }
}
