//! Judges: keys that read what is played, and change nothing.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{Call, TestApp, list, texts};
use crate::cup::{Attempt, Cup, server};

async fn judge(app: &TestApp) -> String {
    let request = json!({ "name": "judge", "role": "judge" });
    let created = app.post("/api/v1/keys").token(&app.organizer).json(&request).ok().await;
    assert_eq!(created["role"], "judge");
    created["secret"].as_str().expect("a key").to_owned()
}

#[tokio::test]
async fn a_judge_reads_sealed_games_and_that_is_in_the_audit_log() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "board": "hidden" })).await;
    let judge = judge(&app).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 1).await;
    let get = |path: &str| app.get(path).token(&judge);

    let attempts = get(&cup.path("/attempts")).ok().await;
    assert_eq!(texts(&list(&attempts["items"]), "run"), [attempt.run.as_str()]);
    let rows = cup.rows(&app, Some(&judge)).await;
    assert!(rows[0]["total"].is_number(), "the board is hidden from all but organizers and judges");
    get(&cup.path(&format!("/entrants/{}", blue.id))).ok().await;
    get(&cup.path("/codes")).ok().await;
    let games = get(&format!("/api/v1/episodes?run={}", attempt.run)).ok().await;
    let games = list(&games["items"]);
    let game = games[0]["id"].as_str().expect("an id");
    for rest in ["", "/journal", "/scores", "/state"] {
        let answer = get(&format!("/api/v1/episodes/{game}{rest}")).send().await;
        assert_eq!(answer.status, 200, "{rest}: {}", answer.text());
    }
    let sealed = get("/api/v1/episodes?curves=true").ok().await;
    for game in list(&sealed["items"]) {
        assert!(game.get("curve").is_none(), "nobody would be noted as its reader: {game}");
    }
    let export = get(&format!("/api/v1/exports/competitions/{}", cup.id)).send().await;
    assert_eq!(export.status, 200, "{}", export.text());

    let log = get("/api/v1/audit").ok().await;
    let log = list(&log["items"]);
    let keys = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    let own = list(&keys["items"]).into_iter().find(|key| key["role"] == "judge");
    let own = own.expect("the judge's key")["id"].clone();
    let of_judge: Vec<Value> = log.into_iter().filter(|entry| entry["who"] == own).collect();
    let actions = texts(&of_judge, "action");
    assert!(actions.contains(&"sealed.read".to_owned()), "{actions:?}");
    assert!(actions.contains(&"competition.export".to_owned()), "{actions:?}");
}

/// Looks at something sealed in the audit log.
async fn looks(app: &TestApp, subject: &str) -> usize {
    let log = app.get("/api/v1/audit?limit=1000").token(&app.organizer).ok().await;
    let is_look = |entry: &&Value| entry["action"] == "sealed.read" && entry["subject"] == subject;
    list(&log["items"]).iter().filter(is_look).count()
}

