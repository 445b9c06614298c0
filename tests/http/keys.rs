//! Keys for people, and to whom a server without keys opens.

use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{TestApp, fields, list};

fn request() -> Value {
    json!({ "task": "Synchronization", "num_agents": 2, "max_round": 3 })
}

#[tokio::test]
async fn a_key_is_made_shown_once_listed_and_revoked() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    let wanted = json!({ "name": "team blue", "expires_at": "2026-03-02T12:00:00Z" });
    let made = app.post("/api/v1/keys").token(&app.organizer).json(&wanted).send().await;
    assert_eq!((made.status, made.header("cache-control")), (201, "no-store"));
    let made = made.json();
    assert_eq!((&made["role"], &made["state"]), (&json!("member"), &json!("good")));
    let secret = made["secret"].as_str().expect("a key").to_owned();
    assert!(secret.starts_with("secret_"));
    let episode = app.create_with(&secret, request()).await;

    let listed = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    let names: Vec<_> = list(&listed["items"]).iter().map(|key| key["name"].clone()).collect();
    assert_eq!(names, ["the organizer", "team blue"]);
    assert!(!listed.to_string().contains("secret_"), "{listed}");

    let own = app.get("/api/v1/keys/self").token(&secret).ok().await;
    assert_eq!((&own, &own["name"]), (&listed["items"][1], &json!("team blue")));
    app.get("/api/v1/keys/self").problem(401, "unauthorized").await;
    app.get("/api/v1/keys/self").token(&episode.swarm).problem(403, "forbidden").await;

    let path = format!("/api/v1/keys/{}", made["id"].as_str().expect("an id"));
    let revoked = app.delete(&path).token(&app.organizer).ok().await;
    assert_eq!(revoked["state"], "revoked");
    app.pass(Duration::from_secs(1));
    assert_eq!(app.delete(&path).token(&app.organizer).ok().await, revoked, "again");
    app.post("/api/v1/episodes").token(&secret).json(&request()).problem(401, "unauthorized").await;
    app.delete("/api/v1/keys/key_0").token(&app.organizer).problem(404, "not_found").await;

    // What was created with it continues, also after a restart, and the key stays revoked.
    app.restart().await;
    app.all_act(&episode, "SWITCH").await;
    app.get(&episode.path("")).token(&secret).problem(401, "unauthorized").await;
    app.delete(&episode.path("")).token(&app.organizer).ok().await;
}

#[tokio::test]
async fn a_key_ends_at_its_time() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let wanted = json!({ "name": "short", "expires_at": "2026-03-01T12:00:10Z" });
    let (secret, _) = app.key(wanted).await;
    app.pass(Duration::from_millis(9_999));
    app.get("/api/v1/episodes").token(&secret).ok().await;
    app.pass(Duration::from_millis(1));
    app.get("/api/v1/episodes").token(&secret).problem(401, "unauthorized").await;
    let listed = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    assert_eq!(listed["items"][1]["state"], "expired");
}

#[tokio::test]
async fn bad_keys_are_refused_by_field() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    for (body, field) in [
        (json!({ "name": "" }), "name"),
        (json!({ "name": "a\u{7}b" }), "name"),
        (json!({ "name": "x".repeat(101) }), "name"),
        (json!({}), "name"),
        (json!({ "name": "a", "role": "king" }), "role"),
        (json!({ "name": "a", "expires_at": "2026-03-01T12:00:00Z" }), "expires_at"),
        (json!({ "name": "a", "expires_at": "tomorrow" }), "expires_at"),
        (json!({ "name": "a", "seed": 1 }), "seed"),
    ] {
        let call = app.post("/api/v1/keys").token(&app.organizer).json(&body);
        assert_eq!(fields(&call.problem(422, "invalid").await), [field], "{body}");
    }
    assert_eq!(list(&app.get("/api/v1/keys").token(&app.organizer).ok().await["items"]).len(), 1);
}

