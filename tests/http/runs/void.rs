//! Voided games are played again while their run is open, and count for nothing after it.

use serde_json::json;

use super::{TestRun, play, play_game, show, slots, small, stored, text, with};
use crate::app::{HttpAnswer, TestApp, list, number};

async fn void(app: &TestApp, episode: &str, key: &str) -> HttpAnswer {
    let call = app.post(&format!("/api/v1/episodes/{episode}/void")).token(key);
    call.json(&json!({ "reason": "power cut" })).send().await
}

#[tokio::test]
async fn voided_games_are_played_again() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let request = with(small(), &json!({ "parallel": 2 }));
    let run = TestRun::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await);
    let of = |game: usize| text(&run.created["games"][game], "episode").to_owned();
    // A game that is played, and one that has ended.
    play_game(&app, &run, &of(0)).await;
    assert_eq!(void(&app, &of(0), &owner).await.status, 403);
    assert_eq!(void(&app, &of(0), &run.token).await.status, 403);
    for game in [0, 1] {
        let voided = void(&app, &of(game), &app.organizer).await;
        assert_eq!(voided.status, 200, "{}", voided.text());
        assert_eq!(voided.json()["void_reason"], "power cut");
        assert_ne!(voided.json()["status"], "running");
    }
    // Again: nothing changes, not even the reason.
    let call = app.post(&format!("/api/v1/episodes/{}/void", of(0))).token(&app.organizer);
    let again = call.json(&json!({ "reason": "another" })).ok().await;
    assert_eq!(again["void_reason"], "power cut");
    assert_eq!(stored(&app, "SELECT count(*) FROM audit WHERE action = 'episode.void'").await, 2);

    play(&app, &run).await;
    let result = show(&app, &run).await;
    assert_eq!(result["status"], "finished");
    let told = ["played", "planned", "voided"].map(|field| number(&result[field]));
    assert_eq!(told, [4, 4, 2]);
    assert_eq!(list(&result["games"]).len(), 6);
    assert_eq!(result["acts"]["sent"], 16, "acts in games that count");
    assert_eq!(slots(&result, "finished"), [0, 0, 1, 2, 3]);
}

#[tokio::test]
async fn what_is_voided_after_the_end_counts_for_nothing() {
    let app = TestApp::builder().keys().start().await;
    let request = with(small(), &json!({ "visibility": "public" }));
    let call = app.post("/api/v1/runs").token(&app.organizer).json(&request);
    let run = TestRun::of(&call.ok().await);
    play(&app, &run).await;
    let before = show(&app, &run).await;
    let first = text(&run.created["games"][0], "episode").to_owned();
    assert_eq!(void(&app, &first, &app.organizer).await.status, 200);
    let after = show(&app, &run).await;
    let told = ["played", "planned", "voided"].map(|field| number(&after[field]));
    assert_eq!(told, [3, 3, 1]);
    assert_eq!(after["status"], "finished");
    assert_eq!(after["tasks"][0]["mean"], before["games"][1]["score"]);
    assert_eq!(after["tasks"][0]["deviation"], 0.0);
    assert_eq!(list(&after["games"]).len(), 4);
}

async fn repeat(app: &TestApp, episode: &str, key: &str) -> HttpAnswer {
    let call = app.post(&format!("/api/v1/episodes/{episode}/repeat")).token(key);
    call.json(&json!({ "reason": "the endpoint was ill" })).send().await
}

#[tokio::test]
async fn the_creator_of_a_run_has_a_game_played_again() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (other, _) = app.key(json!({ "name": "other" })).await;
    let request = with(small(), &json!({ "parallel": 2, "visibility": "public" }));
    let run = TestRun::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await);
    let first = text(&run.created["games"][0], "episode").to_owned();
    let open = repeat(&app, &first, &owner).await;
    assert_eq!((open.status, &open.json()["code"]), (409, &json!("changed")), "{}", open.text());
    play(&app, &run).await;
    let before = show(&app, &run).await;
    assert_eq!(repeat(&app, &first, &other).await.status, 403);
    let kept = repeat(&app, &first, &run.token).await;
    assert_eq!(kept.status, 200, "{}", kept.text());
    assert_eq!(kept.json()["void_reason"], "played again: the endpoint was ill");
    // Once more changes nothing: it is open again already.
    assert_eq!(repeat(&app, &first, &owner).await.status, 200);
    let open = show(&app, &run).await;
    assert_eq!((&open["status"], &open["ended_at"]), (&json!("running"), &json!(null)));
    assert_eq!(slots(&open, "running"), [0]);
    play(&app, &run).await;
    let result = show(&app, &run).await;
    assert_eq!(result["status"], "finished");
    let told = ["played", "planned", "voided"].map(|field| number(&result[field]));
    assert_eq!(told, [4, 4, 1]);
    assert_eq!(slots(&result, "finished"), [0, 0, 1, 2, 3]);
    let games = list(&result["games"]);
    assert_eq!(
        (&games[0]["episode"], &games[0]["score"]),
        (&json!(first), &before["games"][0]["score"])
    );
    let journal = app.get(&format!("/api/v1/episodes/{first}/journal")).send().await;
    assert_eq!(journal.status, 200, "what was played stays");
}

#[tokio::test]
async fn what_ended_otherwise_is_not_played_again_nor_too_often() {
    let app = TestApp::start().await;
    let run = TestRun::of(
        &app.post("/api/v1/runs").json(&with(small(), &json!({ "parallel": 4 }))).ok().await,
    );
    for times in 0..=20 {
        let open = show(&app, &run).await;
        let games = list(&open["games"]);
        let current = games.iter().find(|game| game["slot"] == 0 && game["void_reason"].is_null());
        let current = text(current.expect("a game"), "episode").to_owned();
        play_game(&app, &run, &current).await;
        let answer = repeat(&app, &current, &run.token).await;
        let expected = if times < 20 { 200 } else { 409 };
        assert_eq!(answer.status, expected, "{times}: {}", answer.text());
        assert!(times < 20 || answer.text().contains("game_repeats_max"), "{}", answer.text());
    }
    let episode =
        app.post("/api/v1/episodes").json(&json!({ "task": "Foraging", "seed": 1 })).ok().await;
    let alone = repeat(&app, text(&episode, "id"), text(&episode, "swarm_token")).await;
    assert_eq!((alone.status, &alone.json()["code"]), (409, &json!("changed")));
    app.delete(&format!("/api/v1/runs/{}", text(&run.created, "id"))).token(&run.token).ok().await;
    let games = show(&app, &run).await;
    let last = list(&games["games"]).iter().find(|game| game["void_reason"].is_null()).cloned();
    let last = last.expect("a game");
    let over = repeat(&app, text(&last, "episode"), &run.token).await;
    assert_eq!(
        (over.status, &over.json()["code"]),
        (409, &json!("episode_over")),
        "{}",
        over.text()
    );
}
