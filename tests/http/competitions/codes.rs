//! Invitation codes.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{fields, list, texts};
use crate::cup::{Cup, pass_minutes, server};

#[tokio::test]
async fn an_invitation_code_is_good_once() {
    let app = server().await;
    let cup = Cup::with(&app, json!({ "entry": "codes" })).await;
    let other = Cup::with(&app, json!({ "entry": "codes" })).await;
    let codes = async |cup: &Cup, labels: Value| {
        let call = app.post(&cup.path("/codes")).token(&app.organizer);
        call.json(&json!({ "labels": labels })).ok().await
    };
    let made = codes(&cup, json!(["team blue", "team red"])).await;
    let code = |place: usize| made["items"][place]["code"].as_str().expect("a code").to_owned();
    assert_eq!(made["items"][1]["label"], "team red");
    let elsewhere = codes(&other, json!(["them"])).await["items"][0]["code"].clone();
    let enter = |name: &str, code: Value| {
        let entry = json!({ "name": name, "model": "m", "code": code });
        app.post(&cup.path("/entrants")).json(&entry)
    };
    for wrong in [Value::Null, json!("invite_x"), elsewhere, json!(app.organizer)] {
        enter("blue", wrong).problem(403, "forbidden").await;
    }
    // A name that is not allowed uses no code up.
    enter("", json!(code(0))).problem(422, "invalid").await;
    enter("blue", json!(code(0))).ok().await;
    enter("red", json!(code(0))).problem(403, "forbidden").await;
    enter("red", json!(code(1))).ok().await;
    // Of many who use one at the same time one is let in.
    let last = codes(&cup, json!(["last"])).await["items"][0]["code"].clone();
    let all = futures::future::join_all((0..8).map(|place| {
        let call = enter(&format!("racer {place}"), last.clone());
        async move { call.send().await.status }
    }));
    let mut all = all.await;
    all.sort_unstable();
    assert_eq!(all, [201, 403, 403, 403, 403, 403, 403, 403]);
    // A code is no token.
    app.get("/api/v1/episodes").token(&code(1)).problem(401, "unauthorized").await;
    for (labels, field) in [
        (json!([]), "labels"),
        (json!(["x".repeat(101)]), "labels[0]"),
        (json!(["a", "b\n"]), "labels[1]"),
    ] {
        let call = app.post(&cup.path("/codes")).token(&app.organizer);
        let call = call.json(&json!({ "labels": labels }));
        assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
    }
    pass_minutes(&app, 60).await;
    enter("late", json!(code(1))).problem(409, "closed").await;
    let call = app.post(&cup.path("/codes")).token(&app.organizer);
    call.json(&json!({ "labels": ["late"] })).problem(409, "closed").await;
}

#[tokio::test]
async fn the_label_of_a_code_is_erased_with_the_entrant_that_used_it() {
    let mut app = server().await;
    let cup = Cup::with(&app, json!({ "entry": "codes" })).await;
    let labels = json!({ "labels": ["Ada L. <ada@example.org>", "grace"] });
    let made = app.post(&cup.path("/codes")).token(&app.organizer).json(&labels).ok().await;
    // Earlier versions recorded labels in the audit log.
    app.stop().await;
    app.tamper(
        "UPDATE audit SET detail = '{\"labels\":[\"Ada L.\"]}' WHERE action = 'competition.codes'",
    )
    .await;
    app.start_again().await;
    let entry = json!({ "name": "blue", "model": "m", "code": made["items"][0]["code"] });
    let blue = app.post(&cup.path("/entrants")).json(&entry).ok().await;
    let (id, key) = (blue["id"].as_str().expect("an id"), blue["key"].as_str().expect("a key"));
    let path = cup.path(&format!("/entrants/{id}"));
    app.call(Method::DELETE, &path).token(key).ok().await;
    let codes = app.get(&cup.path("/codes")).token(&app.organizer).ok().await;
    let mut left = texts(&list(&codes["items"]), "label");
    left.sort();
    assert_eq!(left, [&*format!("erased {id}"), "grace"]);
    for read in ["/api/v1/audit", &cup.path("/actions")] {
        let all = app.get(read).token(&app.organizer).ok().await.to_string();
        assert!(!all.contains("Ada"), "{read}: {all}");
    }
}
