//! Games whose layout has solved the task: nobody can act in them.

use futures::future::join_all;
use serde_json::{Value, json};
use swarmbench_testkit::needs;

use crate::app::{Episode, TestApp, fields, list, verified};

/// From now on the database refuses ends.
const REFUSE: &str = "CREATE TRIGGER refuse BEFORE UPDATE ON episodes WHEN NEW.status = 'finished'
    BEGIN SELECT raise(ABORT, 'refused by a test'); END";

/// Three agents of Flocking.
fn solved(more: &Value) -> Value {
    let mut request =
        json!({ "task": "Flocking", "rules": "reference", "seed": 571, "num_agents": 3 });
    for (field, value) in more.as_object().expect("fields") {
        request[field] = value.clone();
    }
    request
}

/// Whoever looks at it first sees its end.
async fn is_over(app: &TestApp, episode: &Episode) {
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!((&seen["status"], &seen["result"]["rounds"]), (&json!("finished"), &json!(0)));
    let all = app.get("/swarm/obs?wait=60").token(&episode.swarm).ok().await;
    assert_eq!((&all["finished"], &all["observations"]), (&json!(true), &json!([])));
    let shown = app.show(episode).await;
    assert_eq!((&shown["status"], &shown["result"]), (&json!("finished"), &seen["result"]));
    assert_eq!(shown["result"]["reason"], "task_done");
    let act = json!({ "round": 0, "action": "STAY" });
    app.post("/act").token(episode.seat(0)).json(&act).problem(409, "episode_over").await;
    let report = verified(&app.journal(episode).await);
    assert_eq!(
        (report.rounds, report.head.to_string()),
        (0, text(&shown["result"]["journal_head"]))
    );
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

#[tokio::test]
async fn a_game_that_is_solved_already_ends_with_its_creation() {
    let mut app = TestApp::start().await;
    let mut episodes = Vec::new();
    for more in [
        json!({}),
        json!({ "round_deadline_s": 0.05, "bank_s": 1 }),
        json!({ "visibility": "owner", "prompt_template": "x" }),
        json!({ "control": "centralized", "model": "m" }),
    ] {
        let created = app.post("/api/v1/episodes").json(&solved(&more)).ok().await;
        assert_eq!(created["status"], "finished", "{more}");
        let episode = Episode::of(&created);
        is_over(&app, &episode).await;
        episodes.push(episode);
    }
    // Many at once: each ends with its own creation.
    for episode in join_all((0..16).map(|_| app.create(solved(&json!({}))))).await {
        is_over(&app, &episode).await;
        episodes.push(episode);
    }
    app.restart().await;
    for episode in &episodes {
        is_over(&app, episode).await;
    }
}

#[tokio::test]
async fn the_start_and_the_last_claim_of_a_solved_game_are_its_end() {
    let app = TestApp::start().await;
    let episode = app.create(solved(&json!({ "start": "manual" }))).await;
    assert_eq!(app.show(&episode).await["status"], "waiting");
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    is_over(&app, &episode).await;

    let episode = app.create(solved(&json!({ "open_seats": 1 }))).await;
    assert_eq!(app.show(&episode).await["status"], "waiting");
    app.post(&episode.path("/claims")).json(&json!({ "seats": 1 })).ok().await;
    is_over(&app, &episode).await;
}

#[tokio::test]
async fn the_server_plays_nothing_in_a_solved_game() {
    let app = TestApp::start().await;
    let request = solved(&json!({ "player": "default" }));
    let created = app.post("/api/v1/episodes").json(&request).ok().await;
    assert_eq!(created["status"], "finished");
    let path = format!("/api/v1/episodes/{}/fork", text(&created["id"]));
    let problem = app.post(&path).json(&json!({ "round": 0 })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["round"]);
}

#[tokio::test]
async fn a_run_goes_on_over_games_that_are_solved_already() {
    let app = TestApp::start().await;
    let suite = json!({
        "name": "solved", "tasks": ["Flocking", "Synchronization"], "seeds": [571, 578],
        "settings": { "num_agents": 3, "max_round": 1 },
    });
    let request = json!({ "suite": suite, "rules": "reference", "model": "m", "parallel": 1 });
    let run = app.post("/api/v1/runs").json(&request).ok().await;
    let (id, token) = (text(&run["id"]), text(&run["swarm_token"]));
    let look = async |after: String| {
        app.get(&format!("/swarm/obs?wait=60{after}")).token(&token).ok().await
    };
    let mut looked = look(String::new()).await;
    while looked["finished"] != true {
        let act = |seen: &Value| json!({ "episode": seen["episode"], "agent": seen["agent"], "round": 0, "action": "STAY" });
        let acts: Vec<Value> = list(&looked["observations"]).iter().map(act).collect();
        assert_eq!(acts.len(), 3, "{looked}");
        app.post("/swarm/act").token(&token).json(&json!({ "acts": acts })).ok().await;
        looked = look(format!("&after={}", text(&looked["cursor"]))).await;
    }
    let shown = app.get(&format!("/api/v1/runs/{id}")).token(&token).ok().await;
    let games = list(&shown["games"]);
    let rounds: Vec<_> = games.iter().map(|game| game["round"].clone()).collect();
    assert_eq!(
        (&shown["status"], rounds),
        (&json!("finished"), [0, 0, 1, 1].map(Value::from).to_vec())
    );
}

/// The end of the episode is in the commit that creates it: the server may be killed at any time.
#[needs(sqlite)]
#[tokio::test]
async fn what_creates_a_solved_game_ends_it() {
    let app = TestApp::start().await;
    app.tamper(REFUSE).await;
    let key = "once";
    let create = || app.post("/api/v1/episodes").header("Idempotency-Key", key);
    let refused = create().json(&solved(&json!({}))).send().await;
    assert!(refused.status >= 500, "{}", refused.text());
    assert_eq!(app.count("SELECT count(*) FROM episodes").await, 0);
    app.tamper("DROP TRIGGER refuse").await;
    let episode = Episode::of(&create().json(&solved(&json!({}))).ok().await);
    is_over(&app, &episode).await;
}

/// Earlier versions stored the end in a commit of its own, and may have been killed before it.
#[tokio::test]
async fn a_solved_game_without_its_end_ends_before_anybody_sees_it() {
    let mut app = TestApp::start().await;
    let episode = app.create(solved(&json!({}))).await;
    let journal = app.journal(&episode).await;
    let opening: Value =
        serde_json::from_str(journal.lines().next().expect("a line")).expect("JSON");
    let head = text(&opening["hash"]);
    for look in ["obs", "swarm", "act"] {
        app.stop().await;
        let without = |bytes: String| {
            let statement = format!(
                "UPDATE episodes SET status = 'running', reason = NULL, ending = NULL, ended_at = NULL,
                 head = {bytes}; DELETE FROM results"
            );
            &*statement.leak()
        };
        let postgres = without(format!("'\\x{head}'"));
        app.tamper_in(without(format!("x'{head}'")), postgres).await;
        app.start_again().await;
        match look {
            "obs" => {
                let seen = app.obs(episode.seat(1)).await;
                assert_eq!(seen["status"], "finished");
            }
            "swarm" => {
                let seen = app.get("/swarm/obs").token(&episode.swarm).ok().await;
                assert_eq!(seen["finished"], true, "{seen}");
            }
            _ => {}
        }
        is_over(&app, &episode).await;
        assert_eq!(app.journal(&episode).await, journal);
    }
}
