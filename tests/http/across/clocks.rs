//! Round clocks, banks and idle episodes, by a clock that is moved by hand.

use std::time::Duration;

use serde_json::{Value, json};

use crate::app::{Episode, TestApp, number, until};

fn request(deadline: u32, bank: u32) -> Value {
    json!({
        "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 9,
        "round_deadline_s": deadline, "bank_s": bank,
    })
}

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

async fn act(app: &TestApp, episode: &Episode, seat: usize, round: u64) {
    app.act(episode.seat(seat), &json!({ "round": round, "action": "SWITCH" })).await;
}

/// Time left to a seat: until its clock runs out, and of its bank.
async fn left(app: &TestApp, episode: &Episode, seat: usize) -> (u64, u64) {
    let seen = app.obs(episode.seat(seat)).await;
    (number(&seen["remaining_ms"]), number(&seen["bank_ms"]))
}

/// Asks until the clock of a seat is known to have run out in the open round.
async fn until_acted(app: &TestApp, episode: &Episode, seat: usize) {
    let acted = async || app.obs(episode.seat(seat)).await["acted"] == true;
    until("the clock runs out", acted).await;
}

/// The acts of a round in the journal.
async fn journaled(app: &TestApp, episode: &Episode, round: usize) -> Value {
    let journal = app.journal(episode).await;
    let line = journal.lines().nth(1 + round).expect("a resolved round");
    serde_json::from_str::<Value>(line).expect("JSON")["record"]["acts"].clone()
}

#[tokio::test]
async fn a_clock_that_runs_out_costs_only_its_own_seat_the_move() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 0)).await;
    act(&app, &episode, 0, 0).await;
    app.pass(Duration::from_millis(9_999));
    assert_eq!(left(&app, &episode, 1).await, (1, 0));
    assert_eq!(app.obs(episode.seat(1)).await["round"], 0);
    app.pass(Duration::from_millis(1));
    let seen = app.obs_after(episode.seat(1), 0).await;
    assert_eq!(seen["history"], json!([{ "round": 0, "action": null, "message": null }]));
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(seen["history"][0]["action"], "SWITCH");
    assert_eq!(
        journaled(&app, &episode, 0).await,
        json!([
            { "agent": "Agent_0", "source": "player", "action": "SWITCH", "valid": true },
            { "agent": "Agent_1", "source": "clock", "action": null, "valid": true },
        ])
    );
    let late = app.post("/act").token(episode.seat(1)).json(&json!({ "round": 0, "action": "UP" }));
    assert_eq!(late.problem(409, "round_over").await["round"], 1);
    act(&app, &episode, 1, 1).await;
}

#[tokio::test]
async fn rounds_go_on_when_nobody_acts() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 0)).await;
    for round in 0..9 {
        assert_eq!(app.obs(episode.seat(0)).await["round"], round);
        app.pass(seconds(10));
        app.obs_after(episode.seat(0), round).await;
    }
    let shown = app.show(&episode).await;
    assert_eq!((&shown["status"], number(&shown["round"])), (&json!("finished"), 9));
}

#[tokio::test]
async fn the_deadline_is_the_opening_and_both() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 5)).await;
    let clock = |seen: &Value| {
        [&seen["deadline"], &seen["remaining_ms"], &seen["bank_ms"]].map(Clone::clone)
    };
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(clock(&seen), [json!("2026-03-01T12:00:15.000Z"), json!(15_000), json!(5_000)]);
    // The bank is used last.
    app.pass(seconds(10));
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(clock(&seen), [json!("2026-03-01T12:00:15.000Z"), json!(5_000), json!(5_000)]);
    app.pass(seconds(3));
    let seen = app.obs(episode.seat(0)).await;
    assert_eq!(clock(&seen), [json!("2026-03-01T12:00:15.000Z"), json!(2_000), json!(2_000)]);
}

