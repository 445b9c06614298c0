//! Entrants read their own games before the end where the organizer allows it.

use serde_json::{Value, json};

use crate::app::{TestApp, list, texts};
use crate::cup::{Cup, server};

async fn games(app: &TestApp, run: &str, key: &str) -> Vec<Value> {
    list(&app.get(&format!("/api/v1/runs/{run}")).token(key).ok().await["games"])
}

#[tokio::test]
async fn an_entrant_reads_its_own_games_once_they_have_ended_where_that_is_allowed() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "own_games": "ended", "parallel": 1 })).await;
    assert_eq!(cup.created["own_games"], "ended");
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    // The first game ends, and the second one runs.
    for _ in 0..3 {
        attempt.act(&app, 4).await;
    }
    attempt.look(&app).await;
    let own = games(&app, &attempt.run, &blue.key).await;
    let ids = texts(&own[..2], "episode");
    assert!(own[0]["score"].is_number() && own[0]["seed"].is_number(), "{own:?}");
    assert!(own[1]["score"].is_null() && own[1]["seed"].is_null(), "{own:?}");
    let read = |id: &str, rest: &str| app.get(&format!("/api/v1/episodes/{id}{rest}"));
    for rest in ["/journal", "/state", "/replay", "/scores", "/verification"] {
        let answer = read(&ids[0], rest).token(&blue.key).send().await;
        assert_eq!(answer.status, 200, "{rest}: {}", answer.text());
        for other in [&red.key, &attempt.swarm] {
            let answer = read(&ids[0], rest).token(other).send().await;
            assert!([403, 404].contains(&answer.status), "{rest}: {}", answer.text());
        }
        let answer = read(&ids[0], rest).send().await;
        assert!([401, 403, 404].contains(&answer.status), "{rest}: {}", answer.text());
        let answer = read(&ids[1], rest).token(&blue.key).send().await;
        assert!([403, 404, 409].contains(&answer.status), "it runs: {rest}: {}", answer.text());
    }
    let listed = |key: &str| app.get("/api/v1/episodes").token(key);
    assert_eq!(texts(&list(&listed(&blue.key).ok().await["items"]), "id"), [ids[0].as_str()]);
    assert_eq!(list(&listed(&red.key).ok().await["items"]).len(), 0);
    attempt.play(&app, 0).await;
    let over = app.get(&format!("/api/v1/runs/{}", attempt.run)).token(&blue.key).ok().await;
    assert!(list(&over["games"]).iter().all(|game| game["score"].is_number()), "{over}");
    let board = app.get(&cup.path("/board")).ok().await;
    assert_eq!(board["shows"], "totals");
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
