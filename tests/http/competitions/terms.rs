//! Terms that entrants accept, their categories, and how organizers reach them.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{Call, TestApp, fields, list, texts};
use crate::cup::{Cup, server};

fn patch(app: &TestApp, path: &str, key: &str, change: &Value) -> Call {
    app.call(Method::PATCH, path).token(key).json(change)
}

fn entry(name: &str, more: &Value) -> Value {
    let mut entry = json!({ "name": name, "model": format!("model of {name}") });
    for (field, value) in more.as_object().expect("fields") {
        entry[field] = value.clone();
    }
    entry
}

#[tokio::test]
async fn who_enters_accepts_the_newest_terms_and_keeps_their_version() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "terms": "Be fair." })).await;
    assert_eq!(cup.created["terms"], json!({ "version": 1, "text": "Be fair." }));
    let enter =
        |name: &str, more: Value| app.post(&cup.path("/entrants")).json(&entry(name, &more));
    for accepted in [json!({}), json!({ "accepts_terms": 2 }), json!({ "accepts_terms": 0 })] {
        let problem = enter("blue", accepted).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["accepts_terms"]);
    }
    let blue = enter("blue", json!({ "accepts_terms": 1 })).ok().await;
    assert_eq!(blue["terms"], 1);

    let change =
        json!({ "terms": "Be fair, and publish your prompts.", "reason": "asked by many" });
    let changed = patch(&app, &cup.path(""), &app.organizer, &change).ok().await;
    assert_eq!(changed["terms"]["version"], 2);
    let again = patch(&app, &cup.path(""), &app.organizer, &change).ok().await;
    assert_eq!(again["terms"]["version"], 2, "the same text is no other version");
    let actions = list(&app.get(&cup.path("/actions")).ok().await["items"]);
    assert_eq!(actions[0]["detail"]["changes"][0]["from"]["version"], 1);
    assert_eq!(actions[0]["detail"]["changes"][0]["to"]["text"], change["terms"]);
    let problem = enter("red", json!({ "accepts_terms": 1 })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["accepts_terms"]);

    // Who has entered plays by the version that it accepted, and may accept the newest.
    let (id, key) = (blue["id"].as_str().expect("an id"), blue["key"].as_str().expect("a key"));
    app.post(&cup.path("/attempts")).token(key).ok().await;
    let path = cup.path(&format!("/entrants/{id}"));
    let accept = |version: u32| json!({ "accepts_terms": version });
    patch(&app, &path, &app.organizer, &accept(2)).problem(403, "forbidden").await;
    patch(&app, &path, key, &accept(3)).problem(422, "invalid").await;
    assert_eq!(patch(&app, &path, key, &accept(2)).ok().await["terms"], 2);

    let without = Cup::open(&app, json!({})).await;
    let needless = entry("blue", &json!({ "accepts_terms": 1, "category": "models" }));
    let problem =
        app.post(&without.path("/entrants")).json(&needless).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["category", "accepts_terms"]);
}

