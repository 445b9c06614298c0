//! Why answers did not count, kind by kind: in a run, on boards and in exports.

use serde_json::json;

use super::{create, look, seen, send, show, small};
use crate::app::TestApp;

#[tokio::test]
async fn reasons_are_counted_in_runs_boards_and_exports() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    let mut rounds = 0;
    loop {
        let looked = look(&app, &run, "?wait=60").await;
        if looked["finished"] == true {
            break;
        }
        let acts: Vec<_> = (seen(&looked).iter())
            .map(|seen| {
                let mut act = json!({
                    "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "response": "Hm.",
                });
                if seen["agent"] == "Agent_0" {
                    act["failure"] = json!("refusal");
                }
                act
            })
            .collect();
        send(&app, &run, &acts).await;
        rounds += 1;
        assert!(rounds < 100, "it ends");
    }
    // Four games of two rounds: eight answers of each agent.
    let expected = json!({ "refusal": 8, "no_marker": 8 });
    let shown = show(&app, &run).await;
    assert_eq!((&shown["acts"]["failures"], &shown["acts"]["invalid"]), (&expected, &json!(16)));
    let suite = format!("small@{}", shown["suite"]["digest"].as_str().expect("a digest"));
    let path = format!("/api/v1/leaderboard?suite={suite}");
    let board = app.get(&path).ok().await;
    assert_eq!(board["items"][0]["failures"], expected);
    let csv = app.get(&format!("{path}&format=csv")).send().await.text();
    let mut lines = csv.lines();
    let columns: Vec<_> = lines.next().expect("columns").split(',').collect();
    let cells: Vec<_> = lines.next().expect("a row").split(',').collect();
    let cell = |name: &str| cells[columns.iter().position(|column| *column == name).expect(name)];
    assert_eq!(
        (cell("failed_refusal"), cell("failed_no_marker"), cell("failed_empty")),
        ("8", "8", "0")
    );
    let table = |name: &str| format!("/api/v1/exports/{name}.jsonl?run={}", run.id);
    let lines = app.get(&table("episodes")).send().await.text();
    for line in lines.lines() {
        let game: serde_json::Value = serde_json::from_str(line).expect("JSON");
        assert_eq!((&game["failed_refusal"], &game["failed_no_marker"]), (&json!(2), &json!(2)));
    }
    assert_eq!(lines.lines().count(), 4);
    let acts = app.get(&table("acts")).send().await.text();
    assert_eq!(acts.matches("\"failure\":\"refusal\"").count(), 8, "{acts}");
}
