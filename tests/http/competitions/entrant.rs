//! Entrants rename, withdraw and erase themselves, and organizers do it for them.

use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{Call, TestApp, fields, list};
use crate::cup::{Cup, Entrant, server};

fn path(cup: &Cup, entrant: &Entrant) -> String {
    cup.path(&format!("/entrants/{}", entrant.id))
}

fn change(app: &TestApp, cup: &Cup, entrant: &Entrant, key: &str, change: &Value) -> Call {
    app.call(Method::PATCH, &path(cup, entrant)).token(key).json(change)
}

fn erase(app: &TestApp, cup: &Cup, entrant: &Entrant, key: &str) -> Call {
    app.call(Method::DELETE, &path(cup, entrant)).token(key)
}

#[tokio::test]
async fn an_attempt_is_started_without_a_body() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let started = app.post(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(started["attempt"], 1);
    let wrong = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({ "attemt": 2 }));
    assert_eq!(fields(&wrong.problem(422, "invalid").await), ["attemt"]);
}

#[tokio::test]
async fn an_entrant_renames_and_withdraws_itself_and_nobody_else() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let name = |name: &str| json!({ "name": name });
    let renamed = change(&app, &cup, &blue, &blue.key, &name("Blue!")).ok().await;
    assert_eq!(renamed["name"], "Blue!");
    let problem = change(&app, &cup, &blue, &blue.key, &name("RED")).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["name"]);
    change(&app, &cup, &red, &blue.key, &name("x")).problem(403, "forbidden").await;
    for refused in [
        json!({ "vouched": true }),
        json!({ "status": "active" }),
        json!({ "status": "disqualified", "reason": "x" }),
    ] {
        change(&app, &cup, &blue, &blue.key, &refused).problem(403, "forbidden").await;
    }
    let leaves = json!({ "status": "withdrawn", "reason": "we have no time" });
    assert_eq!(change(&app, &cup, &blue, &blue.key, &leaves).ok().await["status"], "withdrawn");
    let call = app.post(&cup.path("/attempts")).token(&blue.key);
    call.problem(403, "forbidden").await;
    cup.change(&app, &blue, json!({ "status": "active" })).await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    change(&app, &cup, &blue, &blue.key, &leaves).problem(403, "forbidden").await;
    // Names stay once the file is published.
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    change(&app, &cup, &red, &red.key, &name("late")).problem(409, "closed").await;
}

#[tokio::test]
async fn an_erased_entrant_leaves_for_good_and_what_is_published_stays() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    cup.start(&app, &blue).await.play(&app, 4).await;
    cup.start(&app, &red).await.play(&app, 2).await;
    erase(&app, &cup, &blue, &red.key).problem(403, "forbidden").await;
    let erased = erase(&app, &cup, &blue, &blue.key).ok().await;
    let name = format!("erased {}", blue.id);
    assert_eq!((&erased["name"], &erased["status"]), (&json!(name), &json!("withdrawn")));
    let call = app.get(&path(&cup, &blue)).token(&blue.key);
    call.problem(401, "unauthorized").await;
    change(&app, &cup, &blue, &app.organizer, &json!({ "status": "active" }))
        .problem(409, "closed")
        .await;
    let replaced = app.post(&format!("{}/key", path(&cup, &blue))).token(&app.organizer);
    replaced.problem(409, "closed").await;
    let keys = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    assert!(!keys.to_string().contains("\"blue\""), "{keys}");
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    let published = cup.export(&app).await;
    assert!(!published.contains("\"blue\"") && published.contains(&name));
    // The file of what is over stays as it is, and its head with it.
    erase(&app, &cup, &red, &red.key).ok().await;
    assert_eq!(cup.export(&app).await, published);
    let rows = cup.rows(&app, None).await;
    assert_eq!(
        (&rows[0]["rank"], &rows[0]["entrant"]["name"]),
        (&json!(1), &json!(format!("erased {}", red.id)))
    );
}

#[tokio::test]
async fn who_erased_itself_does_not_return_with_the_same_key() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 5 })).await;
    let (member, _) = app.key(json!({ "role": "member", "name": "team" })).await;
    let entry = |name: &str| {
        let entry = json!({ "name": name, "model": "m" });
        app.post(&cup.path("/entrants")).token(&member).json(&entry)
    };
    let made = entry("blue").ok().await;
    let own = Entrant { id: made["id"].as_str().expect("an id").to_owned(), key: member.clone() };
    erase(&app, &cup, &own, &member).ok().await;
    let problem = entry("blue again").problem(403, "forbidden").await;
    assert!(problem["detail"].to_string().contains("erased"), "{problem}");
    // A key that was not made for the entrant stays as it is.
    app.get("/api/v1/episodes").token(&member).ok().await;
    let replaced = app.post(&format!("{}/key", path(&cup, &own))).token(&app.organizer);
    replaced.problem(409, "closed").await;
}

