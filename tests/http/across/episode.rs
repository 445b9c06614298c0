//! One episode from its creation to its proof, as a reader of the README would play it.

use serde_json::json;
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::verify;

use crate::app::{TestApp, list};

#[tokio::test]
async fn an_episode_is_created_played_watched_and_proven() {
    let app = TestApp::start().await;

    // Create it. Every agent gets a token.
    let request = json!({
        "task": "Synchronization", "seed": 27, "num_agents": 3, "max_round": 2, "model": "readme",
    });
    let created = app.post("/api/v1/episodes").json(&request).ok().await;
    assert_eq!(created["status"], "running");
    let id = created["id"].as_str().expect("an id");
    let tokens: Vec<_> = list(&created["seats"])
        .iter()
        .map(|seat| seat["token"].as_str().expect("a token").to_owned())
        .collect();
    assert_eq!(tokens.len(), 3);

    // Round 0: look, and bring all lights into the same state.
    for (place, token) in tokens.iter().enumerate() {
        let seen = app.get("/obs").token(token).ok().await;
        assert_eq!((&seen["round"], &seen["acted"]), (&json!(0), &json!(false)));
        assert_eq!(seen["actions"], json!(["UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH"]));
        let action = if seen["light_on"] == true { "STAY" } else { "SWITCH" };
        let act =
            json!({ "round": 0, "action": action, "message": format!("seat {place} is lit") });
        let receipt = app.post("/act").token(token).json(&act).ok().await;
        assert_eq!((&receipt["valid"], &receipt["duplicate"]), (&json!(true), &json!(false)));
        assert_eq!(receipt["waiting_for"], 2 - place);
    }

    // The last act resolved the round: everybody may see it, and the score.
    let state = app.get(&format!("/api/v1/episodes/{id}/state")).ok().await;
    assert_eq!((&state["round"], &state["score"]), (&json!(1), &json!(1.0)));
    assert!(list(&state["agents"]).iter().all(|agent| agent["light_on"] == true));
    assert_eq!(list(&state["grid"]).len(), 10);

    // Round 1: wait for it, and answer as a language model does.
    for token in &tokens {
        let seen = app.get("/obs?after=0&wait=60").token(token).ok().await;
        assert_eq!(seen["round"], 1);
        assert_eq!(seen["score"], 1.0);
        let act = json!({ "round": 1, "response": "All lit, so off again.\nACTION: SWITCH" });
        app.post("/act").token(token).json(&act).ok().await;
    }

    // That was the last round.
    let seen = app.get("/obs").token(&tokens[0]).ok().await;
    assert_eq!(seen["status"], "finished");
    let summary = app.get(&format!("/api/v1/episodes/{id}")).ok().await;
    assert_eq!((&summary["status"], &summary["round"]), (&json!("finished"), &json!(2)));
    assert_eq!((&summary["score"], &summary["model"]), (&json!(2.0), &json!("readme")));
    let result = &summary["result"];
    assert_eq!(&seen["result"], result);
    assert_eq!(result["reason"], "rounds_played");

    // The journal proves the score: an opening, two rounds, an end, and the head of the summary.
    let journal = app.get(&format!("/api/v1/episodes/{id}/journal")).send().await;
    assert_eq!(journal.header("content-type"), "application/x-ndjson");
    assert_eq!(journal.text().lines().count(), 4);
    let head = result["journal_head"].as_str().and_then(Head::parse).expect("a head");
    let report = verify(&*journal.body, Some(head), Solver::Flow, |_, _| ()).expect("a proof");
    assert_eq!((report.rounds, report.head), (2, head));
    assert!((report.score - 2.0).abs() < f64::EPSILON);
    assert_eq!(report.end.expect("an end").reason, "rounds_played");
}
