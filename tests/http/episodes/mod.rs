//! `/api/v1/episodes`.

mod abort;
mod agent;
mod create;
mod events;
mod fork;
mod journal;
mod list;
mod metrics;
mod replay;
mod scores;
mod show;
mod solved;
mod start;
mod state;
mod verification;
mod visibility;
mod void;
mod worth;

use serde_json::{Value, json};

use crate::app::{Episode, TestApp};

fn request(agents: u32, rounds: u32) -> Value {
    json!({ "task": "Synchronization", "seed": 9, "num_agents": agents, "max_round": rounds })
}

fn with(mut request: Value, field: &str, value: Value) -> Value {
    request[field] = value;
    request
}

async fn finish(app: &TestApp, episode: &Episode) {
    while app.show(episode).await["status"] == "running" {
        app.all_act(episode, "SWITCH").await;
    }
}
