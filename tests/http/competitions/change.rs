//! Entrants are disqualified, withdrawn and vouched for.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::fields;
use crate::cup::{Cup, server};

#[tokio::test]
async fn who_is_disqualified_is_shown_with_the_reason_and_without_a_rank() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 4).await;
    cup.start(&app, &red).await.play(&app, 0).await;
    let names = async || {
        let rows = cup.rows(&app, None).await;
        let row = |row: &Value| {
            let name = row["entrant"]["name"].as_str().expect("a name").to_owned();
            (row["rank"].as_u64(), name)
        };
        rows.iter().map(row).collect::<Vec<_>>()
    };
    assert_eq!(names().await, [(Some(1), "blue".to_owned()), (Some(2), "red".to_owned())]);
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let change = |body: Value| app.call(Method::PATCH, &path).token(&app.organizer).json(&body);
    for (body, field) in [
        (json!({ "status": "disqualified" }), "reason"),
        (json!({ "status": "banned", "reason": "x" }), "status"),
        (json!({ "reason": "x" }), "reason"),
        (json!({ "status": "withdrawn", "reason": "" }), "reason"),
        (json!({ "rank": 1 }), "rank"),
    ] {
        assert_eq!(fields(&change(body).problem(422, "invalid").await), [field]);
    }
    let reason = "two entrants of one team";
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": reason })).await;
    assert_eq!(names().await, [(Some(1), "red".to_owned()), (None, "blue".to_owned())]);
    let rows = cup.rows(&app, None).await;
    assert_eq!(rows[1]["entrant"]["reason"], reason);
    assert!(rows[1]["total"].is_number(), "{}", rows[1]);
    let call = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    let problem = call.problem(403, "forbidden").await;
    assert!(problem["detail"].as_str().expect("a text").contains(reason), "{problem}");
    // It can be taken back, and the word of an organizer is shown.
    let changed = cup.change(&app, &blue, json!({ "status": "active", "vouched": true })).await;
    assert_eq!((&changed["reason"], &changed["vouched"]), (&Value::Null, &json!(true)));
    assert_eq!(names().await[0].1, "blue");
    cup.start(&app, &blue).await;
    cup.change(&app, &red, json!({ "status": "withdrawn" })).await;
    assert_eq!(cup.rows(&app, None).await[1]["entrant"]["status"], "withdrawn");
}
