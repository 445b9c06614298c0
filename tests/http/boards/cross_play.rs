//! Cross-play: which models did how well together.

use serde_json::json;

use super::played::Offline;
use super::{column, records};
use crate::app::TestApp;
use crate::app::program::{swarmbench, text};

#[tokio::test]
async fn cross_play_tells_who_did_how_well_together() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    app.stop().await;
    let mut offline = Offline::open(&app).await;
    offline.mixed(3, 0.0, Some("theirs")).await;
    offline.mixed(5, 0.0, None).await;
    offline.mixed(9, 0.25, Some("theirs")).await;
    offline.close().await;
    app.start_again().await;
    let found = app.get("/api/v1/cross-play").ok().await;
    assert_eq!(
        column(&found, "/models"),
        [
            json!(["=ours", "built-in/random"]),
            json!(["=ours", "theirs"]),
            json!(["=ours", "theirs"])
        ]
    );
    assert_eq!(column(&found, "/mean"), [5.0, 3.0, 9.0]);
    assert_eq!(column(&found, "/vouched"), [true, false, false]);
    // Other settings are another pair.
    assert_eq!(column(&found, "/settings/noise"), [0.0, 0.0, 0.25]);
    let none = app.get("/api/v1/cross-play?task=Pursuit&rules=paper").ok().await;
    assert_eq!(none, json!({ "items": [], "next_cursor": null }));
    let answer = app.get("/api/v1/cross-play?limit=2").header("accept", "text/csv").send().await;
    let records = records(&answer);
    assert_eq!(
        (records.len(), &records[1]["model_a"][..], &records[1]["model_b"][..]),
        (2, "'=ours", "theirs")
    );
    assert_eq!((&records[1]["num_agents"][..], &records[1]["games"][..]), ("2", "1"));
    let rest = app
        .get(&format!("/api/v1/cross-play?cursor={}", answer.header("x-next-cursor")))
        .ok()
        .await;
    assert_eq!(column(&rest, "/mean"), [9.0]);

    let server = app.base().to_owned();
    let shown = swarmbench(&["cross-play", "--server", &server]).await;
    let shown = text(&shown.stdout);
    assert!(shown.contains("built-in/random") && shown.contains("noise 0.25"), "{shown}");
    app.stop().await;
    // Voided games do not count.
    app.tamper("UPDATE episodes SET voided_at = 1 WHERE key = 3;").await;
    app.start_again().await;
    assert_eq!(column(&app.get("/api/v1/cross-play").ok().await, "/mean"), [5.0, 3.0]);
}
