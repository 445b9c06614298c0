//! Episodes are created, and a creation is repeated by its idempotency key.

use std::collections::BTreeSet;

use rstest::rstest;
use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::{Episode, TestApp, fields, list, number};

#[tokio::test]
async fn defaults_are_filled_in() {
    let app = TestApp::start().await;
    let answer = app.post("/api/v1/episodes").json(&json!({ "task": "Pursuit" })).send().await;
    assert_eq!(answer.status, 201);
    let created = answer.json();
    let seed = created["config"]["seed"].clone();
    assert!(number(&seed) < 1 << 53);
    assert_eq!(
        created["config"],
        json!({
            "task": "Pursuit", "seed": seed, "rules": "paper", "num_agents": 12, "width": 10,
            "height": 10, "view_size": 5, "memory": 5, "max_round": 100,
            "control": "decentralized", "noise": 0.0, "max_delay": 0, "round_deadline_s": null,
            "bank_s": 0, "start": "now", "idle_timeout_s": 86_400, "visibility": "public",
            "model": "unnamed", "agent_meta": {}, "prompt_template": null, "open_seats": 0,
            "fill_after_s": null, "fill_with": null, "player": null,
        })
    );
    let episode = Episode::of(&created);
    assert!(episode.id.starts_with("ep_"), "{}", episode.id);
    assert_eq!(answer.header("location"), episode.path(""));
    assert_eq!(answer.header("cache-control"), "no-store");
    let tokens: BTreeSet<&str> = episode.seats().chain([episode.swarm.as_str()]).collect();
    assert_eq!(tokens.len(), 13);
    assert!(episode.seats().all(|token| token.starts_with("seat_")));
    assert!(episode.swarm.starts_with("swarm_"));
    // Seeds are drawn anew each time.
    let other = app.create(json!({ "task": "Pursuit" })).await;
    assert_ne!(other.config["seed"], seed);
}

#[tokio::test]
async fn every_setting_is_kept() {
    let app = TestApp::start().await;
    let request = json!({
        "task": "Transport", "seed": 9_007_199_254_740_991_i64, "rules": "paper",
        "num_agents": 7, "width": 14, "height": 11, "view_size": 9, "memory": 2,
        "max_round": 33, "control": "centralized", "noise": 0.25, "max_delay": 3,
        "round_deadline_s": 0.05, "bank_s": 12.5, "start": "manual", "idle_timeout_s": 1,
        "visibility": "owner", "model": "m-1", "agent_meta": { "temperature": 0.7, "tags": ["a"] },
        "prompt_template": "{{ agent }}", "open_seats": 0, "fill_after_s": null, "fill_with": null,
        "player": "random",
    });
    let episode = app.create(request.clone()).await;
    assert_eq!(episode.config, request);
    assert_eq!(app.show(&episode).await["config"], request);
}

