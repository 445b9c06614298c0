//! The host's clock is set, jumps, or is behind: durations are not affected, and nothing happens by a wrong time of
//! day that cannot be undone.

use std::time::Duration;

use serde_json::{Value, json};

use crate::across::memory::until_in_memory;
use crate::app::{TestApp, list, number};
use crate::cup::{self, Cup};

const HOUR_MS: i64 = 3_600_000;

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

/// A server with an organizer's key and a manual clock.
async fn server() -> TestApp {
    cup::server().await
}

/// The organizer says that the host's clock is right.
async fn confirm(app: &TestApp) -> Value {
    app.post("/api/v1/clock/confirm").token(&app.organizer).ok().await
}

/// Lets the server do what is due, and asks where the competition stands.
async fn phase(app: &TestApp, cup: &Cup) -> Value {
    for _ in 0..20 {
        app.pass(Duration::from_millis(100));
        app.get("/healthz").ok().await;
    }
    cup.show(app).await["phase"].clone()
}

/// Asks for an episode until it has this status.
async fn until_status(app: &TestApp, path: &str, status: &str) {
    for _ in 0..1_000 {
        if app.get(path).token(&app.organizer).ok().await["status"] == status {
            return;
        }
        app.pass(seconds(1));
    }
    panic!("it is not {status}");
}

#[tokio::test]
async fn a_step_back_changes_no_rate_limit() {
    let app = TestApp::builder()
        .manual_clock()
        .keys()
        .limits(|limits| limits.key_requests_per_s_max = 5)
        .start()
        .await;
    let list_all = async || app.get("/api/v1/episodes").token(&app.organizer).send().await.status;
    for _ in 0..5 {
        assert_eq!(list_all().await, 200);
    }
    app.step(-14_000);
    confirm(&app).await;
    app.pass(seconds(1));
    for _ in 0..5 {
        assert_eq!(list_all().await, 200);
    }
}

#[tokio::test]
async fn an_hour_back_leaves_a_clock_of_20_seconds() {
    let app = server().await;
    let request = json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9,
        "round_deadline_s": 20,
    });
    let episode = app.create_with(&app.organizer, request).await;
    app.pass(seconds(5));
    app.step(-HOUR_MS);
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(number(&seen["remaining_ms"]), 15_000);
    assert_eq!(seen["deadline"], "2026-03-01T12:00:20.000Z", "the server's own time goes on");
    confirm(&app).await;
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(number(&seen["remaining_ms"]), 15_000);
    assert_eq!(seen["deadline"], "2026-03-01T11:00:20.000Z");
    app.act(episode.seat(0), &json!({ "round": 0, "action": "STAY" })).await;
    app.pass(seconds(15));
    assert_eq!(app.obs_after(episode.seat(0), 0).await["round"], 1);
    assert_eq!(number(&app.obs(episode.seat(0)).await["remaining_ms"]), 20_000);
    // What is written down never goes back.
    let later = "SELECT count(*) FROM episodes
                 WHERE (SELECT min(at) FROM acts) >= created_at AND (SELECT min(at) FROM rounds) >= created_at";
    assert_eq!(app.count(later).await, 1);
}

#[tokio::test]
async fn time_in_which_the_process_is_stopped_costs_no_seat_anything() {
    let app = server().await;
    let request = json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9,
        "round_deadline_s": 5,
    });
    let episode = app.create_with(&app.organizer, request).await;
    app.pass(seconds(2));
    app.clock().stop(seconds(6));
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(number(&seen["remaining_ms"]), 3_000);
    assert_eq!(seen["deadline"], "2026-03-01T12:00:11.000Z", "by the time of day it is later");
    assert_eq!(app.problems().await, "");
    let episodes = app.get("/api/v1/episodes").token(&app.organizer).ok().await;
    assert_eq!(list(&episodes["items"])[0]["created_at"], "2026-03-01T12:00:00.000Z");
}

