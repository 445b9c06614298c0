//! `POST /act`: what one agent does.

use std::time::Duration;

use rstest::rstest;
use serde_json::{Value, json};

use super::{act, commanded, two_agents};
use crate::across::vectors;
use crate::app::{Episode, TestApp, check_problem, fields, list, number};

#[tokio::test]
async fn a_receipt_says_what_was_kept_and_how_many_are_awaited() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(3)).await;
    let sent = json!({
        "round": 0, "action": "LEFT", "message": "  two\r\nlines  ", "reasoning": "why not",
        "usage": { "prompt_tokens": 900, "completion_tokens": 12, "latency_ms": 800 },
    });
    let receipt = app.act(episode.seat(1), &sent).await;
    assert_eq!(
        receipt,
        json!({
            "episode": episode.id, "agent": "Agent_1", "round": 0, "action": "LEFT",
            "message": "two lines", "valid": true, "duplicate": false, "waiting_for": 1,
        })
    );
    let receipt = app.act(episode.seat(0), &act(0, "STAY")).await;
    assert_eq!((number(&receipt["waiting_for"]), &receipt["message"]), (0, &Value::Null));
    // What was only kept for replays is in the journal.
    let journal = app.journal(&episode).await;
    let round: Value =
        serde_json::from_str(journal.lines().nth(1).expect("a round")).expect("JSON");
    let kept = &round["record"]["acts"][1];
    assert_eq!((&kept["usage"], &kept["reasoning"]), (&sent["usage"], &sent["reasoning"]));
}

#[tokio::test]
async fn a_long_message_is_cut() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(3)).await;
    let sent = json!({ "round": 0, "action": "STAY", "message": "é".repeat(200) });
    let receipt = app.act(episode.seat(0), &sent).await;
    assert_eq!(receipt["message"], format!("{}...", "é".repeat(120)));
}

/// Sends an act again by both routes; it must get the first receipt, as a duplicate.
async fn expect_duplicate(app: &TestApp, episode: &Episode, act: &Value, first: &Value) {
    let mut expected = first.clone();
    expected["duplicate"] = json!(true);
    assert_eq!(app.act(episode.seat(0), act).await, expected);
    let mut among_others = act.clone();
    among_others["episode"] = json!(episode.id);
    among_others["agent"] = json!("Agent_0");
    assert_eq!(app.swarm_act(episode, &[among_others]).await, [expected]);
}

#[rstest]
#[case::action(json!({ "round": 0, "action": "UP", "message": "up" }))]
#[case::silent(json!({ "round": 0, "action": "UP" }))]
#[case::response(json!({ "round": 0, "response": "ACTION: UP\nMSG: up" }))]
#[case::invalid(json!({ "round": 0, "response": "?", "reasoning": "none" }))]
#[tokio::test]
async fn the_same_act_gets_the_first_receipt_at_any_time(#[case] sent: Value) {
    let mut app = TestApp::start().await;
    let episode = app.create(two_agents(2)).await;
    let first = app.act(episode.seat(0), &sent).await;
    assert_eq!((&first["duplicate"], number(&first["waiting_for"])), (&json!(false), 1));
    expect_duplicate(&app, &episode, &sent, &first).await;
    app.restart().await;
    expect_duplicate(&app, &episode, &sent, &first).await;
    app.all_act(&episode, "STAY").await;
    expect_duplicate(&app, &episode, &sent, &first).await;
    app.restart().await;
    expect_duplicate(&app, &episode, &sent, &first).await;
    app.all_act(&episode, "STAY").await;
    assert_eq!(app.show(&episode).await["status"], "finished");
    expect_duplicate(&app, &episode, &sent, &first).await;
    app.restart().await;
    expect_duplicate(&app, &episode, &sent, &first).await;
}

#[tokio::test]
async fn usage_and_reasoning_make_no_other_act_and_the_first_are_kept() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(2)).await;
    let first =
        json!({ "round": 0, "action": "UP", "reasoning": "first", "usage": { "latency_ms": 1 } });
    let second =
        json!({ "round": 0, "action": "UP", "reasoning": "second", "usage": { "latency_ms": 2 } });
    app.act(episode.seat(0), &first).await;
    assert_eq!(app.act(episode.seat(0), &second).await["duplicate"], true);
    app.act(episode.seat(1), &act(0, "STAY")).await;
    let journal = app.journal(&episode).await;
    assert!(journal.contains("\"first\"") && !journal.contains("\"second\""), "{journal}");
}