#[rstest]
#[case("task", json!("Chess"))]
#[case("task", json!(""))]
#[case("task", json!(null))]
#[case("task", json!(3))]
#[case("seed", json!(-1))]
#[case("seed", json!(9_007_199_254_740_992_i64))]
#[case("seed", json!(1.5))]
#[case("seed", json!("7"))]
#[case("rules", json!("toolkit"))]
#[case("num_agents", json!(0))]
#[case("num_agents", json!(1025))]
#[case("num_agents", json!(65))] // does not fit on the 64 cells inside
#[case("width", json!(7))]
#[case("width", json!(257))]
#[case("height", json!(7))]
#[case("height", json!(true))]
#[case("view_size", json!(4))]
#[case("view_size", json!(1))]
#[case("view_size", json!(23))]
#[case("memory", json!(-1))]
#[case("memory", json!(51))]
#[case("max_round", json!(0))]
#[case("max_round", json!(100_001))]
#[case("control", json!("anarchy"))]
#[case("noise", json!(-0.1))]
#[case("noise", json!(1.1))]
#[case("max_delay", json!(101))]
#[case("round_deadline_s", json!(0.01))]
#[case("round_deadline_s", json!(86_401))]
#[case("bank_s", json!(-1))]
#[case("bank_s", json!(604_801))]
#[case("start", json!("later"))]
#[case("idle_timeout_s", json!(0.5))]
#[case("idle_timeout_s", json!(31_536_001))]
#[case("visibility", json!("nobody"))]
#[case("visibility", json!("sealed"))]
#[case("model", json!(""))]
#[case("model", json!("a\nb"))]
#[case("model", json!("x".repeat(201)))]
#[case("agent_meta", json!([1]))]
#[case("agent_meta", json!({ "much": "x".repeat(16 * 1024) }))]
#[case("prompt_template", json!("{{ agent"))]
#[case("prompt_template", json!("{% set x = 1 %}"))]
#[case("prompt_template", json!("x".repeat(32 * 1024 + 1)))]
#[case("colour", json!("red"))]
#[tokio::test]
async fn a_setting_that_is_not_allowed_is_named(#[case] field: &str, #[case] value: Value) {
    let app = TestApp::start().await;
    let call = app.post("/api/v1/episodes").json(&with(json!({ "task": "Pursuit" }), field, value));
    assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
    assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
}

#[rstest]
#[case::square(json!({ "task": "Pursuit", "rules": "reference", "width": 12 }), "width")]
#[case::flocking(json!({ "task": "Flocking", "num_agents": 257, "width": 40, "height": 40 }), "num_agents")]
#[case::one_memory(json!({ "task": "Pursuit", "width": 100, "height": 100, "view_size": 101, "memory": 10 }), "memory")]
#[case::all_memory(json!({ "task": "Pursuit", "width": 100, "height": 100, "view_size": 101, "memory": 6, "num_agents": 200 }), "memory")]
#[case::acts(json!({ "task": "Pursuit", "max_round": 100_000, "num_agents": 101, "width": 40, "height": 40 }), "max_round")]
#[case::missing(json!({ "seed": 1 }), "task")]
#[tokio::test]
async fn a_combination_that_is_not_allowed_is_named(#[case] request: Value, #[case] field: &str) {
    let app = TestApp::start().await;
    let call = app.post("/api/v1/episodes").json(&request);
    assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
}

#[tokio::test]
async fn everything_that_is_wrong_is_named_at_once() {
    let app = TestApp::start().await;
    let request =
        json!({ "task": "Pursuit", "width": 4, "noise": 2, "start": "never", "bank_s": -3 });
    let problem = app.post("/api/v1/episodes").json(&request).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["width", "noise", "bank_s", "start"]);
    for named in ["width must be from 8 to 256, is 4", "bank_s must be"] {
        assert!(problem["detail"].as_str().is_some_and(|text| text.contains(named)), "{problem}");
    }
}

#[tokio::test]
async fn no_more_episodes_live_at_once_than_the_limit_says() {
    let app = TestApp::builder().limits(|limits| limits.episodes_unfinished_max = 2).start().await;
    let first = app.create(request(1, 1)).await;
    app.create(request(1, 1)).await;
    let call = || app.post("/api/v1/episodes").json(&request(1, 1));
    let problem = call().problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "episodes_unfinished_max", "value": 2 }));
    finish(&app, &first).await;
    call().ok().await;
}

async fn create(app: &TestApp, key: &str) -> Episode {
    let call = app.post("/api/v1/episodes").header("idempotency-key", key).json(&request(2, 3));
    Episode::of(&call.ok().await)
}

async fn expect_revoked(app: &TestApp, lost: &Episode) {
    app.get("/obs").token(lost.seat(1)).problem(401, "unauthorized").await;
    app.get("/swarm/obs").token(&lost.swarm).problem(401, "unauthorized").await;
}