#[tokio::test]
async fn a_jump_forward_opens_and_reveals_nothing() {
    let app = server().await;
    let cup = Cup::with(&app, json!({})).await;
    let entrant = cup.enter(&app, "ant").await;
    app.pass(Duration::from_millis(599_000 - 100));
    app.step(2_500);
    assert!(app.problems().await.contains("jumped by +2.5 s"), "{}", app.problems().await);
    assert_eq!(cup.show(&app).await["phase"], "announced");
    let start = || app.post(&cup.path("/attempts")).token(&entrant.key).json(&json!({}));
    start().problem(503, "unavailable").await;
    app.step(-2_500);
    assert_eq!(app.problems().await, "");
    start().problem(409, "closed").await;
    app.pass(seconds(2));
    let attempt = cup.start(&app, &entrant).await;
    attempt.play(&app, 1).await;
    // 12:59:58, and the clock of the host says one o'clock.
    let left = "2026-03-01T12:59:58.000Z".parse::<jiff::Timestamp>().expect("a time");
    app.pass(Duration::try_from(left.duration_since(app.now())).expect("it is not over"));
    app.step(2_500);
    // It closes meanwhile, as far as the server knows.
    assert_eq!(phase(&app, &cup).await, "closing");
    assert_eq!(phase(&app, &cup).await, "closing");
    assert!(cup.show(&app).await["seeds"].is_null());
    start().problem(503, "unavailable").await;
    app.step(-2_500);
    assert_eq!(app.problems().await, "");
    cup.closed(&app).await;
    start().problem(409, "closed").await;
}

#[tokio::test]
async fn an_organizer_confirms_a_clock_that_was_set() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    app.step(HOUR_MS);
    assert_eq!(phase(&app, &cup).await, "open");
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_clock_in_doubt"));
    let confirmed = confirm(&app).await;
    assert_eq!(confirmed["moved_ms"], HOUR_MS);
    let doubt = confirmed["doubt"].as_str().expect("it was in doubt");
    assert!(doubt.contains("jumped by +3600.0 s"), "{doubt}");
    assert_eq!(app.problems().await, "");
    cup.closed(&app).await;
    let audit = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    let entry = &list(&audit["items"])[0];
    assert_eq!(
        (&entry["action"], &entry["detail"]["moved_ms"]),
        (&json!("clock.confirm"), &json!(HOUR_MS))
    );
    assert_eq!(confirm(&app).await["doubt"], Value::Null);
}

#[tokio::test]
async fn what_is_revealed_takes_no_attempts() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let entrant = cup.enter(&app, "ant").await;
    app.tamper("UPDATE competitions SET revealed_at = 1").await;
    let start = app.post(&cup.path("/attempts")).token(&entrant.key).json(&json!({}));
    start.problem(409, "closed").await;
}

#[tokio::test]
async fn nothing_is_abandoned_while_the_clock_is_in_doubt() {
    let app = server().await;
    let request = json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9, "idle_timeout_s": 60,
    });
    let episode = app.create_with(&app.organizer, request).await;
    app.step(2_500);
    for _ in 0..30 {
        app.pass(seconds(10));
        assert_eq!(app.show(&episode).await["status"], "running");
    }
    app.step(-2_500);
    until_status(&app, &episode.path(""), "abandoned").await;
}

#[tokio::test]
async fn a_jump_that_is_confirmed_abandons_no_episode_outside_of_memory() {
    let app = server().await;
    let request = json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9, "idle_timeout_s": 7200,
    });
    let episode = app.create_with(&app.organizer, request).await;
    app.all_act(&episode, "SWITCH").await;
    let ends_at = app.now() + seconds(7200);
    until_in_memory(&app, 0).await;
    app.step(4 * HOUR_MS);
    confirm(&app).await;
    // The sweep checks when it ends, and so does the recovery.
    for _ in 0..20 {
        app.pass(seconds(10));
        assert_eq!(app.show(&episode).await["status"], "running");
    }
    assert_eq!(app.obs(episode.seat(0)).await["round"], 1);
    until_in_memory(&app, 0).await;
    while app.show(&episode).await["status"] == "running" {
        app.pass(seconds(60));
    }
    assert!(app.now() >= ends_at, "abandoned at {}, not {ends_at}", app.now());
}

#[tokio::test]
async fn a_clock_behind_the_newest_entry_is_waited_for_or_confirmed() {
    let mut app = server().await;
    let request = json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9, "idle_timeout_s": 60,
    });
    app.pass(seconds(7_200));
    let episode = app.create_with(&app.organizer, request).await;
    app.stop().await;
    // Another process begins with the clock of its host.
    app.step(-HOUR_MS);
    swarmbench_clock::Clock::confirm(app.clock());
    app.start_in_doubt().await;
    app.pass(seconds(1_800));
    assert_eq!(app.show(&episode).await["status"], "running");
    assert!(app.problems().await.contains("behind the newest entry"));
    app.pass(seconds(1_801));
    assert_eq!(app.problems().await, "");
    until_status(&app, &episode.path(""), "abandoned").await;
    // Once more, and an organizer says that it is right; the next start need not ask again.
    app.stop().await;
    app.step(-HOUR_MS);
    swarmbench_clock::Clock::confirm(app.clock());
    app.start_in_doubt().await;
    confirm(&app).await;
    assert_eq!(app.problems().await, "");
    app.pass(seconds(1));
    app.restart().await;
}