#[tokio::test]
async fn what_a_seat_overspends_comes_out_of_its_bank() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 5)).await;
    // Round 0: seat 1 is quick, seat 0 overspends 2 seconds.
    act(&app, &episode, 1, 0).await;
    app.pass(seconds(12));
    act(&app, &episode, 0, 0).await;
    assert_eq!(left(&app, &episode, 0).await, (13_000, 3_000));
    assert_eq!(left(&app, &episode, 1).await, (15_000, 5_000));
    assert_eq!(journaled(&app, &episode, 0).await[0]["bank_spent_ms"], 2_000);
    // Round 1: the bank of seat 0 is used up, seat 1 may still act and spends 3 seconds.
    app.pass(seconds(13));
    until_acted(&app, &episode, 0).await;
    assert_eq!(left(&app, &episode, 1).await, (2_000, 2_000));
    act(&app, &episode, 1, 1).await;
    let acts = journaled(&app, &episode, 1).await;
    assert_eq!((&acts[0]["source"], &acts[0]["bank_spent_ms"]), (&json!("clock"), &json!(3_000)));
    assert_eq!((&acts[1]["source"], &acts[1]["bank_spent_ms"]), (&json!("player"), &json!(3_000)));
    // Round 2: what is left.
    assert_eq!(left(&app, &episode, 0).await, (10_000, 0));
    assert_eq!(left(&app, &episode, 1).await, (12_000, 2_000));
    // A round in time costs nothing.
    app.pass(seconds(9));
    act(&app, &episode, 0, 2).await;
    act(&app, &episode, 1, 2).await;
    assert_eq!(left(&app, &episode, 0).await, (10_000, 0));
    assert_eq!(left(&app, &episode, 1).await, (12_000, 2_000));
}

#[tokio::test]
async fn the_clock_of_a_manual_episode_begins_with_its_start() {
    let app = TestApp::with_manual_clock().await;
    let mut request = request(10, 0);
    request["start"] = json!("manual");
    let episode = app.create(request).await;
    app.pass(seconds(100));
    assert_eq!(app.obs(episode.seat(0)).await["deadline"], Value::Null);
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    assert_eq!(left(&app, &episode, 0).await, (10_000, 0));
    assert_eq!(app.obs(episode.seat(0)).await["deadline"], "2026-03-01T12:01:50.000Z");
}

#[tokio::test]
async fn a_restart_gives_the_open_round_its_full_clock_and_keeps_the_banks() {
    let mut app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 5)).await;
    act(&app, &episode, 1, 0).await;
    app.pass(seconds(14));
    act(&app, &episode, 0, 0).await;
    app.pass(seconds(9));
    assert_eq!(left(&app, &episode, 0).await, (2_000, 1_000));
    app.stop().await;
    // Time in which no server runs is nobody's.
    app.pass(seconds(1_000));
    app.start_again().await;
    assert_eq!(left(&app, &episode, 0).await, (11_000, 1_000));
    assert_eq!(left(&app, &episode, 1).await, (15_000, 5_000));
    app.pass(seconds(11));
    until_acted(&app, &episode, 0).await;
    act(&app, &episode, 1, 1).await;
    assert_eq!(left(&app, &episode, 0).await, (10_000, 0));
    assert_eq!(left(&app, &episode, 1).await, (14_000, 4_000));
}

#[tokio::test]
async fn the_clock_of_a_game_that_takes_long_to_play_again_begins_when_it_is_back() {
    // All hear each other, so its rounds may be dear; as nobody says anything they are not.
    let mut app = TestApp::with_manual_clock().await;
    let request = json!({
        "task": "Pursuit", "seed": 1, "num_agents": 256, "width": 64, "height": 64, "view_size": 63,
        "memory": 0, "max_round": 20, "round_deadline_s": 10,
    });
    let episode = app.create(request).await;
    for round in 0..12 {
        app.pass(seconds(10));
        assert_eq!(app.obs_after(episode.seat(0), round).await["round"], round + 1);
    }
    app.pass(seconds(6));
    app.restart().await;
    // Recovered already or not: a request waits until it is.
    assert_eq!(left(&app, &episode, 0).await, (10_000, 0));
    assert_eq!(app.obs(episode.seat(0)).await["round"], 12);
    app.pass(seconds(10));
    assert_eq!(app.obs_after(episode.seat(0), 12).await["round"], 13);
}

