//! Lists of competitions.

use serde_json::{Value, json};

use crate::app::{list, texts};
use crate::cup::{Cup, server};

#[tokio::test]
async fn competitions_are_listed_page_by_page() {
    let app = server().await;
    let mut made = Vec::new();
    for place in 0..3 {
        made.insert(0, Cup::with(&app, json!({ "name": format!("cup {place}") })).await.id);
    }
    let first = app.get("/api/v1/competitions?limit=2").ok().await;
    let cursor = first["next_cursor"].as_str().expect("there is more");
    let rest = app.get(&format!("/api/v1/competitions?limit=2&cursor={cursor}")).ok().await;
    assert_eq!(rest["next_cursor"], Value::Null);
    let ids = [list(&first["items"]), list(&rest["items"])].concat();
    assert_eq!(texts(&ids, "id"), made);
    app.get("/api/v1/competitions?limit=0").problem(400, "malformed").await;
    app.get("/api/v1/competitions?cursor=x").problem(400, "malformed").await;
}
