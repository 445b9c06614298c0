//! `kill -9` while forks are written in several commits.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::{Value, json};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::replay::verify;
use swarmbench_testkit::dice::{Dice, seed, tell};
use swarmbench_testkit::program::{Server, Site, complaints};

use crate::campaign::audit::check_left_behind;

const KILLS: usize = 12;

/// Rounds of the game that is forked, and its agents.
const ROUNDS: u64 = 60;
const AGENTS: u64 = 12;

/// Forks that are made at once: 23,400 rows in six commits.
const COUNT: usize = 30;

/// Maximum life of a server after it was asked for forks.
const LIFE: Duration = Duration::from_millis(400);

async fn post(server: &Address, path: &str, body: &Value) -> Result<Value, reqwest::Error> {
    let call = server.client.post(format!("{}{path}", server.base)).json(body);
    call.send().await?.error_for_status()?.json().await
}

/// Address of a server.
struct Address {
    client: reqwest::Client,
    base: String,
}

impl Address {
    async fn of(site: &Site, server: &mut Server) -> Self {
        server.ready().await;
        let base = site.door.after(server.run - 1).await.base;
        Self { client: reqwest::Client::new(), base }
    }

    async fn text(&self, path: &str) -> String {
        let answer = self.client.get(format!("{}{path}", self.base)).send().await;
        let answer = answer.and_then(reqwest::Response::error_for_status).expect("an answer");
        answer.text().await.expect("a text")
    }
}

pub(crate) async fn forks_are_there_whole_or_not_at_all() {
    let seed = seed("forks");
    let site = Site::new();
    let mut server = site.start();
    let mut address = Address::of(&site, &mut server).await;
    let parent = played(&address).await;
    let path = format!("/api/v1/episodes/{parent}/fork");
    let body = json!({ "round": ROUNDS, "count": COUNT });
    let (mut acknowledged, mut refused) = (BTreeMap::new(), 0);
    for kill in 0..KILLS {
        let life = Dice::of(seed, &format!("kill {kill}")).time(LIFE);
        match tokio::time::timeout(life, post(&address, &path, &body)).await {
            Ok(made) => {
                let made = made.expect("it is running");
                let ids = made["episodes"].as_array().expect("a list").iter();
                acknowledged.extend(ids.map(|one| (one["id"].to_string(), kill)));
            }
            Err(_) => refused += 1,
        }
        assert_eq!(complaints(&server.kill()), Vec::<&String>::new());
        server = site.start();
        address = Address::of(&site, &mut server).await;
    }
    let listed = address.text(&format!("/api/v1/episodes?fork_of={parent}&limit=1000")).await;
    let listed: Value = serde_json::from_str(&listed).expect("JSON");
    let forks = listed["items"].as_array().expect("a list");
    assert!(forks.len().is_multiple_of(COUNT), "{} forks: a group was torn", forks.len());
    for fork in forks {
        let id = fork["id"].as_str().expect("an id");
        acknowledged.remove(&fork["id"].to_string());
        let journal = address.text(&format!("/api/v1/episodes/{id}/journal")).await;
        let report =
            verify(journal.as_bytes(), None, Solver::Flow, |_, _| ()).expect("it is whole");
        assert_eq!(u64::from(report.rounds), ROUNDS);
    }
    assert_eq!(acknowledged, BTreeMap::new(), "these were acknowledged, and are gone");
    tell(&format!("{KILLS} kills, {refused} before the answer, {} forks", forks.len()));
    let (status, _, log) = server.terminate().await;
    assert_eq!((status.code(), complaints(&log)), (Some(0), Vec::new()));
    check_left_behind(&site).await;
}

/// A game of which all but the last round is played; returns its id.
async fn played(address: &Address) -> String {
    let game = json!({
        "task": "Synchronization", "seed": 1, "num_agents": AGENTS, "max_round": ROUNDS + 1, "memory": 0,
    });
    let created = post(address, "/api/v1/episodes", &game).await.expect("it is created");
    let id = created["id"].as_str().expect("an id").to_owned();
    let swarm = created["swarm_token"].as_str().expect("a token");
    for round in 0..ROUNDS {
        let acts: Vec<Value> = (0..AGENTS)
            .map(|agent| {
                json!({ "episode": id, "agent": format!("Agent_{agent}"), "round": round, "action": "SWITCH" })
            })
            .collect();
        let call = address.client.post(format!("{}/swarm/act", address.base)).bearer_auth(swarm);
        let answer = call.json(&json!({ "acts": acts })).send().await.expect("an answer");
        assert_eq!(answer.status(), 200);
    }
    id
}