#[tokio::test]
async fn clocks_go_on_after_a_restart_without_a_request() {
    let mut app = TestApp::with_manual_clock().await;
    let episode = app.create(request(10, 0)).await;
    act(&app, &episode, 0, 0).await;
    app.restart().await;
    app.pass(seconds(10));
    // The list reads the database alone and wakes no episode up.
    let goes_on = async || app.get("/api/v1/episodes").ok().await["items"][0]["round"] == 1;
    until("the round ends by its clock", goes_on).await;
}

mod idle {
    use super::*;

    fn request() -> Value {
        json!({ "task": "Synchronization", "num_agents": 2, "idle_timeout_s": 60 })
    }

    async fn expect_abandoned(app: &TestApp, episode: &Episode, round: u64) {
        let seen = app.get("/obs?after=100000&wait=60").token(episode.seat(0)).ok().await;
        assert_eq!(seen["status"], "abandoned");
        assert_eq!((&seen["result"]["reason"], number(&seen["round"])), (&json!("idle"), round));
        assert_eq!(app.show(episode).await["status"], "abandoned");
    }

    #[tokio::test]
    async fn an_episode_is_abandoned_so_long_after_the_last_act() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request()).await;
        for _ in 0..3 {
            app.pass(seconds(59));
            assert_eq!(app.obs(episode.seat(0)).await["status"], "running");
            app.all_act(&episode, "SWITCH").await;
        }
        app.pass(seconds(60));
        expect_abandoned(&app, &episode, 3).await;
        let act =
            app.post("/act").token(episode.seat(0)).json(&json!({ "round": 3, "action": "UP" }));
        act.problem(409, "episode_over").await;
    }

    #[tokio::test]
    async fn an_episode_that_was_never_started_is_abandoned_too() {
        let app = TestApp::with_manual_clock().await;
        let mut request = request();
        request["start"] = json!("manual");
        let episode = app.create(request).await;
        app.pass(seconds(60));
        expect_abandoned(&app, &episode, 0).await;
    }

    #[tokio::test]
    async fn clocks_that_run_out_are_no_acts() {
        let app = TestApp::with_manual_clock().await;
        let mut request = request();
        request["round_deadline_s"] = json!(25);
        let episode = app.create(request).await;
        for round in 0..2 {
            app.pass(seconds(25));
            app.obs_after(episode.seat(0), round).await;
        }
        app.pass(seconds(10));
        expect_abandoned(&app, &episode, 2).await;
    }

    #[tokio::test]
    async fn the_time_since_the_last_act_is_kept_over_a_restart() {
        let mut app = TestApp::with_manual_clock().await;
        let episode = app.create(request()).await;
        app.pass(seconds(40));
        app.all_act(&episode, "SWITCH").await;
        app.pass(seconds(30));
        app.restart().await;
        app.pass(seconds(29));
        assert_eq!(app.obs(episode.seat(0)).await["status"], "running");
        app.pass(seconds(1));
        expect_abandoned(&app, &episode, 1).await;
    }

    #[tokio::test]
    async fn clocks_that_run_out_are_no_acts_after_a_restart_either() {
        let mut app = TestApp::with_manual_clock().await;
        let mut request = request();
        request["round_deadline_s"] = json!(50);
        let episode = app.create(request).await;
        app.pass(seconds(50));
        app.obs_after(episode.seat(0), 0).await;
        app.restart().await;
        app.pass(seconds(10));
        expect_abandoned(&app, &episode, 1).await;
    }

    #[tokio::test]
    async fn a_manual_start_counts_as_an_act_over_a_restart() {
        let mut app = TestApp::with_manual_clock().await;
        let mut request = request();
        request["start"] = json!("manual");
        let episode = app.create(request).await;
        app.pass(seconds(50));
        app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
        app.restart().await;
        app.pass(seconds(59));
        assert_eq!(app.obs(episode.seat(0)).await["status"], "running");
        app.pass(seconds(1));
        expect_abandoned(&app, &episode, 0).await;
    }
}
