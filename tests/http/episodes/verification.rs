//! The journal, played again by the server.

use serde_json::{Value, json};

use super::{finish, request};
use crate::app::{TestApp, verified};

#[tokio::test]
async fn it_finds_what_the_program_finds() {
    let app = TestApp::start().await;
    let episode = app.create(request(3, 4)).await;
    let find = async || app.get(&episode.path("/verification")).token(&episode.swarm).ok().await;
    let layout = find().await;
    assert_eq!((&layout["ok"], &layout["rounds"]), (&json!(true), &json!(0)));
    assert_eq!(layout["layout_digest"], layout["final_digest"]);
    app.all_act(&episode, "SWITCH").await;
    let running = find().await;
    assert_eq!((&running["ok"], &running["rounds"]), (&json!(true), &json!(1)));
    assert_ne!(running["journal_head"], layout["journal_head"]);
    finish(&app, &episode).await;
    let ended = find().await;
    let report = verified(&app.journal(&episode).await);
    assert_eq!((&ended["ok"], &ended["problem"]), (&json!(true), &Value::Null));
    assert_eq!(ended["journal_head"], report.head.to_string());
    assert_eq!(ended["journal_head"], app.show(&episode).await["result"]["journal_head"]);
    assert_eq!(ended["layout_digest"], report.opening.digest);
    assert_eq!((&ended["rounds"], &ended["score"]), (&json!(4), &json!(report.score)));
    let last = app.journal(&episode).await;
    let last = last.lines().rfind(|line| line.contains("\"round\":3")).expect("a round");
    assert!(last.contains(ended["final_digest"].as_str().expect("a digest")));
    assert_eq!(find().await, ended);
}

/// Lines of large rounds come in several parts.
#[tokio::test]
async fn long_answers_are_checked_too() {
    let app = TestApp::builder().limits(|limits| limits.stream_part_bytes_max = 700).start().await;
    let episode = app.create(request(2, 2)).await;
    for round in 0..2 {
        for token in episode.seats() {
            let response = format!("{}\nACTION: UP", "thoughts ".repeat(400));
            app.act(token, &json!({ "round": round, "response": response })).await;
        }
    }
    let found = app.get(&episode.path("/verification")).ok().await;
    assert_eq!((&found["ok"], &found["rounds"]), (&json!(true), &json!(2)));
}

#[tokio::test]
async fn a_changed_act_is_found() {
    let mut app = TestApp::start().await;
    let episode = app.create(request(2, 3)).await;
    finish(&app, &episode).await;
    app.stop().await;
    app.tamper(
        "UPDATE acts SET record = replace(record, 'SWITCH', 'STAY') WHERE round = 1 AND agent = 0",
    )
    .await;
    app.start_again().await;
    let found = app.get(&episode.path("/verification")).ok().await;
    assert_eq!((&found["ok"], &found["rounds"]), (&json!(false), &json!(1)));
    let problem = found["problem"].as_str().expect("a problem");
    assert!(problem.contains("line 3") && problem.contains("changed"), "{problem}");
    assert_eq!(found["final_digest"], Value::Null);
}
