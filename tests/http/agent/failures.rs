//! Reasons for which answers of language models do not count: read from their texts, or said by their clients.

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::replay::verify;

use super::readers::rehashed;
use super::two_agents;
use crate::app::{TestApp, check_problem, verified};

#[rstest]
#[case::empty("", None, Some("empty"))]
#[case::white(" \n", None, Some("empty"))]
#[case::prose("I would go up.", None, Some("no_marker"))]
#[case::nothing_said("MSG: \"\"", None, Some("no_marker"))]
#[case::unknown("ACTION: FLY", None, Some("unknown_action"))]
#[case::refused("I cannot help.", Some("refusal"), Some("refusal"))]
#[case::cut("ACTION: ST", Some("truncated"), Some("truncated"))]
#[case::rejected("", Some("rejected"), Some("rejected"))]
#[case::cut_and_valid("ACTION: STAY\nMSG: and n", Some("truncated"), None)]
#[tokio::test]
async fn a_receipt_a_journal_and_a_replay_say_why(
    #[case] response: &str,
    #[case] said: Option<&str>,
    #[case] failure: Option<&str>,
) {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(1)).await;
    let mut act = json!({ "round": 0, "response": response });
    if let Some(said) = said {
        act["failure"] = json!(said);
    }
    let receipt = app.act(episode.seat(0), &act).await;
    assert_eq!(receipt["valid"], failure.is_none());
    assert_eq!(receipt.get("failure").and_then(Value::as_str), failure);
    // It is no part of the act: without it, it is the same one.
    let again = app.act(episode.seat(0), &json!({ "round": 0, "response": response })).await;
    assert_eq!((&again["duplicate"], again.get("failure")), (&json!(true), receipt.get("failure")));
    app.act(episode.seat(1), &json!({ "round": 0, "action": "STAY" })).await;
    let journal = app.journal(&episode).await;
    assert_eq!(journal.matches("\"failure\"").count(), usize::from(failure.is_some()), "{journal}");
    let tally = verified(&journal).tally;
    assert_eq!((tally.invalid, tally.failures.total()), (failure.is_some().into(), tally.invalid));
    let shown = app.get(&episode.path("/rounds/0/agents/Agent_0")).ok().await;
    assert_eq!(shown["act"].get("failure").and_then(Value::as_str), failure);
}

#[tokio::test]
async fn what_follows_from_the_text_is_not_for_clients_to_say() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(1)).await;
    for (act, about) in [
        (json!({ "round": 0, "response": "x", "failure": "no_marker" }), "leave it out"),
        (json!({ "round": 0, "response": "", "failure": "empty" }), "leave it out"),
        (json!({ "round": 0, "action": "UP", "failure": "refusal" }), "goes with `response`"),
        (json!({ "round": 0, "response": "x", "failure": "boredom" }), "content_filter"),
    ] {
        let problem = app.post("/act").token(episode.seat(0)).json(&act).send().await.json();
        check_problem(&problem, 422, "invalid");
        assert!(problem["detail"].as_str().expect("a text").contains(about), "{problem}");
    }
}

/// Journals of earlier versions have no reasons; one with a wrong reason is none.
#[tokio::test]
async fn a_verification_reads_the_reason_again() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(1)).await;
    app.act(episode.seat(0), &json!({ "round": 0, "response": "up" })).await;
    app.act(episode.seat(1), &json!({ "round": 0, "action": "STAY" })).await;
    let journal = app.journal(&episode).await;
    let told = "\"failure\":\"no_marker\",";
    assert!(journal.contains(told), "{journal}");
    for (other, is_good) in
        [("", true), ("\"failure\":\"empty\",", false), ("\"failure\":\"refusal\",", true)]
    {
        let changed = rehashed(&journal.replace(told, other));
        let report = verify(changed.as_bytes(), None, Solver::Flow, |_, _| ());
        assert_eq!(report.is_ok(), is_good, "{other}: {report:?}");
    }
    let valid = rehashed(
        &journal.replace("\"action\":\"STAY\",", "\"action\":\"STAY\",\"failure\":\"refusal\","),
    );
    let report = verify(valid.as_bytes(), None, Solver::Flow, |_, _| ());
    assert!(report.expect_err("it counts").to_string().contains("why not"));
}
