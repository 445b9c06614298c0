//! Runs are created, and a creation is repeated by its idempotency key.

use rstest::rstest;
use serde_json::{Value, json};

use super::{TestRun, look, seen, small, with};
use crate::app::{TestApp, fields, list};

#[rstest]
#[case(json!({ "suite": null }), &["suite"])]
#[case(json!({ "suite": "long" }), &["suite"])]
#[case(json!({ "suite": 3 }), &["suite"])]
#[case(json!({ "suite": {} }), &["suite"])]
#[case(json!({ "suite": { "name": "x", "seeds": [1], "speed": 2 } }), &["suite"])]
#[case(json!({ "suite": { "name": "quick", "seeds": [1] } }), &["suite.name"])]
#[case(json!({ "suite": { "name": "", "seeds": [] } }), &["suite.name", "suite.seeds"])]
#[case(json!({ "suite": { "name": "x", "seeds": [1, 1] } }), &["suite.seeds"])]
#[case(json!({ "suite": { "name": "x", "seeds": [-1] } }), &["suite.seeds"])]
#[case(json!({ "suite": { "name": "x", "seeds": [9_007_199_254_740_992_i64] } }), &["suite.seeds"])]
#[case(json!({ "suite": { "name": "x", "seeds": [1], "tasks": ["Chess"] } }), &["suite.tasks"])]
#[case(json!({ "suite": { "name": "x", "seeds": [1], "tasks": [] } }), &["suite.tasks"])]
#[case(
    json!({ "suite": { "name": "x", "seeds": (0..300).collect::<Vec<_>>() } }),
    &["suite"]
)]
#[case(
    json!({ "suite": { "name": "x", "seeds": [1], "settings": { "width": 3, "noise": 2 } } }),
    &["suite.settings.width", "suite.settings.noise"]
)]
#[case(json!({ "rules": "chess" }), &["rules"])]
#[case(json!({ "model": null }), &["model"])]
#[case(json!({ "model": "a\nb", "temperature": -1, "top_p": 2 }), &["model", "temperature", "top_p"])]
#[case(json!({ "parallel": 0 }), &["parallel"])]
#[case(json!({ "parallel": 65 }), &["parallel"])]
#[case(json!({ "player": "chess-master" }), &["player", "player"])]
#[case(json!({ "player": "round-clock" }), &["player"])]
#[case(json!({ "visibility": "sealed" }), &["visibility"])]
#[case(json!({ "prompt_template": "{% for x in y %}" }), &["prompt_template"])]
#[case(json!({ "idle_timeout_s": 0, "bank_s": -1 }), &["bank_s", "idle_timeout_s"])]
#[case(json!({ "agent_meta": { "x": "y".repeat(20_000) } }), &["agent_meta"])]
#[case(json!({ "seed": 3 }), &["seed"])]
#[tokio::test]
async fn what_cannot_be_played_is_refused_by_name(#[case] more: Value, #[case] named: &[&str]) {
    let app = TestApp::start().await;
    let call = app.post("/api/v1/runs").json(&with(small(), &more));
    let problem = call.problem(422, "invalid").await;
    assert_eq!(fields(&problem), named, "{problem}");
    assert_eq!(app.get("/api/v1/runs").ok().await["items"], json!([]));
    assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
}

#[tokio::test]
async fn a_repeated_creation_gives_the_same_run_and_a_new_token() {
    let app = TestApp::start().await;
    let call = || app.post("/api/v1/runs").header("Idempotency-Key", "once");
    let first = TestRun::of(&call().json(&small()).ok().await);
    look(&app, &first, "").await;
    let again = TestRun::of(&call().json(&small()).ok().await);
    assert_eq!(again.id, first.id);
    app.get("/swarm/obs").token(&first.token).problem(401, "unauthorized").await;
    assert_eq!(seen(&look(&app, &again, "").await).len(), 8);
    call().json(&with(small(), &json!({ "model": "another" }))).problem(422, "invalid").await;
    assert_eq!(list(&app.get("/api/v1/runs").ok().await["items"]).len(), 1);
    assert_eq!(list(&app.get("/api/v1/episodes").ok().await["items"]).len(), 4);
}
