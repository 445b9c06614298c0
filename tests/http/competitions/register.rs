//! Entrants register, with a key or without.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{fields, list, texts};
use crate::cup::{Cup, server};

#[tokio::test]
async fn who_has_no_key_gets_one_that_is_good_for_the_competition_alone() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let task = json!({ "task": "Flocking" });
    app.post("/api/v1/episodes").token(&blue.key).json(&task).problem(403, "forbidden").await;
    let key = json!({ "name": "more" });
    app.post("/api/v1/keys").token(&blue.key).json(&key).problem(403, "forbidden").await;
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let own = app.get(&path).token(&blue.key).ok().await;
    assert_eq!((&own["name"], &own["attempts"]), (&json!("blue"), &json!([])));
    // Results are nobody else's before the board shows them.
    let red = cup.enter(&app, "red").await;
    app.get(&path).token(&red.key).problem(403, "forbidden").await;
    app.get(&path).problem(401, "unauthorized").await;
    app.get(&path).token(&app.organizer).ok().await;
    let listed = app.get(&cup.path("/entrants")).ok().await;
    assert_eq!(texts(&list(&listed["items"]), "name"), ["blue", "red"]);
    assert!(!listed.to_string().contains("secret_"), "{listed}");
    let own = app.get(&cup.path("/entrants?own=true"));
    own.problem(401, "unauthorized").await;
    let own = app.get(&cup.path("/entrants?own=true")).token(&red.key).ok().await;
    assert_eq!(texts(&list(&own["items"]), "name"), ["red"]);
    let change = app.call(Method::PATCH, &path).token(&blue.key).json(&json!({ "vouched": true }));
    change.problem(403, "forbidden").await;
    for (entry, field) in [
        (json!({ "name": "Blue ", "model": "m" }), "name"),
        (json!({ "name": "", "model": "m" }), "name"),
        (json!({ "name": "green" }), "model"),
        (json!({ "name": "green", "model": "m", "temperature": -1 }), "temperature"),
        (json!({ "name": "green", "model": "m", "top_p": 2 }), "top_p"),
        (json!({ "name": "green", "model": "m", "prompt_template": "{{" }), "prompt_template"),
        (json!({ "name": "green", "model": "m", "code": "x" }), "code"),
        (
            json!({ "name": "green", "model": "m", "agent_meta": { "a": "x".repeat(20_000) } }),
            "agent_meta",
        ),
    ] {
        let call = app.post(&cup.path("/entrants")).json(&entry);
        assert_eq!(fields(&call.problem(422, "invalid").await), [field], "{entry}");
    }
}

#[tokio::test]
async fn a_key_enters_as_often_as_it_may_and_another_model_is_another_entrant() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 2 })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let enter = |model: &str| {
        let entry = json!({ "name": format!("with {model}"), "model": model });
        app.post(&cup.path("/entrants")).token(&member).json(&entry)
    };
    let first = enter("one").ok().await;
    assert_eq!(first["key"], Value::Null, "it has a key");
    let second = enter("two").ok().await;
    assert_ne!(first["id"], second["id"]);
    enter("three").problem(403, "forbidden").await;
    // With two entrants it has to say for which one it starts.
    let start = |body: Value| app.post(&cup.path("/attempts")).token(&member).json(&body);
    assert_eq!(fields(&start(json!({})).problem(422, "invalid").await), ["entrant"]);
    let started = start(json!({ "entrant": second["id"] })).ok().await;
    assert_eq!(started["entrant"], second["id"]);
    start(json!({ "entrant": "ent_0" })).problem(403, "forbidden").await;
    // An organizer's own entrants are vouched for.
    let entry = json!({ "name": "house", "model": "m" });
    let own = app.post(&cup.path("/entrants")).token(&app.organizer).json(&entry).ok().await;
    assert_eq!((&own["vouched"], &first["vouched"]), (&json!(true), &json!(false)));
}

#[tokio::test]
async fn names_that_look_the_same_are_the_same() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    cup.enter(&app, "blue").await;
    let enter = |name: &str| {
        let entry = json!({ "name": name, "model": "m" });
        app.post(&cup.path("/entrants")).json(&entry).send()
    };
    for name in ["blue", " BLUE", "blu\u{435}", "bl\u{200b}ue", "\u{202e}eulb", "   ", "a\u{2028}b"]
    {
        let refused = enter(name).await;
        assert_eq!(refused.status, 422, "{name:?}: {}", refused.text());
        assert_eq!(refused.json()["fields"][0]["field"], "name");
    }
    assert_eq!(enter("green").await.status, 201);
    assert_eq!(enter("\u{3164}").await.status, 422);
}

#[tokio::test]
async fn models_that_look_the_same_are_written_the_same() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let enter = |name: &str, model: &str| {
        let entry = json!({ "name": name, "model": model });
        app.post(&cup.path("/entrants")).json(&entry).send()
    };
    assert_eq!(enter("blue", "family-1").await.status, 201);
    assert_eq!(enter("red", "family-1").await.status, 201, "many may play with one model");
    for model in [
        "Family-1",
        "fam\u{456}ly-1",
        "family-l",
        "family\u{3164}-1",
        "\u{3164}",
        "buiIt-in/random",
    ] {
        let refused = enter("green", model).await;
        assert_eq!(refused.status, 422, "{model:?}: {}", refused.text());
        assert_eq!(refused.json()["fields"][0]["field"], "model", "{model:?}");
    }
    assert_eq!(enter("green", "family-2").await.status, 201);
    let hidden = json!({ "task": "Pursuit", "model": "a\u{ffa0}" });
    app.post("/api/v1/episodes").token(&app.organizer).json(&hidden).problem(422, "invalid").await;
    let label = json!({ "labels": ["good", "\u{3164}"] });
    let call = app.post(&cup.path("/codes")).token(&app.organizer).json(&label);
    assert_eq!(call.problem(422, "invalid").await["fields"][0]["field"], "labels[1]");
}