#[rstest]
#[case::action(json!({ "round": 0, "action": "DOWN", "message": "m" }))]
#[case::message(json!({ "round": 0, "action": "UP", "message": "n" }))]
#[case::no_message(json!({ "round": 0, "action": "UP" }))]
#[case::response(json!({ "round": 0, "response": "ACTION: UP\nMSG: m" }))]
#[case::invalid(json!({ "round": 0, "response": "" }))]
#[tokio::test]
async fn another_act_for_an_answered_round_is_refused(#[case] other: Value) {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(2)).await;
    let first = json!({ "round": 0, "action": "UP", "message": "m" });
    app.act(episode.seat(0), &first).await;
    for round in 0..2 {
        let refused = app.post("/act").token(episode.seat(0)).json(&other);
        let problem = refused.problem(409, "already_acted").await;
        assert_eq!(problem["round"], round);
        app.all_act(&episode, "STAY").await;
    }
    let refused = app.post("/act").token(episode.seat(0)).json(&other);
    assert_eq!(refused.problem(409, "already_acted").await["round"], 2);
}

/// Acts for `round` and expects it to be refused by both routes.
async fn expect_refusal(app: &TestApp, episode: &Episode, seat: usize, round: u64, code: &str) {
    let act = act(round, "RIGHT");
    let problem = app.post("/act").token(episode.seat(seat)).json(&act).problem(409, code).await;
    let mut among_others = act;
    among_others["episode"] = json!(episode.id);
    among_others["agent"] = json!(format!("Agent_{seat}"));
    let problems = app.swarm_act(episode, &[among_others]).await;
    assert_eq!(problems, std::slice::from_ref(&problem));
    assert_eq!(problem["round"], app.obs(episode.seat(seat)).await["round"]);
}

#[tokio::test]
async fn refusals_have_the_order_of_the_contract() {
    let app = TestApp::with_manual_clock().await;
    let mut request = two_agents(2);
    request["round_deadline_s"] = json!(10);
    request["start"] = json!("manual");
    let episode = app.create(request).await;
    expect_refusal(&app, &episode, 0, 0, "round_ahead").await;
    expect_refusal(&app, &episode, 0, 1, "round_ahead").await;

    // Seat 0 answers round 0 and seat 1 runs out of time.
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    expect_refusal(&app, &episode, 0, 1, "round_ahead").await;
    app.act(episode.seat(0), &act(0, "UP")).await;
    expect_refusal(&app, &episode, 0, 1, "round_ahead").await;
    expect_refusal(&app, &episode, 0, 0, "already_acted").await;
    app.pass(Duration::from_secs(11));
    app.obs_after(episode.seat(0), 0).await;
    expect_refusal(&app, &episode, 0, 0, "already_acted").await;
    expect_refusal(&app, &episode, 1, 0, "round_over").await;
    expect_refusal(&app, &episode, 1, 2, "round_ahead").await;

    // Round 1 is the last.
    app.all_act(&episode, "STAY").await;
    for seat in 0..2 {
        expect_refusal(&app, &episode, seat, 3, "round_ahead").await;
        expect_refusal(&app, &episode, seat, 2, "episode_over").await;
        expect_refusal(&app, &episode, seat, 1, "already_acted").await;
    }
    expect_refusal(&app, &episode, 0, 0, "already_acted").await;
    expect_refusal(&app, &episode, 1, 0, "episode_over").await;
}

#[tokio::test]
async fn an_unknown_action_costs_nothing() {
    let app = TestApp::start().await;
    let episode = app.create(json!({ "task": "Transport", "num_agents": 2 })).await;
    for unknown in ["SWITCH", "up", "UP ", "", "JUMP"] {
        let refused = app.post("/act").token(episode.seat(0)).json(&act(0, unknown));
        let problem = refused.problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["action"]);
        assert!(problem["detail"].as_str().is_some_and(|text| text.contains("STAY")), "{problem}");
    }
    assert_eq!(app.act(episode.seat(0), &act(0, "UP")).await["duplicate"], false);
}

