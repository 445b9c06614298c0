//! A new token for a run.

use serde_json::{Value, json};

use super::{TestRun, look, play, small, text, with};
use crate::app::TestApp;

#[tokio::test]
async fn a_client_that_lost_its_token_gets_another() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let call = app.post("/api/v1/runs").token(&owner).json(&small());
    let run = TestRun::of(&call.ok().await);
    look(&app, &run, "").await;
    let fresh = app.post(&run.path("/token")).token(&owner).send().await;
    assert_eq!((fresh.status, fresh.header("cache-control")), (200, "no-store"));
    app.get("/swarm/obs").token(&run.token).problem(401, "unauthorized").await;
    let run = TestRun { token: text(&fresh.json(), "swarm_token").to_owned(), ..run };
    play(&app, &run).await;
    // Also when it is over.
    app.post(&run.path("/token")).token(&owner).ok().await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    app.post(&run.path("/token")).token(&member).problem(403, "forbidden").await;
}

#[tokio::test]
async fn what_the_server_plays_itself_has_no_token() {
    let app = TestApp::start().await;
    let request = with(small(), &json!({ "player": "default" }));
    let created = app.post("/api/v1/runs").json(&request).ok().await;
    assert_eq!((&created["swarm_token"], &created["player"]), (&Value::Null, &json!("default")));
    let path = format!("/api/v1/runs/{}/token", text(&created, "id"));
    app.post(&path).problem(403, "forbidden").await;
}
