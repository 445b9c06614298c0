//! Names in any case, truth values and tokens as they are typed, and errors in words that a person understands.

use serde_json::{Value, json};

use crate::app::{TestApp, list};

#[tokio::test]
async fn names_are_read_in_any_case_and_kept_as_they_are_written() {
    let app = TestApp::start().await;
    let request = json!({
        "task": "SYNCHRONIZATION", "rules": "Reference", "control": "CENTRALIZED", "num_agents": 1, "max_round": 1,
    });
    let episode = app.create(request).await;
    let shown = app.show(&episode).await;
    assert_eq!(shown["task"], "Synchronization");
    assert_eq!(
        (&shown["config"]["rules"], &shown["config"]["control"]),
        (&json!("reference"), &json!("centralized"))
    );
    app.all_act(&episode, "STAY").await;
    let journal = app.journal(&episode).await;
    assert!(journal.contains("\"Synchronization\"") && !journal.contains("SYNCHRONIZATION"));
    for (path, found) in [
        ("/api/v1/episodes?task=synchronization", 1),
        ("/api/v1/episodes?task=FORAGING", 0),
        ("/api/v1/imports?task=foraging", 0),
        ("/api/v1/cross-play?task=foraging&rules=PAPER", 0),
    ] {
        assert_eq!(list(&app.get(path).ok().await["items"]).len(), found, "{path}");
    }
    let board = app.get("/api/v1/leaderboard?task=foraging&sort=FORAGING&rules=Paper").ok().await;
    assert_eq!((&board["tasks"], &board["rules"]), (&json!(["Foraging"]), &json!("paper")));

    let suite = |tasks: Value| {
        json!({
            "model": "m", "rules": "PAPER",
            "suite": { "name": "a, b", "tasks": tasks, "seeds": [1], "settings": { "control": "Centralized" } },
        })
    };
    let run = app.post("/api/v1/runs").json(&suite(json!(["foraging", "Pursuit"]))).ok().await;
    assert_eq!(run["suite"]["tasks"], json!(["Foraging", "Pursuit"]));
    assert_eq!(run["suite"]["settings"]["control"], "centralized");
    let twice = app.post("/api/v1/runs").json(&suite(json!(["foraging", "Foraging"])));
    twice.problem(422, "invalid").await;
    // The name of a suite is one name, with its commas.
    let listed = app.get("/api/v1/runs?suite=a,%20b").ok().await;
    assert_eq!(list(&listed["items"]).len(), 1);
    let refused =
        app.get("/api/v1/leaderboard?suite=quick,standard").problem(400, "malformed").await;
    assert!(refused["detail"].as_str().is_some_and(|text| text.contains("a board has one suite")));
}

#[tokio::test]
async fn truth_values_of_queries_are_read_as_programs_write_them() {
    let app = TestApp::start().await;
    let episode = app.create(json!({ "task": "Foraging", "num_agents": 1 })).await;
    for (query, has_prompt) in [
        ("?prompt=true", true),
        ("?prompt=True", true),
        ("?prompt=1", true),
        ("?prompt=YES", true),
        ("?prompt=False", false),
        ("?prompt=0", false),
        ("?prompt=no", false),
        ("", false),
    ] {
        let obs = app.get(&format!("/obs{query}")).token(episode.seat(0)).ok().await;
        assert_eq!(obs["prompt"].is_string(), has_prompt, "{query}");
    }
    for (path, detail) in [
        (
            "/obs?prompt=maybe",
            "prompt must be true or false (also 1 or 0, yes or no), is \"maybe\"",
        ),
        ("/obs?wait=soon", "wait must be a number, is \"soon\""),
    ] {
        let refused = app.get(path).token(episode.seat(0)).problem(400, "malformed").await;
        assert!(refused["detail"].as_str().expect("a text").ends_with(detail), "{refused}");
    }
    for (path, detail) in [
        ("reference=2", "reference must be true or false (also 1 or 0, yes or no), is \"2\""),
        ("limit=many", "limit must be a whole number that is not negative, is \"many\""),
        ("limit=-1", "limit must be a whole number that is not negative, is \"-1\""),
        ("limit=99999999999", "limit is too large, is \"99999999999\""),
    ] {
        let refused =
            app.get(&format!("/api/v1/leaderboard?{path}")).problem(400, "malformed").await;
        assert!(refused["detail"].as_str().expect("a text").ends_with(detail), "{refused}");
    }
}

