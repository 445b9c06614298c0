//! An episode, as its creator and its players use it.

use serde_json::{Value, json};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::replay::{JournalReport, verify};

use super::{TestApp, list};

/// A game of Synchronization, whose seed the server draws.
pub(crate) fn game(agents: u32, rounds: u32) -> Value {
    json!({ "task": "Synchronization", "num_agents": agents, "max_round": rounds })
}

/// An episode as it was created.
#[derive(Clone, Debug)]
pub(crate) struct Episode {
    pub(crate) id: String,
    pub(crate) swarm: String,
    pub(crate) config: Value,
    /// The tokens of the agents, in order.
    seats: Vec<String>,
}

impl Episode {
    pub(crate) fn of(created: &Value) -> Self {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let seats = list(&created["seats"]);
        for (number, seat) in seats.iter().enumerate() {
            assert_eq!(seat["agent"], format!("Agent_{number}"));
        }
        Self {
            id: text(&created["id"]),
            swarm: text(&created["swarm_token"]),
            config: created["config"].clone(),
            seats: seats.iter().map(|seat| text(&seat["token"])).collect(),
        }
    }

    /// The token of an agent.
    pub(crate) fn seat(&self, number: usize) -> &str {
        &self.seats[number]
    }

    pub(crate) fn seats(&self) -> impl Iterator<Item = &str> {
        self.seats.iter().map(String::as_str)
    }

    pub(crate) fn path(&self, rest: &str) -> String {
        format!("/api/v1/episodes/{}{rest}", self.id)
    }

    /// An act for one of several seats.
    pub(crate) fn act(&self, agent: &Value, round: u64, action: &str) -> Value {
        json!({ "episode": self.id, "agent": agent, "round": round, "action": action })
    }
}

impl TestApp {
    pub(crate) async fn create(&self, request: Value) -> Episode {
        Episode::of(&self.post("/api/v1/episodes").json(&request).ok().await)
    }

    /// The current observation of a seat.
    pub(crate) async fn obs(&self, token: &str) -> Value {
        self.get("/obs").token(token).ok().await
    }

    /// The observation of a seat once the round is past `round`.
    pub(crate) async fn obs_after(&self, token: &str, round: u64) -> Value {
        let seen = self.get(&format!("/obs?after={round}&wait=60")).token(token).ok().await;
        assert!(seen["round"].as_u64() > Some(round) || seen["result"].is_object(), "{seen}");
        seen
    }

    /// Acts for a seat.
    pub(crate) async fn act(&self, token: &str, act: &Value) -> Value {
        self.post("/act").token(token).json(act).ok().await
    }

    /// The observations that wait for an act.
    pub(crate) async fn swarm_obs(&self, episode: &Episode) -> Vec<Value> {
        list(&self.get("/swarm/obs?limit=1024").token(&episode.swarm).ok().await["observations"])
    }

    /// Acts for several seats.
    pub(crate) async fn swarm_act(&self, episode: &Episode, acts: &[Value]) -> Vec<Value> {
        let body = json!({ "acts": acts });
        list(&self.post("/swarm/act").token(&episode.swarm).json(&body).ok().await["receipts"])
    }

    /// All seats that wait for an act do the same; returns the round that they answered.
    pub(crate) async fn all_act(&self, episode: &Episode, action: &str) -> u64 {
        let seen = self.swarm_obs(episode).await;
        let round = seen.first().expect("a seat that waits")["round"].as_u64().expect("a number");
        let act = |seen: &Value| episode.act(&seen["agent"], round, action);
        let acts: Vec<Value> = seen.iter().map(act).collect();
        for receipt in self.swarm_act(episode, &acts).await {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
        round
    }

    pub(crate) async fn show(&self, episode: &Episode) -> Value {
        self.get(&episode.path("")).token(&episode.swarm).ok().await
    }

    pub(crate) async fn state(&self, episode: &Episode) -> Value {
        self.get(&episode.path("/state")).token(&episode.swarm).ok().await
    }

    pub(crate) async fn journal(&self, episode: &Episode) -> String {
        let answer = self.get(&episode.path("/journal")).token(&episode.swarm).send().await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.text()
    }
}

/// Report of the verification of a sound episode's journal.
pub(crate) fn verified(journal: &str) -> JournalReport {
    verify(journal.as_bytes(), None, Solver::Flow, |_, _| ()).expect("it plays again")
}
