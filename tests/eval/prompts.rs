//! Questions to models: system messages, the template `toolkit`, and how answers are read.

use serde_json::{Value, json};

use super::bench::Bench;
use crate::llm::endpoint::{Endpoint, Reply};

const SMALL: [&str; 8] =
    ["--num-agents", "2", "--max-round", "2", "--seeds", "1", "--task", "Synchronization"];

/// An answer with two actions: one reader takes the first, the other the last.
fn answers() -> Reply {
    Reply::says("ACTION: SWITCH\nACTION: STAY")
}

async fn asked(args: &[&str]) -> (Value, Vec<Value>) {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| answers()).await;
    let usual = ["--model", "m", "--api-base", endpoint.base(), "--verify"];
    let board = bench.board(&[&usual[..], &SMALL, args].concat()).await;
    (board, endpoint.seen().into_iter().map(|seen| seen.body).collect())
}

#[tokio::test]
async fn a_system_message_is_the_first_of_two() {
    let (board, bodies) = asked(&["--system", "Be brief."]).await;
    assert_eq!(bodies.len(), 4);
    for body in bodies {
        let messages = body["messages"].as_array().expect("messages");
        assert_eq!(messages.len(), 2, "{body}");
        assert_eq!(messages[0], json!({ "role": "system", "content": "Be brief." }));
        assert_eq!(messages[1]["role"], "user");
    }
    let prompt = board["rows"][0]["prompt"].as_str().expect("a prompt");
    assert!(prompt.starts_with("default+system:"), "{prompt}");
}

#[tokio::test]
async fn anthropics_system_message_is_a_field_of_its_own() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| {
        let content = json!([{ "type": "text", "text": "ACTION: STAY" }]);
        let usage = json!({ "input_tokens": 10, "output_tokens": 5 });
        Reply::json(
            200,
            &json!({ "type": "message", "content": content, "stop_reason": "end_turn", "usage": usage }),
        )
    })
    .await;
    let usual = ["--model", "m", "--api-base", endpoint.base(), "--api", "anthropic"];
    bench
        .eval(&[&usual[..], &SMALL, &["--max-tokens", "64", "--system", "Be brief."]].concat())
        .await
        .ends(0);
    for seen in endpoint.seen() {
        assert_eq!(seen.body["system"], "Be brief.");
        assert_eq!(seen.body["messages"].as_array().map(Vec::len), Some(1));
    }
}

#[tokio::test]
async fn the_template_toolkit_and_the_first_marker_are_on_the_board() {
    let reader = ["--answer-reader", "first-marker"];
    let (board, bodies) = asked(&[&["--prompt-template", "toolkit"][..], &reader].concat()).await;
    let row = &board["rows"][0];
    assert_eq!(
        (&row["prompt"], &row["answer_reader"]),
        (&json!("toolkit"), &json!("first-marker"))
    );
    // Both switch their lights in both rounds, so they agree at the end or never.
    let (last, _) = asked(&[]).await;
    assert_eq!(last["rows"][0]["answer_reader"], "last-marker");
    let asked = bodies[0]["messages"][0]["content"].as_str().expect("a text").to_owned();
    assert!(asked.contains("Agent_"), "{asked}");
}

#[tokio::test]
async fn built_in_players_have_no_prompt() {
    let bench = Bench::new();
    let board = bench.board(&[&["--player", "default"][..], &SMALL].concat()).await;
    let row = &board["rows"][0];
    assert_eq!(row["prompt"], Value::Null);
    let serving = bench.serve().await;
    let run = serving.client.run(row["run"].as_str().expect("an id"), None).await.expect("a run");
    assert_eq!(run.run.prompt, "none");
    let digest = run.run.suite.digest.expect("open seeds");
    let suite = format!("{}@{digest}", run.run.suite.name);
    let query = [("suite", suite.as_str()), ("format", "json")];
    let found: Value =
        serving.client.get_with("/api/v1/leaderboard", &query).await.expect("a board");
    assert_eq!(found["items"][0]["prompt"], Value::Null);
    serving.stop().await;
}
