//! Attempts are started: windows, seeds, repeated starts.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::{Value, json};

use crate::app::number;
use crate::cup::{Attempt, Cup, pass_minutes, server};

#[tokio::test]
async fn attempts_are_started_within_their_number_and_their_windows() {
    let app = server().await;
    let windows = json!([
        { "closes_at": "2026-03-01T12:20:00.000Z" },
        { "opens_at": "2026-03-01T12:30:00.000Z" },
    ]);
    let cup = Cup::with(&app, json!({ "attempts": windows })).await;
    let blue = cup.enter(&app, "blue").await;
    let start = |body: Value| app.post(&cup.path("/attempts")).token(&blue.key).json(&body);
    app.pass(Duration::from_millis(10 * 60_000 - 1));
    start(json!({})).problem(409, "closed").await;
    app.pass(Duration::from_millis(1));
    // Nobody scouts the second one.
    start(json!({ "attempt": 2 })).problem(409, "closed").await;
    let started = start(json!({})).ok().await;
    assert_eq!((&started["attempt"], &started["games"]), (&json!(1), &json!(4)));
    assert_eq!(started["closes_at"], "2026-03-01T12:20:00.000Z");
    for again in [json!({}), json!({ "attempt": 1 }), json!({ "attempt": 3 })] {
        start(again).problem(409, "closed").await;
    }
    // The first window closes for entrants that have not started.
    let red = cup.enter(&app, "red").await;
    app.pass(Duration::from_millis(10 * 60_000 - 1));
    let last = app.post(&cup.path("/attempts")).token(&red.key).json(&json!({ "attempt": 1 }));
    assert_eq!(last.ok().await["attempt"], 1);
    let green = cup.enter(&app, "green").await;
    app.pass(Duration::from_millis(1));
    let late = app.post(&cup.path("/attempts")).token(&green.key).json(&json!({ "attempt": 1 }));
    late.problem(409, "closed").await;
    pass_minutes(&app, 10).await;
    assert_eq!(start(json!({})).ok().await["attempt"], 2);
    app.post(&cup.path("/attempts")).json(&json!({})).problem(401, "unauthorized").await;
    let (stranger, _) = app.key(json!({ "name": "stranger" })).await;
    let call = app.post(&cup.path("/attempts")).token(&stranger).json(&json!({}));
    call.problem(403, "forbidden").await;
}

#[tokio::test]
async fn an_attempt_has_the_same_seeds_for_all_and_no_other_attempt_has_them() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "parallel": 4 })).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let mut seeds: Vec<BTreeSet<(String, u64)>> = Vec::new();
    for entrant in [&blue, &red, &blue, &red] {
        let attempt = cup.start(&app, entrant).await;
        let episodes = attempt.episodes(&app).await;
        let seed = |episode: &Value| {
            let task = episode["task"].as_str().expect("a task").to_owned();
            (task, number(&episode["config"]["seed"]))
        };
        seeds.push(episodes.iter().map(seed).collect());
    }
    assert_eq!(seeds[0].len(), 4);
    assert_eq!((&seeds[0], &seeds[2]), (&seeds[1], &seeds[3]));
    let plain = |of: &BTreeSet<(String, u64)>| of.iter().map(|(_, seed)| *seed).collect();
    let (first, second): (BTreeSet<u64>, BTreeSet<u64>) = (plain(&seeds[0]), plain(&seeds[2]));
    assert_eq!((first.len(), second.len()), (4, 4), "each task has seeds of its own");
    assert!(first.is_disjoint(&second));
}

#[tokio::test]
async fn a_start_that_is_repeated_gives_the_same_attempt_a_new_token() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let start = |key: &str, body: Value| {
        let call = app.post(&cup.path("/attempts")).token(key).json(&body);
        call.header("Idempotency-Key", "first")
    };
    let first = Attempt::of(&start(&blue.key, json!({})).ok().await);
    first.look(&app).await;
    let again = Attempt::of(&start(&blue.key, json!({})).ok().await);
    assert_eq!((&first.run, first.number), (&again.run, again.number));
    assert_ne!(first.swarm, again.swarm);
    app.get("/swarm/obs").token(&first.swarm).problem(401, "unauthorized").await;
    again.look(&app).await;
    start(&blue.key, json!({ "attempt": 2 })).problem(422, "invalid").await;
    // Everybody has names of their own.
    assert_ne!(Attempt::of(&start(&red.key, json!({})).ok().await).run, first.run);
    // Of many that start at the same time each attempt is started once.
    let green = cup.enter(&app, "green").await;
    let all = futures::future::join_all((0..6).map(|_| {
        let call = app.post(&cup.path("/attempts")).token(&green.key).json(&json!({}));
        async move { call.send().await.status }
    }));
    let mut all = all.await;
    all.sort_unstable();
    assert_eq!(all, [201, 201, 409, 409, 409, 409]);
}

#[tokio::test]
async fn entrants_of_one_key_give_their_starts_the_same_name() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 8 })).await;
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    let mut entrants = Vec::new();
    for number in 0..8 {
        let entry = json!({ "name": format!("team {number}"), "model": "m" });
        let made = app.post(&cup.path("/entrants")).token(&member).json(&entry).ok().await;
        entrants.push(made["id"].clone());
    }
    let starts = entrants.iter().map(|entrant| {
        let call = app.post(&cup.path("/attempts")).token(&member);
        call.header("idempotency-key", "the same").json(&json!({ "entrant": entrant })).send()
    });
    let started = futures::future::join_all(starts).await;
    let runs: BTreeSet<String> =
        started.iter().map(|start| start.json()["run"].to_string()).collect();
    assert!(started.iter().all(|start| start.status == 201));
    assert_eq!(runs.len(), 8, "each has its own");
    app.get("/readyz").ok().await;
}

#[tokio::test]
async fn only_the_organizer_ends_a_ranked_game() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let seen = attempt.look(&app).await;
    let episode = seen["observations"][0]["episode"].as_str().expect("an id").to_owned();
    let path = format!("/api/v1/episodes/{episode}");
    app.delete(&path).token(&attempt.swarm).problem(403, "forbidden").await;
    app.delete(&path).token(&blue.key).problem(403, "forbidden").await;
    app.post(&format!("{path}/start")).token(&blue.key).problem(403, "forbidden").await;
    app.delete(&path).problem(404, "not_found").await;
    assert_eq!(app.delete(&path).token(&app.organizer).ok().await["status"], "aborted");
}