#[tokio::test]
async fn each_category_has_a_board_of_its_own() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "categories": ["models", "rules"] })).await;
    let enter =
        |name: &str, more: Value| app.post(&cup.path("/entrants")).json(&entry(name, &more));
    for category in [json!({}), json!({ "category": "people" })] {
        let problem = enter("blue", category).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["category"]);
        assert!(problem.to_string().contains("models, rules"), "{problem}");
    }
    let mut keys = Vec::new();
    for (name, category, skill) in
        [("blue", "models", 4), ("red", "rules", 2), ("green", "rules", 1)]
    {
        let made = enter(name, json!({ "category": category })).ok().await;
        assert_eq!(made["category"], category);
        let key = made["key"].as_str().expect("a key").to_owned();
        let started = app.post(&cup.path("/attempts")).token(&key).ok().await;
        crate::cup::Attempt::of(&started).play(&app, skill).await;
        keys.push((cup.path(&format!("/entrants/{}", made["id"].as_str().expect("an id"))), key));
    }
    let board = |query: &'static str| app.get(&cup.path(&format!("/board{query}")));
    let ranks = |board: &Value| {
        let rows = list(&board["items"]);
        rows.iter()
            .map(|row| {
                format!("{} {}", row["rank"], row["entrant"]["name"].as_str().expect("a name"))
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(ranks(&board("").ok().await), ["1 blue", "2 red", "3 green"]);
    let rules = board("?category=rules").ok().await;
    assert_eq!(
        (ranks(&rules), &rules["category"]),
        (vec!["1 red".to_owned(), "2 green".to_owned()], &json!("rules"))
    );
    let problem = board("?category=people").problem(400, "malformed").await;
    assert_eq!(problem["detail"], "category must be one of models, rules");
    let csv = board("?format=csv&category=models").send().await.text();
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = lines[0].iter().position(|name| *name == "category").expect("a column");
    assert_eq!((lines.len(), lines[1][column]), (2, "models"));

    // Organizers move an entrant; it does not move itself.
    let (path, key) = &keys[2];
    let moves = json!({ "category": "models" });
    patch(&app, path, key, &moves).problem(403, "forbidden").await;
    patch(&app, path, &app.organizer, &json!({ "category": "x" })).problem(422, "invalid").await;
    assert_eq!(patch(&app, path, &app.organizer, &moves).ok().await["category"], "models");
    assert_eq!(ranks(&board("?category=models").ok().await), ["1 blue", "2 green"]);
    let actions = list(&app.get(&cup.path("/actions")).ok().await["items"]);
    assert_eq!(actions[0]["detail"]["category"], json!({ "from": "rules", "to": "models" }));
}

#[tokio::test]
async fn a_contact_is_seen_by_organizers_and_its_entrant_alone_and_erased_with_it() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let contact = "ada@example.org";
    let made =
        app.post(&cup.path("/entrants")).json(&entry("blue", &json!({ "contact": contact })));
    let made = made.ok().await;
    assert!(!made.to_string().contains(contact), "{made}");
    let (id, key) = (made["id"].as_str().expect("an id"), made["key"].as_str().expect("a key"));
    let path = cup.path(&format!("/entrants/{id}"));
    let request = json!({ "name": "judge", "role": "judge" });
    let judge = app.post("/api/v1/keys").token(&app.organizer).json(&request).ok().await;
    let judge = judge["secret"].as_str().expect("a key");
    let shown = async |token: &str| app.get(&path).token(token).ok().await["contact"].clone();
    assert_eq!(shown(key).await, contact);
    assert_eq!(shown(&app.organizer).await, contact);
    assert_eq!(shown(judge).await, Value::Null);
    for public in ["/entrants", "/board", "/actions"] {
        let text = app.get(&cup.path(public)).token(judge).ok().await.to_string();
        assert!(!text.contains(contact), "{public}: {text}");
    }
    let export = format!("/api/v1/exports/competitions/{}", cup.id);
    let file = app.get(&export).token(&app.organizer).send().await.text();
    assert!(!file.contains(contact), "{file}");

    patch(&app, &path, key, &json!({ "contact": "grace@example.org" })).ok().await;
    assert_eq!(shown(key).await, "grace@example.org");
    patch(&app, &path, key, &json!({ "contact": "" })).ok().await;
    assert_eq!(shown(key).await, Value::Null);
    patch(&app, &path, key, &json!({ "contact": contact })).ok().await;
    let too_long = json!({ "contact": "a".repeat(201) });
    let problem = patch(&app, &path, key, &too_long).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["contact"]);
    app.call(Method::DELETE, &path).token(key).ok().await;
    assert_eq!(shown(&app.organizer).await, Value::Null);
    let again = json!({ "contact": contact });
    patch(&app, &path, &app.organizer, &again).problem(409, "closed").await;
    let entrants = list(&app.get(&cup.path("/entrants")).ok().await["items"]);
    assert_eq!(
        (texts(&entrants, "id"), &entrants[0]["erased"]),
        (vec![id.to_owned()], &json!(true))
    );
}

