//! Faults stay alone: an entry that the database refuses, a locked database, a competition that cannot be
//! closed.

use std::time::Duration;
use swarmbench_testkit::needs;

use futures::future::join_all;
use serde_json::{Value, json};

use crate::app::{Episode, TestApp, number};
use crate::cup::{self, Cup};

/// From now on the database refuses acts whose reasoning says so.
const REFUSE: &str = "CREATE TRIGGER refuse BEFORE INSERT ON acts
    WHEN NEW.record LIKE '%the database refuses this%'
    BEGIN SELECT raise(ABORT, 'refused by a test'); END";

/// The same for PostgreSQL.
const REFUSE_IN_POSTGRES: &str = "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN RAISE EXCEPTION USING ERRCODE = '23514', MESSAGE = 'refused by a test'; END $$;
    CREATE TRIGGER refuse BEFORE INSERT ON acts FOR EACH ROW
    WHEN (NEW.record LIKE '%the database refuses this%') EXECUTE FUNCTION refuse()";

fn request(agents: u32) -> Value {
    json!({ "task": "Synchronization", "seed": 1, "num_agents": agents, "max_round": 5 })
}

fn act(round: u64) -> Value {
    json!({ "round": round, "action": "SWITCH" })
}

fn refused(round: u64) -> Value {
    json!({ "round": round, "action": "SWITCH", "reasoning": "the database refuses this" })
}

async fn sent(app: &TestApp, token: &str, act: &Value) -> u16 {
    app.post("/act").token(token).json(act).send().await.status
}

/// Plays an episode to its end, and returns its journal as the server has it.
async fn played(app: &TestApp, episode: &Episode) -> String {
    while app.show(episode).await["status"] == "running" {
        app.all_act(episode, "SWITCH").await;
    }
    app.journal(episode).await
}

#[tokio::test]
async fn an_entry_that_the_database_refuses_fails_alone() {
    let mut app = TestApp::with_manual_clock().await;
    let (one, other) = (app.create(request(4)).await, app.create(request(4)).await);
    app.tamper_in(REFUSE, REFUSE_IN_POSTGRES).await;
    for round in 0..3 {
        // All at once: some of them are in one transaction.
        let refused = refused(round);
        let bad = sent(&app, one.seat(0), &refused);
        let acts = [act(round), act(round), act(round), act(round)];
        let good = (0..4).map(|seat| sent(&app, other.seat(seat), &acts[seat]));
        let same = (1..4).map(|seat| sent(&app, one.seat(seat), &acts[seat]));
        let (bad, good, same) = futures::join!(bad, join_all(good), join_all(same));
        assert_eq!((bad, good), (503, vec![200; 4]));
        assert!(same.iter().all(|status| [200, 503].contains(status)), "{same:?}");
        assert_eq!(app.problems().await, "", "writing goes on");
        // What was acknowledged is the same act again, what was not is sent again.
        for (seat, first) in (1..4).zip(same) {
            let receipt = app.act(one.seat(seat), &act(round)).await;
            assert!(first != 200 || receipt["duplicate"] == true, "an acknowledged act is kept");
        }
        app.act(one.seat(0), &act(round)).await;
        // One that fails again and again is recovered once a second.
        app.pass(Duration::from_secs(1));
    }
    let journals = [played(&app, &one).await, played(&app, &other).await];
    app.restart().await;
    assert_eq!(journals, [app.journal(&one).await, app.journal(&other).await]);
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_jobs_refused_total"), "{metrics}");
}

#[tokio::test]
async fn requests_that_wait_for_a_failed_episode_are_answered() {
    let app = TestApp::builder().manual_clock().start().await;
    let episode = app.create(request(2)).await;
    app.tamper_in(REFUSE, REFUSE_IN_POSTGRES).await;
    let seat = app.get("/obs?after=0&wait=60").token(episode.seat(1));
    let swarm = app.get("/swarm/obs?wait=60").token(&episode.swarm);
    let first = swarm.ok().await;
    let cursor = first["cursor"].as_str().expect("a cursor");
    let again = app.get(&format!("/swarm/obs?wait=60&after={cursor}")).token(&episode.swarm);
    let (seat, again) = (tokio::spawn(seat.send()), tokio::spawn(again.send()));
    while !app.get("/metrics").send().await.text().contains("swarmbench_waits 2") {}
    assert_eq!(sent(&app, episode.seat(0), &refused(0)).await, 503);
    let seen = seat.await.expect("no panic");
    assert_eq!((seen.status, &seen.json()["round"]), (200, &json!(0)));
    // It is recovered for new requests, and the waiting one sees it continue.
    app.act(episode.seat(0), &act(0)).await;
    app.act(episode.seat(1), &act(0)).await;
    let seen = app.pass_until(again).await.json();
    assert!(seen["observations"].as_array().is_some_and(|seen| !seen.is_empty()), "{seen}");
}

#[needs(sqlite)]
#[tokio::test]
async fn a_locked_database_is_waited_for() {
    let app = TestApp::start().await;
    let episode = app.create(request(2)).await;
    let mut other = app.other_program().await;
    sqlx::raw_sql("BEGIN IMMEDIATE").execute(&mut other).await.expect("it is free");
    let act = act(0);
    let (acting, ()) = futures::join!(app.act(episode.seat(0), &act), async {
        app.until_problem("locked the database").await;
        sqlx::raw_sql("COMMIT").execute(&mut other).await.expect("it was begun");
    });
    assert_eq!(number(&acting["waiting_for"]), 1);
    assert_eq!(app.problems().await, "");
}

#[tokio::test]
async fn a_competition_that_cannot_be_closed_keeps_no_other_open() {
    let app = cup::server().await;
    let (broken, good) = (
        Cup::open(&app, json!({})).await,
        Cup::with(&app, json!({ "opens_at": "2026-03-01T12:20:00Z" })).await,
    );
    app.tamper("UPDATE competitions SET definition = '{' WHERE key = 1").await;
    app.pass(Duration::from_hours(1));
    good.closed(&app).await;
    app.get(&broken.path("")).send().await;
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_closing_failures_total"), "{metrics}");
}

#[tokio::test]
async fn bytes_that_wait_for_the_disk_have_a_bound() {
    let app = TestApp::builder().limits(|limits| limits.backlog_bytes_max = 0).start().await;
    let episode = app.create(request(2)).await;
    let problem =
        app.post("/act").token(episode.seat(0)).json(&act(0)).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "backlog_bytes_max", "{problem}");
}