#[tokio::test]
async fn an_organizer_replaces_a_lost_key() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let first = cup.start(&app, &blue).await;
    first.play(&app, 4).await;
    let path = format!("{}/key", path(&cup, &blue));
    app.post(&path).token(&blue.key).problem(403, "forbidden").await;
    let replaced = app.post(&path).token(&app.organizer).ok().await;
    let key = replaced["key"].as_str().expect("a key").to_owned();
    app.post(&cup.path("/attempts")).token(&blue.key).problem(401, "unauthorized").await;
    let blue = Entrant { key, ..blue };
    let own = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(own["items"][0]["run"], first.run.as_str(), "its attempts are still its own");
    assert_eq!(cup.start(&app, &blue).await.number, 2);
    let log = app.get(&cup.path("/actions")).ok().await;
    assert_eq!(list(&log["items"])[0]["action"], "entrant.key");
}

#[tokio::test]
async fn as_many_attempts_are_started_on_a_day_as_may_be() {
    let app = server().await;
    let closes =
        json!({ "closes_at": "2026-03-05T13:00:00Z", "attempts": 3, "attempts_per_day": 1 });
    let cup = Cup::open(&app, closes).await;
    assert_eq!(cup.created["attempts_per_day"], 1);
    let blue = cup.enter(&app, "blue").await;
    cup.start(&app, &blue).await.play(&app, 4).await;
    let problem = app.post(&cup.path("/attempts")).token(&blue.key).problem(409, "closed").await;
    assert!(problem["detail"].to_string().contains("2026-03-02T00:00:00Z"), "{problem}");
    app.pass(Duration::from_hours(12));
    assert_eq!(cup.start(&app, &blue).await.number, 2);
}

#[tokio::test]
async fn what_organizers_rewrite_is_noted_without_the_words() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let words = json!({ "name": "azure", "contact": "ada@example.org" });
    change(&app, &cup, &blue, &app.organizer, &words).ok().await;
    let seen = app.get(&cup.path("/actions")).ok().await;
    let items = list(&seen["items"]);
    assert_eq!(items.len(), 1, "{seen}");
    assert_eq!(
        (&items[0]["action"], &items[0]["subject"]),
        (&json!("entrant.change"), &json!(blue.id))
    );
    assert_eq!(items[0]["detail"], json!({ "rewritten": ["name", "contact"] }));
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    assert_eq!(list(&log["items"])[0]["action"], "entrant.change");
    assert!(!log.to_string().contains("azure") && !log.to_string().contains("ada@"), "{log}");
    // The same name again is no change.
    change(&app, &cup, &blue, &app.organizer, &json!({ "name": "azure" })).ok().await;
    assert_eq!(app.get(&cup.path("/actions")).ok().await, seen);
}

#[tokio::test]
async fn why_an_entrant_left_is_erased_with_it_and_why_it_was_excluded_is_not() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let leaves = json!({ "status": "withdrawn", "reason": "Ada has another cup" });
    change(&app, &cup, &blue, &blue.key, &leaves).ok().await;
    let excluded = json!({ "status": "disqualified", "reason": "two teams" });
    cup.change(&app, &red, excluded).await;
    for entrant in [&blue, &red] {
        erase(&app, &cup, entrant, &entrant.key).ok().await;
    }
    let board = app.get(&cup.path("/board")).ok().await;
    assert!(!board.to_string().contains("Ada"), "{board}");
    let reasons: Vec<_> =
        list(&board["items"]).iter().map(|row| row["entrant"]["reason"].clone()).collect();
    assert_eq!(reasons, ["its personal data were erased", "two teams"]);
}

#[tokio::test]
async fn an_entrant_changes_nothing_of_a_published_file() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "terms": "one entrant for each team" })).await;
    let entry = json!({ "name": "blue", "model": "m", "accepts_terms": 1 });
    let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
    let text = |field: &str| made[field].as_str().expect("a text").to_owned();
    let blue = Entrant { id: text("id"), key: text("key") };
    let call = app.call(Method::PATCH, &cup.path("")).token(&app.organizer);
    call.json(&json!({ "terms": "logs are published" })).ok().await;
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    let published = cup.export(&app).await;
    for late in [json!({ "status": "withdrawn" }), json!({ "accepts_terms": 2 })] {
        change(&app, &cup, &blue, &blue.key, &late).problem(409, "closed").await;
    }
    // A contact is no part of it, and neither is the name of an entrant that is erased now.
    change(&app, &cup, &blue, &blue.key, &json!({ "contact": "ada@example.org" })).ok().await;
    erase(&app, &cup, &blue, &blue.key).ok().await;
    assert_eq!(cup.export(&app).await, published);
}