#[rstest]
#[case("think…\nACTION: UP\nMSG: going up", Some("UP"), Some("going up"), true)]
#[case("**Action:** down", Some("DOWN"), None, true)]
#[case("ACTION: UP\nno, rather\nACTION: SWITCH", Some("SWITCH"), None, true)]
#[case("MSG: hello", None, Some("hello"), true)]
#[case("ACTION: MSG: hello", None, Some("hello"), true)]
#[case("ACTION: JUMP\nMSG: hello", None, None, false)]
#[case("I would go up.", None, None, false)]
#[case("", None, None, false)]
#[tokio::test]
async fn an_answer_of_a_language_model_is_always_taken(
    #[case] response: &str,
    #[case] action: Option<&str>,
    #[case] message: Option<&str>,
    #[case] valid: bool,
) {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(3)).await;
    let sent = json!({ "round": 0, "response": response });
    let receipt = app.act(episode.seat(0), &sent).await;
    assert_eq!(receipt["action"], json!(action));
    assert_eq!(receipt["message"], json!(message));
    assert_eq!(receipt["valid"], valid);
    app.act(episode.seat(1), &act(0, "STAY")).await;
    let seen = app.obs(episode.seat(0)).await;
    let done = json!([{ "round": 0, "action": action, "message": message }]);
    assert_eq!((number(&seen["round"]), &seen["history"]), (1, &done));
}

#[rstest]
#[case(json!({ "round": 0 }), &["action"])]
#[case(json!({ "round": 0, "message": "m" }), &["action"])]
#[case(json!({ "round": 0, "action": "UP", "response": "ACTION: UP" }), &["response"])]
#[case(json!({ "round": 0, "response": "ACTION: UP", "message": "m", "to": "Agent_1" }), &["message", "to"])]
#[case(json!({ "round": 0, "action": "UP", "to": "Agent_1" }), &["to"])]
#[case(json!({ "action": "UP" }), &["round"])]
#[tokio::test]
async fn an_act_is_exactly_one_of_action_and_response(#[case] sent: Value, #[case] named: &[&str]) {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(3)).await;
    let refused = app.post("/act").token(episode.seat(0)).json(&sent);
    assert_eq!(fields(&refused.problem(422, "invalid").await), named);
}

#[tokio::test]
async fn with_wait_an_act_brings_the_next_observation() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(2)).await;
    let call = |seat: usize, round: u64, query: &str| {
        app.post(&format!("/act{query}")).token(episode.seat(seat)).json(&act(round, "STAY"))
    };
    let receipt = call(0, 0, "").ok().await;
    assert_eq!(receipt.get("obs"), None);
    let receipt = call(0, 0, "?wait=0").ok().await;
    assert_eq!((&receipt["duplicate"], receipt.get("obs")), (&json!(true), Some(&Value::Null)));
    let (first, second) = tokio::join!(call(0, 0, "?wait=60").ok(), call(1, 0, "?wait=60").ok());
    for (seat, receipt) in [(0, &first), (1, &second)] {
        assert_eq!((number(&receipt["round"]), number(&receipt["obs"]["round"])), (0, 1));
        assert_eq!(receipt["obs"], app.obs(episode.seat(seat)).await);
    }
    assert_eq!((&first["duplicate"], &second["duplicate"]), (&json!(true), &json!(false)));
    // The last round is followed by the end.
    let (first, _) = tokio::join!(call(0, 1, "?wait=60").ok(), call(1, 1, "").ok());
    assert_eq!(first["obs"]["status"], "finished");
}

#[tokio::test]
async fn with_wait_the_observation_is_null_when_the_time_is_up() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(two_agents(2)).await;
    let call = app.post("/act?wait=20").token(episode.seat(0)).json(&act(0, "UP"));
    let receipt = app.pass_until(tokio::spawn(call.ok())).await;
    assert_eq!((number(&receipt["waiting_for"]), receipt.get("obs")), (1, Some(&Value::Null)));
    assert_eq!(app.obs(episode.seat(0)).await["acted"], true);
}

