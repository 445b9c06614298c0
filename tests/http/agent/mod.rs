//! Observations and acts of one agent.

mod act;
mod failures;
mod obs;
pub(crate) mod readers;

use serde_json::{Value, json};

use crate::app::{Episode, TestApp};

/// A small episode: two agents that stand on the map for `rounds` rounds.
fn two_agents(rounds: u32) -> Value {
    json!({ "task": "Synchronization", "seed": 5, "num_agents": 2, "max_round": rounds })
}

fn act(round: u64, action: &str) -> Value {
    json!({ "round": round, "action": action })
}

async fn commanded(app: &TestApp) -> Episode {
    app.create(
        json!({ "task": "Foraging", "control": "centralized", "num_agents": 4, "width": 12 }),
    )
    .await
}