#[tokio::test]
async fn a_header_without_the_word_bearer_is_told_what_to_write() {
    let app = TestApp::builder().keys().start().await;
    let key = app.organizer.clone();
    let keys = |header: String| app.get("/api/v1/keys").header("authorization", &header);
    keys(format!("bearer {key}")).ok().await;
    keys(format!("BEARER   {key}")).ok().await;
    for (header, detail) in [
        (key.clone(), "the word Bearer is missing before the token"),
        (format!("Basic {key}"), "the header says `Basic`"),
        (format!("Token {key}"), "the token must follow the word Bearer"),
        ("Bearer".to_owned(), "there is no token after the word Bearer"),
        ("Bearer secret_unknown".to_owned(), "the token is unknown"),
    ] {
        let refused = keys(header).problem(401, "unauthorized").await;
        let said = refused["detail"].as_str().expect("a text");
        assert!(said.starts_with(detail) && !said.contains(&key), "{said}");
        assert!(
            said.contains("`Authorization: Bearer TOKEN`") || detail.ends_with("unknown"),
            "{said}"
        );
    }
}

#[tokio::test]
async fn a_value_of_a_wrong_type_is_named_with_its_place_and_what_is_taken() {
    let app = TestApp::start().await;
    let refused = async |path: &str, body: Value| {
        let problem = app.post(path).json(&body).problem(422, "invalid").await;
        problem["detail"].as_str().expect("a text").to_owned()
    };
    let own = |field: &str, value: Value| {
        let mut suite = json!({ "name": "x", "seeds": [1] });
        suite[field] = value;
        json!({ "suite": suite, "model": "m" })
    };
    let (episodes, runs) = ("/api/v1/episodes", "/api/v1/runs");
    for (path, body, detail) in [
        (
            episodes,
            json!({ "task": "Pursuit", "seed": "27" }),
            "seed must be a whole number, is \"27\"",
        ),
        (
            episodes,
            json!({ "task": "Pursuit", "seed": 1.5 }),
            "seed must be a whole number, is 1.5",
        ),
        (episodes, json!({ "task": 5 }), "task must be a text, is 5"),
        (
            episodes,
            json!({ "task": "Pursuit", "agent_meta": [] }),
            "agent_meta must be an object, is a list",
        ),
        (
            runs,
            json!({ "suite": 5, "model": "m" }),
            "suite must be the name of a suite, or an object, is 5",
        ),
        (
            runs,
            own("tasks", json!("Pursuit")),
            "suite is wrong at tasks: must be a list, is \"Pursuit\"",
        ),
        (
            runs,
            own("seeds", json!([1, "2"])),
            "suite is wrong at seeds[1]: must be a whole number, is \"2\"",
        ),
        (runs, json!({ "suite": { "name": "x" }, "model": "m" }), "suite must have `seeds`"),
    ] {
        assert_eq!(refused(path, body.clone()).await, detail, "{body}");
    }
    let app = TestApp::builder().keys().start().await;
    for (body, detail) in [
        (
            json!("two"),
            "attempts must be a number of attempts, or a list of their windows, is \"two\"",
        ),
        (json!(-1), "attempts must be a number of attempts, or a list of their windows, is -1"),
        (
            json!([{ "opens": "x" }]),
            "attempts is wrong at [0].opens: is unknown; the fields are `opens_at` or `closes_at`",
        ),
        (
            json!([{ "opens_at": "soon" }]),
            "attempts is wrong at [0].opens_at: must be a time such as 2027-03-01T12:00:00Z, is \"soon\"",
        ),
    ] {
        let body = json!({ "attempts": body });
        let refused = app
            .post("/api/v1/competitions")
            .token(&app.organizer)
            .json(&body)
            .problem(422, "invalid")
            .await;
        assert_eq!(refused["detail"], detail);
    }
}
