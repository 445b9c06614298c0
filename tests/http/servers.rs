//! The servers of a database, and who learns of them.

use serde_json::json;

use crate::app::{TestApp, list};

#[tokio::test]
async fn organizers_and_judges_see_the_servers_of_the_database() {
    let app = TestApp::builder().keys().start().await;
    let (judge, _) = app.key(json!({ "name": "a judge", "role": "judge" })).await;
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    app.get("/api/v1/nodes").problem(401, "unauthorized").await;
    app.get("/api/v1/nodes").token(&member).problem(403, "forbidden").await;
    for key in [&app.organizer, &judge] {
        let servers = app.get("/api/v1/nodes").token(key).ok().await;
        let items = list(&servers["items"]);
        assert_eq!(servers["cluster"], items.len() > 1);
        let own: Vec<_> = items.iter().filter(|server| server["is_this"] == true).collect();
        assert_eq!(own.len(), 1, "{servers}");
        assert_eq!(own[0]["connected"], true);
        assert_eq!(own[0]["version"], env!("CARGO_PKG_VERSION"));
        assert!(own[0]["name"].as_str().expect("a name").contains(", process "));
        assert!(items.iter().any(|server| server["ready"] == true), "{servers}");
    }
}
