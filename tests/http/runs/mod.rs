//! Runs: suites of games for one model, with one token.

mod abort;
mod create;
mod events;
mod failures;
mod list;
mod metrics;
mod play;
mod restart;
mod scores;
mod show;
mod suites;
mod team;
mod token;
mod void;

use serde_json::{Value, json};

use crate::app::{TestApp, list, number};

/// Two tasks on two seeds, for two agents and two rounds: four games.
fn small() -> Value {
    json!({
        "suite": {
            "name": "small", "tasks": ["Synchronization", "Foraging"], "seeds": [4, 9],
            "settings": { "num_agents": 2, "max_round": 2 },
        },
        "model": "a model",
    })
}

fn with(mut request: Value, more: &Value) -> Value {
    for (field, value) in more.as_object().expect("an object") {
        request[field] = value.clone();
    }
    request
}

/// A run as it was created.
#[derive(Clone, Debug)]
struct TestRun {
    id: String,
    token: String,
    created: Value,
}

impl TestRun {
    fn of(created: &Value) -> Self {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        Self {
            id: text(&created["id"]),
            token: text(&created["swarm_token"]),
            created: created.clone(),
        }
    }

    fn path(&self, rest: &str) -> String {
        format!("/api/v1/runs/{}{rest}", self.id)
    }
}

async fn create(app: &TestApp, request: Value) -> TestRun {
    TestRun::of(&app.post("/api/v1/runs").json(&request).ok().await)
}

async fn show(app: &TestApp, run: &TestRun) -> Value {
    app.get(&run.path("")).token(&run.token).ok().await
}

async fn look(app: &TestApp, run: &TestRun, query: &str) -> Value {
    app.get(&format!("/swarm/obs{query}")).token(&run.token).ok().await
}

async fn send(app: &TestApp, run: &TestRun, acts: &[Value]) -> Vec<Value> {
    let call = app.post("/swarm/act").token(&run.token).json(&json!({ "acts": acts }));
    list(&call.ok().await["receipts"])
}

fn seen(looked: &Value) -> Vec<Value> {
    list(&looked["observations"])
}

fn text<'a>(value: &'a Value, field: &str) -> &'a str {
    value[field].as_str().unwrap_or_else(|| panic!("{field} is no text: {value}"))
}

/// The act of a seat that only stays where it is.
fn stay(observation: &Value) -> Value {
    json!({
        "episode": observation["episode"], "agent": observation["agent"],
        "round": observation["round"], "action": "STAY",
    })
}

/// The games of a run that have this status, by their slots.
fn slots(shown: &Value, status: &str) -> Vec<u64> {
    let games = list(&shown["games"]);
    games.iter().filter(|game| game["status"] == status).map(|game| number(&game["slot"])).collect()
}

/// Plays all that waits until the run is over; returns which seats of which rounds were shown, each once.
async fn play(app: &TestApp, run: &TestRun) -> Vec<(String, String, u64)> {
    let mut shown = Vec::new();
    let mut place = String::new();
    loop {
        let looked = look(app, run, &format!("?wait=60{place}")).await;
        if looked["finished"] == true {
            assert!(seen(&looked).is_empty());
            return shown;
        }
        let acts: Vec<Value> = seen(&looked).iter().map(stay).collect();
        assert!(!acts.is_empty(), "it waited for nothing: {looked}");
        for receipt in send(app, run, &acts).await {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
        shown.extend(seen(&looked).iter().map(|seen| {
            (
                text(seen, "episode").to_owned(),
                text(seen, "agent").to_owned(),
                number(&seen["round"]),
            )
        }));
        place = format!("&after={}", text(&looked, "cursor"));
    }
}

/// Plays the open rounds of one game until it has ended.
async fn play_game(app: &TestApp, run: &TestRun, episode: &str) {
    loop {
        let looked = look(app, run, "?limit=1024").await;
        let acts: Vec<Value> =
            (seen(&looked).iter()).filter(|seen| seen["episode"] == episode).map(stay).collect();
        if acts.is_empty() {
            return;
        }
        send(app, run, &acts).await;
    }
}

/// Asks until `is` holds for the run.
async fn until(app: &TestApp, run: &TestRun, is: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..10_000 {
        let shown = show(app, run).await;
        if is(&shown) {
            return shown;
        }
    }
    panic!("it does not come: {}", show(app, run).await);
}

/// The number that a query finds in the database.
async fn stored(app: &TestApp, query: &'static str) -> i64 {
    app.count(query).await
}
