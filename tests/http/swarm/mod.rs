//! Several seats in one call.

mod act;
mod acts;
mod obs;
mod step;

use serde_json::Value;

use crate::app::{Episode, TestApp, list};

async fn look(app: &TestApp, episode: &Episode, query: &str) -> Value {
    app.get(&format!("/swarm/obs{query}")).token(&episode.swarm).ok().await
}

fn agents(looked: &Value) -> Vec<String> {
    let name = |seen: &Value| seen["agent"].as_str().expect("a name").to_owned();
    list(&looked["observations"]).iter().map(name).collect()
}

fn cursor(looked: &Value) -> &str {
    looked["cursor"].as_str().expect("a cursor")
}
