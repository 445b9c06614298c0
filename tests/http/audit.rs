//! The audit log: what organizers do.

use serde_json::json;

use crate::app::{list, texts};
use crate::cup::{Cup, server};

#[tokio::test]
async fn what_organizers_do_is_in_the_audit_log() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({ "entry": "codes" })).await;
    let labels = json!({ "labels": ["blue"] });
    let codes = app.post(&cup.path("/codes")).token(&app.organizer).json(&labels).ok().await;
    let entry = json!({ "name": "blue", "model": "m", "code": codes["items"][0]["code"] });
    let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
    let blue = crate::cup::Entrant {
        id: made["id"].as_str().expect("an id").to_owned(),
        key: made["key"].as_str().expect("a key").to_owned(),
    };
    let attempt = cup.start(&app, &blue).await;
    cup.void(&app, &attempt, "a power cut").await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "unfair" })).await;
    let (member, key) = app.key(json!({ "name": "member" })).await;
    app.delete(&format!("/api/v1/keys/{key}")).token(&app.organizer).ok().await;
    app.delete(&format!("/api/v1/keys/{key}")).token(&app.organizer).ok().await;
    let (other, _) = app.key(json!({ "name": "other" })).await;
    let of_member = app.create_with(&other, json!({ "task": "Flocking" })).await;
    app.delete(&of_member.path("")).token(&app.organizer).ok().await;
    let own = app.create_with(&app.organizer, json!({ "task": "Flocking" })).await;
    app.delete(&own.path("")).token(&app.organizer).ok().await;
    let export = format!("/api/v1/exports/competitions/{}", cup.id);
    assert_eq!(app.get(&export).token(&app.organizer).send().await.status, 200);
    app.restart().await;
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    let mut items = list(&log["items"]);
    items.reverse();
    let audited: Vec<(String, String)> =
        texts(&items, "action").into_iter().zip(texts(&items, "subject")).collect();
    let expected = [
        ("competition.create", cup.id.as_str()),
        ("competition.codes", &cup.id),
        ("attempt.void", &attempt.run),
        ("entrant.change", &blue.id),
        ("key.create", &key),
        ("key.revoke", &key),
        ("key.create", ""),
        ("episode.abort", &of_member.id),
        ("competition.export", &cup.id),
    ];
    assert_eq!(audited.len(), expected.len(), "{audited:#?}");
    for ((action, subject), (what, of)) in audited.iter().zip(expected) {
        assert!(action == what && (of.is_empty() || of == subject), "{action} {subject}");
    }
    assert!(texts(&items, "who").iter().all(|who| who.starts_with("key_")), "{log}");
    assert_eq!(items[3]["detail"]["reason"], "unfair");
    assert!(!log.to_string().contains("invite_") && !log.to_string().contains("secret_"));
    // Page by page.
    let page = app.get("/api/v1/audit?limit=4").token(&app.organizer).ok().await;
    let cursor = page["next_cursor"].as_str().expect("there is more");
    let rest = app.get(&format!("/api/v1/audit?cursor={cursor}")).token(&app.organizer).ok().await;
    assert_eq!(list(&page["items"]).len() + list(&rest["items"]).len(), expected.len());
    app.get("/api/v1/audit").token(&member).problem(401, "unauthorized").await;
    app.get("/api/v1/audit").token(&other).problem(403, "forbidden").await;
}
