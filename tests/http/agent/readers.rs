//! Readers that find an action in a model's answer: a setting of the episode.

use serde_json::{Value, json};

use crate::app::{TestApp, check_problem, verified};

/// Both readers find something in it, and not the same.
const ANSWER: &str = "My ACTION: STAY would be dull.\nACTION: SWITCH\nMSG: now";

fn episode(reader: Option<&str>) -> Value {
    let mut body = json!({ "task": "Synchronization", "seed": 5, "num_agents": 1, "max_round": 2 });
    if let Some(reader) = reader {
        body["answer_reader"] = json!(reader);
    }
    body
}

#[tokio::test]
async fn the_reader_of_the_episode_reads_and_its_journal_says_so() {
    let app = TestApp::start().await;
    for (reader, action) in
        [(None, "SWITCH"), (Some("last-marker"), "SWITCH"), (Some("first-marker"), "STAY")]
    {
        let episode = app.create(episode(reader)).await;
        let mut journal = String::new();
        for round in 0..2 {
            let receipt =
                app.act(episode.seat(0), &json!({ "round": round, "response": ANSWER })).await;
            assert_eq!((&receipt["action"], &receipt["valid"]), (&json!(action), &json!(true)));
            journal = app.journal(&episode).await;
        }
        let opening: Value =
            serde_json::from_str(journal.lines().next().expect("an opening")).expect("JSON");
        let recorded = opening["record"]["config"].get("answer_reader").cloned();
        let expected = (reader == Some("first-marker")).then(|| json!("first-marker"));
        assert_eq!(recorded, expected, "only what is not usual is in a journal");
        assert_eq!(verified(&journal).rounds, 2);
        // The same acts do not follow from the same answers under the other reader.
        if recorded.is_some() {
            let other = journal.replace(r#""answer_reader":"first-marker","#, "");
            assert_ne!(other, journal);
            let other = rehashed(&other);
            let fault = swarmbench_journal::replay::verify(
                other.as_bytes(),
                None,
                swarmbench_engine::physics::Solver::Flow,
                |_, _| (),
            );
            let fault = fault.expect_err("the reader is part of what is proven").to_string();
            assert!(fault.contains("Agent_0"), "{fault}");
        }
    }
}

/// A journal with the hashes of its lines as they are now.
pub(crate) fn rehashed(journal: &str) -> String {
    let mut head = swarmbench_journal::chain::Head::START;
    let lines = journal.lines().map(|line| {
        let record = line.split_once(r#""record":"#).expect("a record").1;
        let record = record.strip_suffix('}').expect("the end of the line");
        head = head.link(record.as_bytes());
        format!("{{\"hash\":\"{head}\",\"record\":{record}}}\n")
    });
    lines.collect()
}

#[tokio::test]
async fn an_unknown_reader_is_refused() {
    let app = TestApp::start().await;
    let answer = app.post("/api/v1/episodes").json(&episode(Some("any-marker"))).send().await;
    let text = answer.text();
    check_problem(&serde_json::from_str(&text).expect("JSON"), 422, "invalid");
    assert!(text.contains("answer_reader") && text.contains("first-marker"), "{text}");
}

#[tokio::test]
async fn answers_in_json_are_read_and_verified() {
    let app = TestApp::start().await;
    let episode = app.create(episode(Some("json"))).await;
    for (round, response, action, failure) in [
        (
            0,
            r#"Sure: ```json {"action": "switch", "message": "now", "notes": [1]} ```"#,
            json!("SWITCH"),
            Value::Null,
        ),
        (1, r#"ACTION: SWITCH {"message": null}"#, Value::Null, json!("no_marker")),
    ] {
        let act = json!({ "round": round, "response": response });
        let receipt = app.act(episode.seat(0), &act).await;
        assert_eq!((&receipt["action"], &receipt["failure"]), (&action, &failure), "{receipt}");
    }
    let journal = app.journal(&episode).await;
    assert!(journal.contains(r#""answer_reader":"json""#));
    assert_eq!(verified(&journal).rounds, 2);
}

/// What a harness adds is bounded, and is for answers of models alone.
#[tokio::test]
async fn a_harness_is_stored_with_its_act_or_refused() {
    let app = TestApp::start().await;
    let episode = app.create(episode(None)).await;
    let act = |harness: Value| json!({ "round": 0, "response": ANSWER, "harness": harness });
    let one = json!({ "response": "", "told": "" });
    for (harness, field) in [
        (json!({ "history": [0] }), "harness.history"),
        (json!({ "history": vec![0; 21] }), "harness.history"),
        (json!({ "carried": [0] }), "harness.carried"),
        (json!({ "tries": vec![one; 9] }), "harness.tries"),
        (json!({ "scratchpad": "x".repeat(70_000) }), "harness"),
        (json!({ "memory": 1 }), "harness"),
    ] {
        let answer = app.post("/act").token(episode.seat(0)).json(&act(harness)).send().await;
        let text = answer.text();
        check_problem(&serde_json::from_str(&text).expect("JSON"), 422, "invalid");
        assert!(text.contains(field), "{text}");
    }
    let structured = json!({ "round": 0, "action": "STAY", "harness": { "added": "x" } });
    app.post("/act").token(episode.seat(0)).json(&structured).problem(422, "invalid").await;
    app.act(episode.seat(0), &act(json!({ "added": "more", "scratchpad": "notes" }))).await;
    app.act(
        episode.seat(0),
        &json!({ "round": 1, "response": ANSWER, "harness": { "history": [0] } }),
    )
    .await;
    let path = format!("/api/v1/episodes/{}/rounds/0/agents/Agent_0", episode.id);
    let shown = app.get(&path).ok().await;
    assert_eq!(shown["act"]["harness"], json!({ "added": "more", "scratchpad": "notes" }));
    let journal = app.journal(&episode).await;
    assert!(journal.contains(r#""harness":{"history":[0]}"#), "{journal}");
    assert_eq!(verified(&journal).rounds, 2);
}
