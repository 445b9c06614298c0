//! Quotas of episodes and of the journal, and a disk that fills up.

use serde_json::json;

use crate::app::{TestApp, game};

#[tokio::test]
async fn a_key_has_a_share_of_the_episodes() {
    let app =
        TestApp::builder().keys().limits(|limits| limits.episodes_per_key_max = 2).start().await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (red, _) = app.key(json!({ "name": "red" })).await;
    let first = app.create_with(&blue, game(2, 50)).await;
    app.create_with(&blue, game(2, 50)).await;
    let create = |key: &str| app.post("/api/v1/episodes").token(key).json(&game(2, 50));
    let problem = create(&blue).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_per_key_max");
    create(&red).ok().await;
    app.delete(&first.path("")).token(&blue).ok().await;
    create(&blue).ok().await;
}

#[tokio::test]
async fn an_episode_that_talks_too_much_may_still_act() {
    let mut app = TestApp::builder()
        .limits(|limits| limits.journal_bytes_per_episode_max = 20_000)
        .start()
        .await;
    let episode = app.create(game(2, 50)).await;
    let talk =
        |round: u64| json!({ "round": round, "action": "STAY", "reasoning": "x".repeat(9_000) });
    for round in 0..2 {
        app.act(episode.seat(0), &talk(round)).await;
        app.act(episode.seat(1), &json!({ "round": round, "action": "STAY" })).await;
    }
    // It is counted again after a restart.
    for restart in [false, true] {
        if restart {
            app.restart().await;
        }
        let refused = app.post("/act").token(episode.seat(0)).json(&talk(2));
        let problem = refused.problem(413, "too_large").await;
        assert_eq!(problem["limit"]["name"], "journal_bytes_per_episode_max");
        // What was taken is still answered.
        assert_eq!(app.act(episode.seat(0), &talk(1)).await["duplicate"], true);
    }
    let act = json!({ "round": 2, "action": "STAY", "message": "🐝".repeat(120) });
    assert_eq!(app.act(episode.seat(0), &act).await["duplicate"], false);
}

#[tokio::test]
async fn a_key_that_filled_its_share_of_the_journal_creates_nothing_more() {
    let mut app = TestApp::builder()
        .keys()
        .limits(|limits| limits.journal_bytes_per_key_max = 10_000)
        .start()
        .await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (first, second) =
        (app.create_with(&blue, game(2, 50)).await, app.create_with(&blue, game(2, 50)).await);
    let talk = json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(6_000) });
    for episode in [&first, &second] {
        // The second one brings it over its share.
        let sent = app.post("/act").token(episode.seat(0)).json(&talk).send().await;
        assert_eq!(sent.status, if episode.id == first.id { 200 } else { 413 });
    }
    for seat in [1, 0] {
        let act = json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(1_900) });
        for episode in [&first, &second] {
            app.post("/act").token(episode.seat(seat)).json(&act).send().await;
        }
    }
    app.delete(&first.path("")).token(&blue).ok().await;
    for _ in 0..2 {
        let create = app.post("/api/v1/episodes").token(&blue).json(&game(2, 50));
        let problem = create.problem(403, "forbidden").await;
        assert_eq!(problem["limit"]["name"], "journal_bytes_per_key_max");
        // Small acts are always taken.
        app.act(
            second.seat(1),
            &json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(1_900) }),
        )
        .await;
        // What has ended and what runs is counted again after a restart.
        app.restart().await;
    }
}

#[tokio::test]
async fn a_disk_that_fills_up_ends_creations_and_nothing_else() {
    let app = TestApp::builder().start().await;
    let episode = app.create(game(2, 50)).await;
    app.disk.set(4);
    let refused = app.post("/api/v1/episodes").json(&game(2, 50)).send().await;
    assert_eq!((refused.status, refused.header("retry-after")), (503, "60"));
    assert_eq!(refused.json()["limit"], json!({ "name": "disk_free_percent_min", "value": 5 }));
    app.all_act(&episode, "STAY").await;
    app.get("/readyz").ok().await;
    // All servers of these tests share the metrics: another one may have told of its own disk in between.
    let mut told = false;
    for _ in 0..100 {
        let metrics = app.get("/metrics").send().await.text();
        told |= metrics.contains("swarmbench_disk_free_percent 4");
    }
    assert!(told, "the metrics never told how much of the disk is free");
    app.disk.set(5);
    app.create(game(2, 50)).await;
}