#[tokio::test]
async fn an_organizer_reads_all_contacts_at_once_and_the_audit_log_says_so() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "categories": ["models"] })).await;
    let mut keys = Vec::new();
    for (name, contact) in [
        ("blue", json!("=HYPERLINK(\"x\")")),
        ("red", json!("r@example.org")),
        ("green", Value::Null),
    ] {
        let more = json!({ "contact": contact, "category": "models" });
        let made = app.post(&cup.path("/entrants")).json(&entry(name, &more)).ok().await;
        keys.push((made["id"].as_str().expect("an id").to_owned(), made["key"].clone()));
    }
    let path = cup.path("/contacts");
    let all = app.get(&path).token(&app.organizer).ok().await;
    let items = list(&all["items"]);
    assert_eq!(
        (texts(&items, "name"), &all["next_cursor"]),
        (vec!["blue".into(), "red".into(), "green".into()], &Value::Null)
    );
    assert_eq!(items[1]["contact"], "r@example.org");
    assert_eq!(items[2]["contact"], Value::Null);
    let csv = app.get(&format!("{path}?format=csv&limit=2")).token(&app.organizer).send().await;
    assert_eq!(
        csv.text(),
        format!(
            "entrant,name,category,status,contact\r\n{},blue,models,active,\"'=HYPERLINK(\"\"x\"\")\"\r\n\
             {},red,models,active,r@example.org\r\n",
            keys[0].0, keys[1].0
        )
    );
    let next = csv.header("x-next-cursor");
    let rest = app.get(&format!("{path}?limit=1&cursor={next}")).token(&app.organizer).ok().await;
    assert_eq!(texts(&list(&rest["items"]), "name"), ["green"]);
    for limit in ["0", "1001"] {
        app.get(&format!("{path}?limit={limit}"))
            .token(&app.organizer)
            .problem(400, "malformed")
            .await;
    }
    let request = json!({ "name": "judge", "role": "judge" });
    let judge = app.post("/api/v1/keys").token(&app.organizer).json(&request).ok().await;
    for other in [&judge["secret"], &keys[0].1] {
        let other = other.as_str().expect("a key");
        app.get(&path).token(other).problem(403, "forbidden").await;
    }
    app.get(&path).problem(401, "unauthorized").await;
    let log = list(&app.get("/api/v1/audit").token(&app.organizer).ok().await["items"]);
    let reads = log.iter().filter(|entry| entry["action"] == "entrants.contacts");
    assert_eq!(reads.count(), 3);
    let shown = app.get(&cup.path("/actions")).ok().await.to_string();
    assert!(!shown.contains("entrants.contacts"), "{shown}");
}

#[tokio::test]
async fn definitions_with_impossible_frames_are_refused() {
    let app = server().await;
    for (change, field) in [
        (json!({ "terms": "" }), "terms"),
        (json!({ "terms": "x".repeat(20_001) }), "terms"),
        (json!({ "categories": ["a", "a"] }), "categories[1]"),
        (json!({ "categories": [""] }), "categories[0]"),
        (json!({ "categories": (0..21).map(|n| n.to_string()).collect::<Vec<_>>() }), "categories"),
        (json!({ "tie_breaks": ["luck"] }), "tie_breaks"),
        (json!({ "tie_breaks": ["invalid", "invalid"] }), "tie_breaks"),
    ] {
        let mut request = crate::cup::request();
        let (name, value) = change.as_object().and_then(|all| all.iter().next()).expect("a field");
        request[name] = value.clone();
        let call = app.post("/api/v1/competitions").token(&app.organizer).json(&request);
        assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
    }
    for public in [2, 3] {
        let mut request = crate::cup::request();
        request["suite"]["public_seeds"] = json!(public);
        let call = app.post("/api/v1/competitions").token(&app.organizer).json(&request);
        assert_eq!(fields(&call.problem(422, "invalid").await), ["suite.public_seeds"]);
    }
    let mut request = crate::cup::request();
    (request["suite"]["public_seeds"], request["suite"]["tasks"]) = (json!(1), json!(["Pursuit"]));
    let call = app.post("/api/v1/competitions").token(&app.organizer).json(&request);
    assert_eq!(fields(&call.problem(422, "invalid").await), ["board"]);
}
