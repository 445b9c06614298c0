//! Entrants read their own games before the end where the organizer allows it.

use serde_json::{Value, json};

use crate::app::{TestApp, list, texts};
use crate::cup::{Cup, pass_minutes, server};

async fn games(app: &TestApp, run: &str, key: &str) -> Vec<Value> {
    list(&app.get(&format!("/api/v1/runs/{run}")).token(key).ok().await["games"])
}

/// A cup whose first window closes at 12:40, twenty minutes before the cup.
async fn open(app: &TestApp) -> Cup {
    let window =
        |closes_at: &str| json!({ "opens_at": "2026-03-01T12:10:00Z", "closes_at": closes_at });
    let attempts = [window("2026-03-01T12:40:00Z"), window("2026-03-01T13:00:00Z")];
    Cup::open(app, json!({ "own_games": "ended", "parallel": 1, "attempts": attempts })).await
}

const PARTS: [&str; 5] = ["/journal", "/state", "/replay", "/scores", "/verification"];

#[tokio::test]
async fn an_entrant_reads_its_own_games_once_their_window_has_closed() {
    let app = server().await;
    let cup = open(&app).await;
    assert_eq!(cup.created["own_games"], "ended");
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 0).await;
    let later = cup.start(&app, &blue).await;
    later.play(&app, 0).await;
    let read = |id: &str, rest: &str| app.get(&format!("/api/v1/episodes/{id}{rest}"));
    let listed = |key: &str| app.get("/api/v1/episodes").token(key);

    // Red may still play on these seeds.
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["score"].is_null() && game["seed"].is_null()), "{own:?}");
    let ids = texts(&own, "episode");
    for rest in PARTS {
        read(&ids[0], rest).token(&blue.key).problem(403, "forbidden").await;
    }
    assert_eq!(list(&listed(&blue.key).ok().await["items"]).len(), 0);

    pass_minutes(&app, 31).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(
        own.iter().all(|game| game["score"].is_number() && game["seed"].is_number()),
        "{own:?}"
    );
    for rest in PARTS {
        let answer = read(&ids[0], rest).token(&blue.key).send().await;
        assert_eq!(answer.status, 200, "{rest}: {}", answer.text());
        for other in [&red.key, &attempt.swarm] {
            let answer = read(&ids[0], rest).token(other).send().await;
            assert!([403, 404].contains(&answer.status), "{rest}: {}", answer.text());
        }
        let answer = read(&ids[0], rest).send().await;
        assert!([401, 403, 404].contains(&answer.status), "{rest}: {}", answer.text());
    }
    let mut found = texts(&list(&listed(&blue.key).ok().await["items"]), "id");
    let mut expected = ids.clone();
    found.sort();
    expected.sort();
    assert_eq!(found, expected, "those of the attempt whose window has closed");
    assert_eq!(list(&listed(&red.key).ok().await["items"]).len(), 0);
    let sealed = games(&app, &later.run, &blue.key).await;
    assert!(sealed.iter().all(|game| game["seed"].is_null()), "{sealed:?}");

    let extended = json!({ "attempts": [{ "attempt": 1, "closes_at": "2026-03-01T12:50:00Z" }] });
    let call = app.call(reqwest::Method::PATCH, &cup.path("")).token(&app.organizer);
    let problem = call.json(&extended).problem(422, "invalid").await;
    assert!(
        problem["detail"].as_str().is_some_and(|text| text.contains("read their games")),
        "{problem}"
    );
}

#[tokio::test]
async fn a_window_that_is_extended_keeps_its_games_sealed_for_longer() {
    let app = server().await;
    let cup = open(&app).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 0).await;
    let extended = json!({ "attempts": [{ "attempt": 1, "closes_at": "2026-03-01T12:50:00Z" }] });
    let call = app.call(reqwest::Method::PATCH, &cup.path("")).token(&app.organizer);
    call.json(&extended).ok().await;
    pass_minutes(&app, 31).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["seed"].is_null()), "{own:?}");
    assert_eq!(list(&app.get("/api/v1/episodes").token(&blue.key).ok().await["items"]).len(), 0);
    pass_minutes(&app, 10).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["seed"].is_number()), "{own:?}");
}

/// Rounds that are open when the window closes go on, as long as clocks and banks let them.
#[tokio::test]
async fn own_games_open_once_no_round_is_open_on_their_seeds() {
    let app = server().await;
    let window = json!({ "opens_at": "2026-03-01T12:10:00Z", "closes_at": "2026-03-01T12:40:00Z" });
    let clocks = json!({ "round_deadline_s": 60, "bank_s": 300, "idle_timeout_s": 7200 });
    let change = json!({ "own_games": "ended", "attempts": [window], "clocks": clocks });
    let cup = Cup::open(&app, change).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 0).await;
    pass_minutes(&app, 29).await;
    let rival = cup.start(&app, &red).await;
    pass_minutes(&app, 2).await;
    let open = rival.look(&app).await;
    assert!(!list(&open["observations"]).is_empty(), "{open}");
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["seed"].is_null()), "{own:?}");
    let journal = format!("/api/v1/episodes/{}/journal", texts(&own, "episode")[0]);
    app.get(&journal).token(&blue.key).problem(403, "forbidden").await;
    pass_minutes(&app, 5).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["seed"].is_number()), "{own:?}");
    // The rival's rounds are resolved, and its run ends, a moment later.
    while rival.look(&app).await["finished"] != true {
        tokio::task::yield_now().await;
    }
}

/// The games of one task tell an entrant nothing of the others.
#[tokio::test]
async fn each_task_has_seeds_of_its_own() {
    let app = server().await;
    let cup = open(&app).await;
    assert_eq!(cup.created["seeds_by_task"], true);
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 0).await;
    pass_minutes(&app, 31).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    let seeds: std::collections::BTreeSet<_> =
        own.iter().map(|game| game["seed"].as_u64().expect("a seed")).collect();
    assert_eq!((own.len(), seeds.len()), (4, 4), "two tasks on two seeds: {own:?}");
    let run = app.get(&format!("/api/v1/runs/{}", attempt.run)).token(&blue.key).ok().await;
    assert_eq!((&run["suite"]["seeds_by_task"], &run["suite"]["games"]), (&json!(true), &json!(4)));
    let listed: Vec<_> = list(&run["suite"]["seeds"]).iter().filter_map(Value::as_u64).collect();
    let played: Vec<_> = own.iter().filter_map(|game| game["seed"].as_u64()).collect();
    assert_eq!(listed, played, "in the order of the plan");
}

#[tokio::test]
async fn own_games_are_sealed_where_nothing_is_said() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    assert_eq!(cup.created["own_games"], "sealed");
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 0).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    assert!(own.iter().all(|game| game["score"].is_null() && game["seed"].is_null()), "{own:?}");
    let journal =
        format!("/api/v1/episodes/{}/journal", own[0]["episode"].as_str().expect("an id"));
    app.get(&journal).token(&blue.key).problem(403, "forbidden").await;
}
