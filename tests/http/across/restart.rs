//! A server that stops or crashes, and is started again on the same database.

use serde_json::{Value, json};
use swarmbench::server::Server;

use crate::app::{Episode, TestApp, verified};

fn request() -> Value {
    json!({ "task": "Synchronization", "seed": 2, "num_agents": 3, "max_round": 3 })
}

fn act(round: u64) -> Value {
    json!({ "round": round, "action": "SWITCH", "message": "hello" })
}

/// Everything that anyone is shown of an episode.
async fn shown(app: &TestApp, episode: &Episode) -> Value {
    let mut seen = Vec::new();
    for token in episode.seats() {
        seen.push(app.get("/obs?prompt=true").token(token).ok().await);
    }
    let waiting = app.swarm_obs(episode).await;
    let (summary, state) = (app.show(episode).await, app.state(episode).await);
    json!({ "obs": seen, "waiting": waiting, "summary": summary, "state": state })
}

#[tokio::test]
async fn an_episode_goes_on_where_it_stood() {
    let mut app = TestApp::start().await;
    let episode = app.create(request()).await;
    app.all_act(&episode, "SWITCH").await;
    let first = app.act(episode.seat(1), &act(1)).await;
    let before = (shown(&app, &episode).await, app.journal(&episode).await);
    assert_eq!(before.0["obs"][1]["acted"], true);
    assert_eq!(before.0["waiting"].as_array().map(Vec::len), Some(2));

    app.restart().await;
    assert_eq!((shown(&app, &episode).await, app.journal(&episode).await), before);
    let again = app.act(episode.seat(1), &act(1)).await;
    assert_eq!((&again["duplicate"], &again["waiting_for"]), (&json!(true), &first["waiting_for"]));

    // The rest is played, and the journal continues from the same bytes.
    app.all_act(&episode, "STAY").await;
    app.restart().await;
    app.all_act(&episode, "STAY").await;
    let journal = app.journal(&episode).await;
    assert!(journal.starts_with(&before.1));
    let report = verified(&journal);
    assert_eq!(json!(report.head.to_string()), app.show(&episode).await["result"]["journal_head"]);

    // An episode that has ended is the same after a restart, too.
    let before = (shown(&app, &episode).await, journal);
    app.restart().await;
    assert_eq!((shown(&app, &episode).await, app.journal(&episode).await), before);
}

#[tokio::test]
async fn what_was_acknowledged_survives_a_crash() {
    let app = TestApp::start().await;
    let episode = app.create(request()).await;
    app.all_act(&episode, "SWITCH").await;
    app.act(episode.seat(2), &act(1)).await;
    let before = (shown(&app, &episode).await, app.journal(&episode).await);
    let after = app.after_a_crash().await;
    assert_eq!((shown(&after, &episode).await, after.journal(&episode).await), before);
    assert_eq!(after.act(episode.seat(2), &act(1)).await["duplicate"], true);
    after.all_act(&episode, "STAY").await;
    assert_eq!(after.state(&episode).await["round"], 2);
}

#[tokio::test]
async fn new_episodes_have_new_ids_after_a_restart() {
    let mut app = TestApp::start().await;
    let first = app.create(request()).await;
    app.restart().await;
    let second = app.create(request()).await;
    assert_ne!(first.id, second.id);
    let items = app.get("/api/v1/episodes").ok().await["items"].clone();
    assert_eq!([&items[0]["id"], &items[1]["id"]], [&json!(second.id), &json!(first.id)]);
    assert_eq!(app.obs(first.seat(0)).await["episode"], first.id);
}

#[tokio::test]
async fn a_second_server_on_the_same_database_is_refused_by_name() {
    let mut app = TestApp::start().await;
    let episode = app.create(request()).await;
    let (database, parts) = (app.location(), app.parts());
    let refused = Server::open(&database, parts).await.err().expect("a refusal").to_string();
    assert!(refused.contains(&database.to_string()), "{refused}");
    assert!(refused.contains("in use"), "{refused}");
    // The first does not notice.
    app.all_act(&episode, "SWITCH").await;
    app.stop().await;
    let parts = app.parts();
    Server::open(&database, parts).await.expect("it is free now");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stopped_server_releases_its_database_at_once() {
    let mut app = TestApp::start().await;
    let mut episodes = Vec::new();
    for _ in 0..20 {
        episodes.push(app.create(request()).await);
    }
    for episode in &episodes[..10] {
        // Somebody listens when it stops.
        let events = app.get(&episode.path("/events")).open().await;
        app.restart().await;
        drop(events);
    }
}