#[tokio::test]
async fn on_a_server_with_keys_episodes_belong_to_their_creator() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    app.post("/api/v1/episodes").json(&request()).problem(401, "unauthorized").await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (red, _) = app.key(json!({ "name": "red" })).await;
    let episode = app.create_with(&blue, request()).await;
    assert_eq!(episode.config["visibility"], "owner", "the default");
    // The same name for a creation is another one for somebody else.
    let create = |key: &str| {
        let call = app.post("/api/v1/episodes").token(key).json(&request());
        call.header("Idempotency-Key", "first")
    };
    let (own, other) = (create(&blue).ok().await, create(&red).ok().await);
    assert_ne!(own["id"], other["id"]);
    assert_eq!(create(&blue).ok().await["id"], own["id"]);
    app.get(&episode.path("/state")).token(&red).problem(404, "not_found").await;
    app.delete(&episode.path("")).token(&red).problem(404, "not_found").await;
    app.get(&episode.path("/journal")).token(&blue).send().await;
    assert_eq!(app.delete(&episode.path("")).token(&blue).ok().await["status"], "aborted");
    // Afterwards everybody reads it.
    assert_eq!(app.get(&episode.path("/state")).ok().await["round"], 0);
}

#[tokio::test]
async fn a_server_without_keys_opens_to_programs_on_its_machine_only() {
    let app = TestApp::start().await;
    let episode = app.create(request()).await;
    let foreign = [
        ("host", "swarm.example"),
        ("x-forwarded-for", "198.51.100.7"),
        ("via", "1.1 proxy"),
        ("origin", "https://evil.example"),
    ];
    for (name, value) in foreign {
        let create = app.post("/api/v1/episodes").json(&request()).header(name, value);
        create.problem(403, "forbidden").await;
        let start = app.post(&episode.path("/start")).header(name, value);
        start.problem(403, "forbidden").await;
        app.delete(&episode.path("")).header(name, value).problem(403, "forbidden").await;
        app.get(&episode.path("/journal")).header(name, value).problem(403, "forbidden").await;
        // What is public may be watched, and tokens are good from everywhere.
        app.get(&episode.path("/state")).header(name, value).ok().await;
        app.get("/obs").token(episode.seat(0)).header(name, value).ok().await;
    }
    // A page of a browser cannot send JSON to another site without asking first, and is not allowed to.
    let text = app.call(Method::OPTIONS, "/api/v1/episodes");
    let asked = text.header("origin", "https://evil.example").send().await;
    assert_eq!((asked.status, asked.header("access-control-allow-origin")), (405, ""));
    app.create(request()).await;

    let open = TestApp::builder().access(|access| access.open = true).start().await;
    open.post("/api/v1/episodes").json(&request()).header("host", "swarm.example").ok().await;
}

/// A browser sends some requests for a page of any site without asking first: those that have no body, or a plain one.
#[tokio::test]
async fn a_page_of_another_site_changes_nothing_on_an_open_server() {
    let open = TestApp::builder().access(|access| access.open = true).start().await;
    let manual = || {
        let mut request = request();
        request["start"] = json!("manual");
        request
    };
    let episode = open.create(manual()).await;
    let own = ("host", "swarm.example:8080");
    for foreign in [
        ("origin", "https://evil.example"),
        ("origin", "http://192.0.2.9"),
        ("origin", "null"),
        ("sec-fetch-site", "cross-site"),
    ] {
        for (method, path) in [
            (Method::POST, episode.path("/start")),
            (Method::DELETE, episode.path("")),
            (Method::POST, "/api/v1/episodes".to_owned()),
            (Method::POST, "/api/v1/nothing".to_owned()),
        ] {
            let call = open.call(method, &path).header(own.0, own.1).header(foreign.0, foreign.1);
            let problem = call.problem(403, "forbidden").await;
            let said = problem["detail"].as_str().expect("a detail");
            assert!(said.contains(foreign.1) && said.contains("another site"), "{said}");
        }
        // Pages of other sites may read what all may read, and a token is good from everywhere.
        open.get(&episode.path("/state")).header(foreign.0, foreign.1).ok().await;
        let act = json!({ "round": 7, "action": "STAY" });
        let act = open.post("/act").json(&act).token(episode.seat(0));
        act.header(foreign.0, foreign.1).problem(409, "round_ahead").await;
    }
    // Its own pages, also behind a proxy that changes `Host`, and programs, which have no origin, change what they may.
    for headers in [
        &[("origin", "http://swarm.example:8080"), ("sec-fetch-site", "same-origin")][..],
        &[("origin", "https://public.example"), ("sec-fetch-site", "same-origin")],
        &[("origin", "http://SWARM.example")],
        &[("origin", "http://localhost:3000"), ("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "none")],
        &[],
    ] {
        let episode = open.create(manual()).await;
        let start = open.post(&episode.path("/start")).header(own.0, own.1);
        let start = headers.iter().fold(start, |call, (name, value)| call.header(name, value));
        start.ok().await;
    }
}
