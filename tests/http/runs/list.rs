//! Lists of runs: filters and pages.

use serde_json::{Value, json};

use super::{create, small, text, with};
use crate::app::{TestApp, list};

#[tokio::test]
async fn runs_are_listed_the_newest_first() {
    let app = TestApp::start().await;
    let mut ids = Vec::new();
    for model in ["a", "b", "a"] {
        ids.push(create(&app, with(small(), &json!({ "model": model }))).await);
    }
    app.delete(&ids[0].path("")).ok().await;
    let find = async |query: &str| -> Vec<usize> {
        let found = app.get(&format!("/api/v1/runs{query}")).ok().await;
        let place = |item: &Value| ids.iter().position(|run| item["id"] == run.id.as_str());
        list(&found["items"]).iter().map(|item| place(item).expect("a known run")).collect()
    };
    assert_eq!(find("").await, [2, 1, 0]);
    assert_eq!(find("?model=a").await, [2, 0]);
    assert_eq!(find("?status=aborted").await, [0]);
    assert_eq!(find("?suite=small&status=running").await, [2, 1]);
    assert!(find("?suite=standard").await.is_empty());
    let page = app.get("/api/v1/runs?limit=2").ok().await;
    assert_eq!(list(&page["items"]).len(), 2);
    let rest = format!("?limit=2&cursor={}", text(&page, "next_cursor"));
    assert_eq!(find(&rest).await, [0]);
    for query in ["?status=done", "?limit=0", "?cursor=x", "?task=Foraging"] {
        app.get(&format!("/api/v1/runs{query}")).problem(400, "malformed").await;
    }
    let item = &app.get("/api/v1/runs?status=aborted").ok().await["items"][0];
    assert_eq!((&item["played"], &item["total"]), (&json!(4), &json!(0.0)));
    app.get("/api/v1/runs/run_0").problem(404, "not_found").await;
}
