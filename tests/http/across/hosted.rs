//! Players that the server itself hosts.

use std::sync::Arc;

use futures::future::join_all;
use serde_json::{Value, json};
use swarmbench_engine::TaskName;
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{RawRecord, Record};
use swarmbench_journal::replay::verify;

use crate::app::{Episode, TestApp, list, verified};

/// A game that the server plays by itself, once it has ended.
async fn ended(app: &TestApp, episode: &Episode) -> Value {
    let wait = app.get("/swarm/obs?wait=60").token(&episode.swarm).ok().await;
    assert_eq!(wait["finished"], true, "{wait}");
    app.show(episode).await
}

/// The rounds of a journal, without what differs between two games that are played alike.
fn rounds(journal: &str) -> Vec<String> {
    let record = |line: &str| {
        let raw = RawRecord::from_stored(line[84..line.len() - 1].to_owned()).expect("JSON");
        match raw.read().expect("a record") {
            Record::Round(_) => Some(raw.as_str().to_owned()),
            Record::Opening(_) | Record::Seats(_) | Record::End(_) => None,
        }
    };
    journal.lines().filter_map(record).collect()
}

#[tokio::test]
async fn the_server_plays_a_whole_episode_of_every_task() {
    let app = TestApp::start().await;
    for task in TaskName::ALL {
        let player = swarmbench_players::default_for(task).name;
        let request =
            json!({ "task": task.name(), "seed": 27, "max_round": 20, "player": "default" });
        let created = app.post("/api/v1/episodes").json(&request).ok().await;
        assert_eq!(list(&created["seats"]), Vec::<Value>::new(), "the server has them");
        assert_eq!(created["config"]["seed"], 27);
        assert_eq!(created["config"]["model"], format!("built-in/{player}"));
        let episode = Episode::of(&created);
        let shown = ended(&app, &episode).await;
        assert_eq!(shown["status"], "finished");
        let journal = app.journal(&episode).await;
        let head = shown["result"]["journal_head"].as_str().and_then(Head::parse);
        let report = verify(journal.as_bytes(), head, Solver::Flow, |_, _| ()).expect("a proof");
        let seats = report.seats.expect("who held which seat");
        assert_eq!(seats.holders.len(), 1);
        assert_eq!(seats.holders[0].player.as_deref(), Some(player));
        let held = app.get(&episode.path("/claims")).ok().await;
        assert_eq!(held["seats"][7]["holder"], "server");

        // The same seed is played the same again.
        let again = app.create(request).await;
        ended(&app, &again).await;
        assert_eq!(rounds(&app.journal(&again).await), rounds(&journal));
    }
}

/// Plays a game of one seat of its own among hosted ones, which therefore goes no faster than it says.
async fn play(request: &Value, restarts: &[u64]) -> Vec<String> {
    let mut app = TestApp::start().await;
    let episode = app.create(request.clone()).await;
    for round in 0..request["max_round"].as_u64().expect("a number") {
        let wait = app.get("/swarm/obs?wait=60").token(&episode.swarm).ok().await;
        assert_eq!(wait["observations"][0]["round"], round, "{wait}");
        match restarts.iter().position(|at| *at == round) {
            None => {}
            // In order or not; the others may have acted in this round, or not yet.
            Some(place) if place % 2 == 0 => app.restart().await,
            Some(_) => app = app.after_a_crash().await,
        }
        app.act(episode.seat(0), &json!({ "round": round, "action": "STAY" })).await;
        app.obs_after(episode.seat(0), round).await;
    }
    rounds(&app.journal(&episode).await)
}

#[tokio::test]
async fn a_restart_changes_nothing_of_what_hosted_players_do() {
    for (task, player) in
        [("Foraging", "map-and-carry"), ("Pursuit", "close-in"), ("Synchronization", "random")]
    {
        let request = json!({
            "task": task, "seed": 5, "num_agents": 6, "max_round": 14, "open_seats": 5,
            "fill_after_s": 0, "fill_with": player,
        });
        let undisturbed = play(&request, &[]).await;
        assert_eq!(undisturbed.len(), 14);
        assert_eq!(play(&request, &[2, 3, 7, 8, 12]).await, undisturbed, "{task}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_hosted_games_go_on_at_once() {
    let app = Arc::new(TestApp::start().await);
    let request =
        json!({ "task": "Synchronization", "num_agents": 3, "max_round": 5, "player": "random" });
    let games = join_all((0..40).map(|_| app.create(request.clone()))).await;
    for game in &games {
        assert_eq!(ended(&app, game).await["round"], 5);
    }
}

#[tokio::test]
async fn hosted_seats_wait_for_the_manual_start() {
    let mut app = TestApp::start().await;
    let request = json!({
        "task": "Synchronization", "num_agents": 3, "max_round": 5, "player": "random", "start": "manual",
    });
    let episode = app.create(request).await;
    app.restart().await;
    assert_eq!(app.show(&episode).await["status"], "waiting");
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    assert_eq!(ended(&app, &episode).await["round"], 5);
    let journal = app.journal(&episode).await;
    verified(&journal);
}
