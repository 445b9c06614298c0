//! Teams: several keys for one entrant.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{Call, TestApp, fields, list, texts};
use crate::cup::{Attempt, Cup, server};

fn add(app: &TestApp, path: &str, key: &str, name: &str) -> Call {
    app.post(path).token(key).json(&json!({ "name": name }))
}

fn text(value: &Value) -> &str {
    value.as_str().expect("a text")
}

#[tokio::test]
async fn members_of_a_team_have_keys_that_do_the_same() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let path = cup.path(&format!("/entrants/{}/members", blue.id));
    let ada = add(&app, &path, &blue.key, "Ada").ok().await;
    // A member adds another one.
    let grace = add(&app, &path, text(&ada["key"]), "Grace").ok().await;
    let key = text(&grace["key"]).to_owned();
    let started = app.post(&cup.path("/attempts")).token(&key).ok().await;
    assert_eq!(started["entrant"], json!(blue.id));
    Attempt::of(&started).play(&app, 1).await;
    let own = app.get(&cup.path(&format!("/entrants/{}", blue.id))).token(text(&ada["key"]));
    assert_eq!(list(&own.ok().await["attempts"]).len(), 1);
    let attempts = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(list(&attempts["items"]).len(), 1);
    let listed = app.get(&path).token(&key).ok().await;
    assert_eq!(texts(&list(&listed["items"]), "name"), ["Ada", "Grace"]);
    assert!(!listed.to_string().contains("secret_"), "{listed}");

    // Others see and change nothing of it.
    app.get(&path).token(&red.key).problem(403, "forbidden").await;
    app.get(&path).problem(401, "unauthorized").await;
    add(&app, &path, &red.key, "Eve").problem(403, "forbidden").await;
    let of_ada = format!("{path}/{}", text(&ada["id"]));
    app.call(Method::DELETE, &of_ada).token(&red.key).problem(403, "forbidden").await;
    let elsewhere = cup.path(&format!("/entrants/{}/members/{}", red.id, text(&ada["id"])));
    app.call(Method::DELETE, &elsewhere).token(&red.key).problem(404, "not_found").await;
    assert_eq!(fields(&add(&app, &path, &key, " ").problem(422, "invalid").await), ["name"]);
    // A member's key enters nothing else and creates nothing, as the first one.
    let task = json!({ "task": "Flocking" });
    app.post("/api/v1/episodes").token(&key).json(&task).problem(403, "forbidden").await;

    let removed = app.call(Method::DELETE, &of_ada).token(&blue.key).ok().await;
    assert!(removed["removed_at"].is_string(), "{removed}");
    app.get(&path).token(text(&ada["key"])).problem(401, "unauthorized").await;
    app.get(&path).token(&key).ok().await;
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    assert!(!texts(&list(&log["items"]), "action").contains(&"member.add".to_owned()));
    add(&app, &path, &app.organizer, "Alan").ok().await;
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    assert_eq!(list(&log["items"])[0]["action"], "member.add");
    // Everybody sees that an organizer changed a team, and nobody who is in it.
    let alan = list(&app.get(&path).token(&key).ok().await["items"])[2].clone();
    let of_alan = format!("{path}/{}", text(&alan["id"]));
    app.call(Method::DELETE, &of_alan).token(&app.organizer).ok().await;
    let seen = app.get(&cup.path("/actions")).ok().await;
    assert_eq!(texts(&list(&seen["items"]), "action"), ["member.remove", "member.add"]);
    assert_eq!(texts(&list(&seen["items"]), "subject"), [&*blue.id, &*blue.id]);
    assert!(!seen.to_string().contains("Alan") && !seen.to_string().contains("key_"), "{seen}");
}

#[tokio::test]
async fn a_team_has_an_end_and_a_largest_size() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let path = cup.path(&format!("/entrants/{}/members", blue.id));
    let mut keys = Vec::new();
    for number in 0..20 {
        let made = add(&app, &path, &blue.key, &format!("member {number}")).ok().await;
        keys.push(text(&made["key"]).to_owned());
    }
    let problem = add(&app, &path, &blue.key, "one more").problem(403, "forbidden").await;
    assert_eq!(problem["limit"]["name"], "members_max", "{problem}");

    // All keys end with the entrant, and the names with them.
    let entrant = cup.path(&format!("/entrants/{}", blue.id));
    app.call(Method::DELETE, &entrant).token(&blue.key).ok().await;
    for key in keys.iter().chain([&blue.key]) {
        app.get(&path).token(key).problem(401, "unauthorized").await;
    }
    let listed = app.get(&path).token(&app.organizer).ok().await;
    assert!(!listed.to_string().contains("member 3"), "{listed}");
    add(&app, &path, &app.organizer, "Ada").problem(409, "closed").await;
}

#[tokio::test]
async fn an_entrant_with_a_key_of_its_own_shares_it_with_nobody() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let request = json!({ "name": "own", "role": "member" });
    let own = app.post("/api/v1/keys").token(&app.organizer).json(&request).ok().await;
    let own = text(&own["secret"]).to_owned();
    let entry = json!({ "name": "blue", "model": "m" });
    let made = app.post(&cup.path("/entrants")).token(&own).json(&entry).ok().await;
    let path = cup.path(&format!("/entrants/{}/members", text(&made["id"])));
    let problem = add(&app, &path, &own, "Ada").problem(409, "closed").await;
    assert!(text(&problem["detail"]).contains("key of its own"), "{problem}");
}