#[tokio::test]
async fn whoever_sees_a_sealed_seed_is_in_the_audit_log() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 1).await;
    let red = cup.enter(&app, "red").await;
    let running = cup.start(&app, &red).await;
    running.act(&app, 1).await;
    let first = async |attempt: &Attempt| {
        attempt.episodes(&app).await[0]["id"].as_str().expect("an id").to_owned()
    };
    let (game, unfinished) = (first(&attempt).await, first(&running).await);
    for token in [&judge(&app).await, &app.organizer] {
        let get = |path: &str| app.get(path).token(token);
        let lists = [
            get("/api/v1/episodes?limit=1000").ok().await,
            get(&format!("/api/v1/episodes?run={}", attempt.run)).ok().await,
            get("/api/v1/runs").ok().await,
        ];
        for item in lists.iter().flat_map(|page| list(&page["items"])) {
            let seed = [&item["config"]["seed"], &item["suite"]["seeds"], &item["suite"]["digest"]];
            assert!(seed.iter().all(|seed| seed.is_null()), "{item}");
        }
        for (subject, root, parts) in [
            (&attempt.run, "runs", ["", "/scores", "/metrics", "/events"].as_slice()),
            (&game, "episodes", ["", "/scores", "/metrics", "/events", "/journal"].as_slice()),
        ] {
            for part in parts {
                let before = looks(&app, subject).await;
                let path = format!("/api/v1/{root}/{subject}{part}");
                // Events of a run that has ended end, too, but nobody needs to wait for it.
                assert_eq!(get(&path).open().await.status(), 200, "{path}");
                assert_eq!(looks(&app, subject).await, before + 1, "{path}");
            }
        }
        for (query, subject, is_shown) in [
            (String::new(), &game, false),
            ("?status=running".to_owned(), &unfinished, false),
            (format!("?episode={game}"), &game, true),
            (format!("?run={}", attempt.run), &attempt.run, true),
            (format!("?episode={unfinished}&status=running"), &unfinished, true),
        ] {
            for file in ["episodes.jsonl", "acts.jsonl", "dataset.zip"] {
                let before = looks(&app, subject).await;
                let path = format!("/api/v1/exports/{file}{query}");
                let answer = get(&path).send().await;
                assert_eq!(answer.status, 200, "{path}: {}", answer.text());
                // Each line of a table has the seed; an archive without games has only its index.
                assert_eq!(answer.body.len() > 500, is_shown, "{path}: {}", answer.text());
                assert_eq!(looks(&app, subject).await, before + usize::from(is_shown), "{path}");
            }
        }
        let shown = get(&format!("/api/v1/runs/{}", attempt.run)).ok().await;
        assert!(shown["suite"]["seeds"].is_array(), "{shown}");
        let shown = get(&format!("/api/v1/episodes/{game}")).ok().await;
        assert!(shown["config"]["seed"].is_number(), "{shown}");
    }
}

#[tokio::test]
async fn a_judge_changes_nothing_and_plays_nowhere() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let judge = judge(&app).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let game = attempt.episodes(&app).await[0]["id"].as_str().expect("an id").to_owned();
    let entrant = cup.path(&format!("/entrants/{}", blue.id));
    let reason = json!({ "reason": "a test" });
    let own = json!({ "name": "judges", "model": "m" });
    let (runs, keys) = ("/api/v1/runs".to_owned(), "/api/v1/keys".to_owned());
    let game_of_its_own = json!({ "task": "Pursuit", "seed": 1 });
    let cases = [
        (Method::PATCH, cup.path(""), json!({ "hidden": true })),
        (Method::POST, cup.path("/cancel"), reason.clone()),
        (Method::POST, cup.path("/announcements"), json!({ "text": "news" })),
        (Method::POST, cup.path("/codes"), json!({ "labels": ["x"] })),
        (Method::POST, cup.path("/codes/revoke"), json!({ "labels": ["x"] })),
        (Method::POST, cup.path("/exclusions"), json!({ "name": "b*" })),
        (Method::POST, cup.path("/entrants"), own),
        (Method::POST, cup.path("/attempts"), json!({})),
        (Method::POST, cup.path(&format!("/attempts/{}/void", attempt.run)), reason.clone()),
        (Method::PATCH, entrant.clone(), json!({ "vouched": true })),
        (Method::DELETE, entrant, Value::Null),
        (Method::POST, format!("/api/v1/episodes/{game}/void"), reason),
        (Method::DELETE, format!("/api/v1/episodes/{game}"), Value::Null),
        (Method::DELETE, format!("/api/v1/runs/{}", attempt.run), Value::Null),
        (Method::POST, format!("/api/v1/runs/{}/token", attempt.run), json!({})),
        (Method::POST, "/api/v1/episodes".to_owned(), game_of_its_own),
        (Method::POST, runs, json!({ "suite": "quick", "model": "m" })),
        (Method::GET, keys.clone(), Value::Null),
        (Method::POST, keys, json!({ "name": "another" })),
    ];
    let before = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    for (method, path, body) in cases {
        let call: Call = app.call(method.clone(), &path).token(&judge);
        let call = if body.is_null() { call } else { call.json(&body) };
        let problem = call.problem(403, "forbidden").await;
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(detail.contains("judges read"), "{method} {path}: {detail}");
    }
    let after = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    assert_eq!(list(&before["items"]).len(), list(&after["items"]).len());
}
