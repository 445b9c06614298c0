//! Knowledge and act of one agent in a round.

use serde_json::{Value, json};

use super::{request, with};
use crate::app::{Episode, TestApp};

async fn shown(app: &TestApp, episode: &Episode, round: u32, agent: &str) -> Value {
    let path = episode.path(&format!("/rounds/{round}/agents/{agent}"));
    app.get(&path).token(&episode.swarm).ok().await
}

/// An observation without the fields of the agent's clock.
fn seen(mut observation: Value) -> (Value, Value) {
    let fields = observation.as_object_mut().expect("fields");
    for moment in ["acted", "deadline", "remaining_ms", "bank_ms"] {
        assert!(fields.remove(moment).is_some(), "{moment}");
    }
    (fields.remove("prompt").expect("a prompt"), observation)
}

#[tokio::test]
async fn it_is_what_the_agent_was_shown_and_what_it_answered() {
    let mut app = TestApp::with_manual_clock().await;
    let game = json!({ "task": "Pursuit", "seed": 8, "num_agents": 3, "max_round": 4 });
    let episode = app.create(game).await;
    let mut looks = Vec::new();
    for round in 0..3 {
        let mut of_round = Vec::new();
        for token in episode.seats() {
            of_round.push(seen(app.get("/obs?prompt=true").token(token).ok().await));
        }
        looks.push(of_round);
        let answer = json!({ "round": round, "response": "I think.\nACTION: LEFT\nMSG: go <left>",
            "reasoning": "because", "usage": { "prompt_tokens": 7, "latency_ms": 5 } });
        app.act(episode.seat(0), &answer).await;
        app.act(episode.seat(1), &json!({ "round": round, "action": "UP" })).await;
        app.act(episode.seat(2), &json!({ "round": round, "response": "no idea" })).await;
    }
    for _ in 0..2 {
        for (round, of_round) in (0..).zip(&looks) {
            for (number, (prompt, observation)) in of_round.iter().enumerate() {
                let shown = shown(&app, &episode, round, &format!("Agent_{number}")).await;
                assert_eq!((&shown["observation"], &shown["prompt"]), (observation, prompt));
            }
        }
        let first = shown(&app, &episode, 1, "Agent_0").await["act"].take();
        assert_eq!(first["response"], "I think.\nACTION: LEFT\nMSG: go <left>");
        assert_eq!((&first["action"], &first["message"]), (&json!("LEFT"), &json!("go <left>")));
        assert_eq!((&first["source"], &first["valid"]), (&json!("player"), &json!(true)));
        assert_eq!(first["usage"], json!({ "prompt_tokens": 7, "latency_ms": 5 }));
        assert_eq!(
            (&first["reasoning"], &first["at"]),
            (&json!("because"), &json!("2026-03-01T12:00:00.000Z"))
        );
        let third = shown(&app, &episode, 1, "Agent_2").await["act"].take();
        assert_eq!((&third["valid"], &third["action"]), (&json!(false), &Value::Null));
        app.restart().await;
    }
}

#[tokio::test]
async fn the_open_round_has_no_acts() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(with(request(2, 3), "round_deadline_s", json!(5))).await;
    app.act(episode.seat(0), &json!({ "round": 0, "action": "UP" })).await;
    app.pass(std::time::Duration::from_secs(5));
    app.obs_after(episode.seat(0), 0).await;
    assert_eq!(shown(&app, &episode, 0, "Agent_1").await["act"]["source"], "clock");
    app.act(episode.seat(0), &json!({ "round": 1, "action": "UP" })).await;
    let open = shown(&app, &episode, 1, "Agent_0").await;
    assert_eq!((&open["act"], &open["observation"]["round"]), (&Value::Null, &json!(1)));
    app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    let ended = shown(&app, &episode, 1, "Agent_0").await;
    assert_eq!((&ended["act"], &ended["observation"]["status"]), (&Value::Null, &json!("aborted")));
}

#[tokio::test]
async fn an_agent_that_escaped_has_an_observation_and_no_act() {
    let app = TestApp::start().await;
    let game = json!({ "task": "Transport", "seed": 27, "player": "default" });
    let episode = app.create(game).await;
    let played = app.get("/swarm/obs?wait=60").token(&episode.swarm).ok().await;
    assert_eq!(played["finished"], true);
    let rounds = app.show(&episode).await["round"].as_u64().expect("a number");
    let states = app.get(&episode.path("/replay")).ok().await["states"].take();
    let mut found = 0;
    for round in 0..rounds {
        for agent in
            states[usize::try_from(round).expect("few")]["gone"].as_array().into_iter().flatten()
        {
            let path = episode.path(&format!("/rounds/{round}/agents/Agent_{agent}"));
            let shown = app.get(&path).ok().await;
            assert_eq!(
                (&shown["act"], &shown["observation"]["alive"]),
                (&Value::Null, &json!(false))
            );
            found += 1;
        }
    }
    assert!(found > 0);
}

#[tokio::test]
async fn what_is_not_there_is_not_found() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 5)).await;
    app.all_act(&episode, "UP").await;
    for place in [
        "2/agents/Agent_0",
        "0/agents/Agent_2",
        "0/agents/agent_0",
        "0/agents/Agent_01",
        "x/agents/Agent_0",
        "-1/agents/Agent_0",
    ] {
        let path = episode.path(&format!("/rounds/{place}"));
        app.get(&path).problem(404, "not_found").await;
    }
    let path = episode.path("/rounds/2/agents/Agent_0");
    assert_eq!(app.get(&path).problem(404, "not_found").await["round"], 1);
    app.get(&episode.path("/rounds/0/agents/Agent_0?x=1")).problem(400, "malformed").await;
}