#[tokio::test]
async fn a_repeat_gives_the_same_episode_with_fresh_tokens() {
    let mut app = TestApp::start().await;
    let first = create(&app, "k").await;
    app.all_act(&first, "SWITCH").await;
    assert_eq!(app.obs(first.seat(1)).await["round"], 1);
    let second = create(&app, "k").await;
    assert_eq!((&second.id, &second.config), (&first.id, &first.config));
    expect_revoked(&app, &first).await;
    assert_eq!(app.obs(second.seat(1)).await["round"], 1);
    assert_eq!(app.swarm_obs(&second).await.len(), 2);
    app.restart().await;
    expect_revoked(&app, &first).await;
    let third = create(&app, "k").await;
    assert_eq!(third.id, first.id);
    expect_revoked(&app, &second).await;
    finish(&app, &third).await;
    // It is the same even after its end.
    let fourth = create(&app, "k").await;
    assert_eq!(
        (&fourth.id, app.show(&fourth).await["status"].clone()),
        (&first.id, json!("finished"))
    );
    assert_eq!(list(&app.get("/api/v1/episodes").ok().await["items"]).len(), 1);
}

/// Tokens of many seats are replaced in several commits: all of them, and nobody else's.
#[tokio::test]
async fn a_repeat_replaces_the_tokens_of_many_seats() {
    let mut app = TestApp::start().await;
    let game = json!({ "task": "Synchronization", "num_agents": 150, "width": 40, "height": 40 });
    let other = app.create(game.clone()).await;
    let again = || app.post("/api/v1/episodes").header("idempotency-key", "many").json(&game);
    let first = Episode::of(&again().ok().await);
    let second = Episode::of(&again().ok().await);
    app.restart().await;
    for seat in [0, 1, 63, 64, 65, 127, 128, 149] {
        app.get("/obs").token(first.seat(seat)).problem(401, "unauthorized").await;
        for episode in [&second, &other] {
            app.get("/obs").token(episode.seat(seat)).ok().await;
        }
    }
    app.get("/swarm/obs").token(&first.swarm).problem(401, "unauthorized").await;
    assert_eq!(app.swarm_obs(&second).await.len(), 150);
}

#[tokio::test]
async fn another_key_or_none_gives_another_episode() {
    let app = TestApp::start().await;
    let first = create(&app, "k").await;
    assert_ne!(create(&app, "K").await.id, first.id);
    assert_ne!(app.create(request(2, 3)).await.id, first.id);
    assert_eq!(app.obs(first.seat(0)).await["round"], 0, "its tokens are untouched");
}

#[tokio::test]
async fn another_body_is_refused_and_revokes_nothing() {
    let app = TestApp::start().await;
    let first = create(&app, "k").await;
    let call = app.post("/api/v1/episodes").header("idempotency-key", "k");
    call.json(&request(2, 4)).problem(422, "invalid").await;
    assert_eq!(app.obs(first.seat(0)).await["round"], 0);
}

#[tokio::test]
async fn repeats_at_the_same_time_create_one_episode() {
    let app = TestApp::start().await;
    let all = futures::future::join_all((0..8).map(|_| create(&app, "k"))).await;
    assert!(all.iter().all(|episode| episode.id == all[0].id));
    // Only the tokens that were given out last are good.
    let mut good = 0;
    for episode in &all {
        good += u32::from(app.get("/obs").token(episode.seat(0)).send().await.status == 200);
    }
    assert_eq!(good, 1);
}

#[rstest]
#[case(1, None)]
#[case(200, None)]
#[case(0, Some("malformed"))]
#[case(201, Some("malformed"))]
#[tokio::test]
async fn a_key_has_1_to_200_characters(#[case] length: usize, #[case] refused: Option<&str>) {
    let app = TestApp::start().await;
    let key = "k".repeat(length);
    let call = app.post("/api/v1/episodes").header("idempotency-key", &key).json(&request(2, 3));
    match refused {
        None => drop(call.ok().await),
        Some(code) => drop(call.problem(400, code).await),
    }
}
