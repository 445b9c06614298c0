//! Competitions are created; names are checked by the same rules wherever one is given.

use serde_json::{Value, json};

use crate::app::{fields, list};
use crate::cup::{request, server};

#[tokio::test]
async fn whatever_is_wrong_with_a_competition_is_named() {
    let app = server().await;
    let with = |path: &str, value: Value| {
        let mut body = request();
        let mut place = &mut body;
        for name in path.split('.') {
            place = &mut place[name];
        }
        *place = value;
        body
    };
    for (body, field) in [
        (with("name", json!("")), "name"),
        (with("name", Value::Null), "name"),
        (with("opens_at", Value::Null), "opens_at"),
        (with("closes_at", Value::Null), "closes_at"),
        (with("closes_at", json!("2026-03-01T12:10:00Z")), "closes_at"),
        (with("closes_at", json!("next week")), "closes_at"),
        (with("clocks", Value::Null), "clocks.round_deadline_s"),
        (with("clocks.round_deadline_s", json!(0)), "clocks.round_deadline_s"),
        (with("clocks.bank_s", json!(-1)), "clocks.bank_s"),
        (with("entry", json!("friends")), "entry"),
        (with("counts", json!("worst")), "counts"),
        (with("board", json!("green")), "board"),
        (with("board", json!("frozen")), "board_freezes_at"),
        (with("attempts", json!(0)), "attempts"),
        (with("attempts", json!(101)), "attempts"),
        (with("attempts", json!("many")), "attempts"),
        (with("attempts", json!([{ "opens_at": "2026-03-01T12:00:00Z" }])), "attempts[0].opens_at"),
        (with("suite.tasks", json!(["Chess"])), "suite.tasks"),
        (with("suite.seeds", json!(0)), "suite.seeds"),
        (with("suite.settings.width", json!(2)), "suite.settings.width"),
        (with("suite.settings.depth", json!(2)), "suite"),
        (with("parallel", json!(0)), "parallel"),
        (with("entries_per_key", json!(0)), "entries_per_key"),
        (with("prize", json!(1000)), "prize"),
    ] {
        let call = app.post("/api/v1/competitions").token(&app.organizer).json(&body);
        let named = fields(&call.problem(422, "invalid").await);
        assert!(named.contains(&field.to_owned()), "{field}: {named:?}");
    }
    let all = app.post("/api/v1/competitions").token(&app.organizer).json(&json!({}));
    let named = fields(&all.problem(422, "invalid").await);
    assert_eq!(named, ["name", "opens_at", "closes_at", "clocks.round_deadline_s"]);
    assert_eq!(list(&app.get("/api/v1/competitions").ok().await["items"]).len(), 0);
}

/// Place of a name: the path, the field, and the body with a name.
type NamedField<'a> = (String, &'a str, Box<dyn Fn(&str) -> Value + 'a>);

#[tokio::test]
async fn names_have_to_be_seen_wherever_one_is_given() {
    let app = server().await;
    let open_seats = json!({ "task": "Pursuit", "num_agents": 2, "open_seats": 2 });
    let lobby = app.create_with(&app.organizer, open_seats).await;
    let suite = |name: &str| json!({ "name": name, "tasks": ["Pursuit"], "seeds": [1] });
    let cup = |name: &str| {
        let mut request = crate::cup::request();
        request["name"] = json!(name);
        request
    };
    let path = |name: &str| format!("/api/v1/{name}");
    let places: [NamedField<'_>; 6] = [
        (path("episodes"), "model", Box::new(|name| json!({ "task": "Pursuit", "model": name }))),
        (path("runs"), "model", Box::new(|name| json!({ "suite": "quick", "model": name }))),
        (
            path("runs"),
            "suite.name",
            Box::new(|name| json!({ "suite": suite(name), "model": "m" })),
        ),
        (lobby.path("/claims"), "model", Box::new(|name| json!({ "seats": 1, "model": name }))),
        (path("keys"), "name", Box::new(|name| json!({ "name": name }))),
        (path("competitions"), "name", Box::new(cup)),
    ];
    for (path, field, body) in places {
        let post = |name: &str| app.post(&path).token(&app.organizer).json(&body(name));
        let of_models = ["Built-in/random", "buiIt-in/random", "built-\u{456}n/random"];
        let alike = of_models.into_iter().filter(|_| field == "model");
        for name in ["\u{3164}", "a\u{3164}", "a\u{ffa0}", "a\u{200b}", "\u{202e}a"]
            .into_iter()
            .chain(alike)
        {
            let problem = post(name).problem(422, "invalid").await;
            assert_eq!(fields(&problem), [field], "{path} {name:?}: {problem}");
        }
        assert_eq!(post("ünïcode 模型").send().await.status, 201, "{path}");
    }
}