#[tokio::test]
async fn an_escaped_agent_sees_nothing_and_acts_no_more() {
    let app = TestApp::start().await;
    let (config, rounds) = vectors::recorded_transport();
    let episode = app.create(config).await;
    let mut rounds = (0..).zip(rounds);
    let gone = loop {
        let (round, acts) = rounds.next().expect("somebody escapes");
        app.swarm_act(&episode, &vectors::acts(&episode, round, &acts)).await;
        let agents = list(&app.state(&episode).await["agents"]);
        if let Some(gone) = agents.iter().position(|agent| agent["alive"] == false) {
            break gone;
        }
    };
    let seen = app.obs(episode.seat(gone)).await;
    assert_eq!((&seen["alive"], &seen["status"]), (&json!(false), &json!("running")));
    for nothing in ["position", "view"] {
        assert_eq!(seen[nothing], Value::Null);
    }
    assert_eq!(seen["messages"], json!([]));
    let round = number(&seen["round"]);
    assert_eq!(seen["history"][0]["round"], round - 1);
    expect_refusal(&app, &episode, gone, round, "episode_over").await;
    expect_refusal(&app, &episode, gone, round + 1, "round_ahead").await;
    // The others play on without it.
    let name = json!(format!("Agent_{gone}"));
    let waiting = app.swarm_obs(&episode).await;
    assert!(!waiting.is_empty() && waiting.iter().all(|seen| seen["agent"] != name));
    let receipts = {
        let (round, acts) = rounds.next().expect("the others play on");
        app.swarm_act(&episode, &vectors::acts(&episode, round, &acts)).await
    };
    assert_eq!(receipts.last().expect("a receipt")["waiting_for"], 0);
    let seen = app.obs(episode.seat(gone)).await;
    assert_eq!(seen["round"], round + 1);
    assert_eq!(seen["history"][0]["round"], round - 1);
    expect_refusal(&app, &episode, gone, round, "episode_over").await;
}

async fn messages(app: &TestApp, episode: &Episode) -> Vec<Value> {
    let mut messages = Vec::new();
    for token in episode.seats() {
        messages.push(app.obs(token).await["messages"].clone());
    }
    messages
}

#[tokio::test]
async fn the_commander_tells_all_or_one_and_all_tell_the_commander() {
    let app = TestApp::start().await;
    let episode = commanded(&app).await;
    let say = |agent: u64, round: u64, to: Option<&str>| {
        let mut act = episode.act(&json!(format!("Agent_{agent}")), round, "STAY");
        act["message"] = json!(format!("from {agent}"));
        if let Some(to) = to {
            act["to"] = json!(to);
        }
        act
    };
    let all: Vec<_> = (0..4).map(|agent| say(agent, 0, None)).collect();
    app.swarm_act(&episode, &all).await;
    let from_others = json!(["from 1", "from 2", "from 3"]);
    let from_commander = json!(["from 0"]);
    let heard = [&from_others, &from_commander, &from_commander, &from_commander];
    assert_eq!(messages(&app, &episode).await, heard.map(Clone::clone));

    let receipts = app.swarm_act(&episode, &[say(0, 1, Some("Agent_2"))]).await;
    assert_eq!(receipts[0]["duplicate"], false);
    for (to, code) in [(None, "already_acted"), (Some("Agent_3"), "already_acted")] {
        check_problem(&app.swarm_act(&episode, &[say(0, 1, to)]).await[0], 409, code);
    }
    let receipts = app.swarm_act(&episode, &[say(0, 1, Some("Agent_2"))]).await;
    assert_eq!(receipts[0]["duplicate"], true);
    app.all_act(&episode, "STAY").await;
    let silence = json!([]);
    let heard = [&silence, &silence, &from_commander, &silence];
    assert_eq!(messages(&app, &episode).await, heard.map(Clone::clone));

    // A language model names the receiver in its answer.
    let answer = json!({ "round": 2, "response": "ACTION: STAY\nTO: Agent_3\nMSG: from 0" });
    app.act(episode.seat(0), &answer).await;
    app.all_act(&episode, "STAY").await;
    let heard = [&silence, &silence, &silence, &from_commander];
    assert_eq!(messages(&app, &episode).await, heard.map(Clone::clone));
}

#[rstest]
#[case::not_the_commander(1, "Agent_2")]
#[case::itself(0, "Agent_0")]
#[case::nobody(0, "Agent_4")]
#[case::no_name(0, "2")]
#[tokio::test]
async fn a_receiver_that_cannot_be_is_refused(#[case] seat: usize, #[case] to: &str) {
    let app = TestApp::start().await;
    let episode = commanded(&app).await;
    let sent = json!({ "round": 0, "action": "STAY", "message": "m", "to": to });
    let refused = app.post("/act").token(episode.seat(seat)).json(&sent);
    assert_eq!(fields(&refused.problem(422, "invalid").await), ["to"]);
}
