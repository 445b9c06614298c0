//! Long answers and slow readers, and the memory that all worlds and answers take together.

use std::time::Duration;

use serde_json::{Value, json};
use swarmbench::journal::replay::{Report, verify};
use swarmbench_engine::physics::Solver;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpSocket, TcpStream};

use crate::app::{Episode, TestApp, list, number};

/// Plays rounds in which each seat tells a long story.
async fn talk(app: &TestApp, episode: &Episode, rounds: u64, bytes: usize) {
    for round in 0..rounds {
        for (number, token) in episode.seats().enumerate() {
            let text = format!("{number}\u{1F41D}{}", "x".repeat(bytes));
            let act = json!({ "round": round, "action": "STAY", "reasoning": text });
            app.act(token, &act).await;
        }
    }
}

fn request(agents: u64, rounds: u64) -> Value {
    json!({ "task": "Synchronization", "seed": 6, "num_agents": agents, "max_round": rounds })
}

fn verified(journal: &str) -> Report {
    verify(journal.as_bytes(), None, Solver::Flow, |_, _| ()).expect("it plays again")
}

#[tokio::test]
async fn a_journal_is_the_same_whatever_its_parts_are() {
    let mut app =
        TestApp::builder().limits(|limits| limits.stream_part_bytes_max = 700).start().await;
    // It ends with acts of a round that was not resolved, which make a large end record.
    let episode = app.create(request(3, 20)).await;
    talk(&app, &episode, 5, 500).await;
    app.all_act(&episode, "SWITCH").await;
    for number in 0..2 {
        let act = json!({ "round": 6, "action": "STAY", "reasoning": "[]".repeat(40_000) });
        app.act(episode.seat(number), &act).await;
    }
    app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    let journal = app.journal(&episode).await;
    let lines: Vec<Value> =
        journal.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), 1 + 6 + 1);
    assert_eq!(list(&lines[1]["record"]["acts"]).len(), 3);
    assert_eq!(list(&lines[7]["record"]["open_acts"]).len(), 2);
    // The hashes are those of the records as they were kept.
    verified(&journal);
    let head = app.show(&episode).await["result"]["journal_head"].clone();
    assert_eq!(lines[7]["hash"], head);
    // After a restart it is what it was, though nobody reads all of its end for that.
    let before = (app.show(&episode).await, app.state(&episode).await);
    app.restart().await;
    assert_eq!((app.show(&episode).await, app.state(&episode).await), before);
    assert_eq!(before.0["status"], "aborted");
}

/// A connection that asks for something and takes nearly nothing of it.
async fn deaf(app: &TestApp, path: &str, token: &str) -> TcpStream {
    let socket = TcpSocket::new_v4().expect("a socket");
    socket.set_recv_buffer_size(4096).expect("a small buffer");
    let address = app.base().strip_prefix("http://").expect("an address");
    let mut stream = socket.connect(address.parse().expect("an address")).await.expect("open");
    let request =
        format!("GET {path} HTTP/1.1\r\nHost: test\r\nAuthorization: Bearer {token}\r\n\r\n");
    stream.write_all(request.as_bytes()).await.expect("it is open");
    stream.readable().await.expect("the answer begins");
    stream
}

#[tokio::test]
async fn slow_readers_keep_nobody_from_journals_and_exports() {
    let app = TestApp::builder()
        .limits(|limits| (limits.journals_max, limits.exports_max) = (1, 1))
        .start()
        .await;
    // Far more than the buffers of a connection with a slow reader hold.
    let episode = app.create(request(2, 20)).await;
    talk(&app, &episode, 20, 250_000).await;
    let journal = episode.path("/journal");
    let export = "/api/v1/exports/acts.jsonl";
    let mut slow = Vec::new();
    for _ in 0..2 {
        slow.push(deaf(&app, &journal, &episode.swarm).await);
        slow.push(deaf(&app, export, &episode.swarm).await);
    }
    let whole = app.journal(&episode).await;
    assert!(whole.len() > 10_000_000, "{}", whole.len());
    verified(&whole);
    let lines = app.get(export).token(&episode.swarm).send().await;
    assert_eq!((lines.status, lines.text().lines().count()), (200, 40));
    drop(slow);
}

#[tokio::test]
async fn open_exports_and_event_streams_have_places_by_party() {
    let app = TestApp::builder()
        .limits(|limits| {
            limits.exports_open_per_party_max = 1;
            limits.event_streams_per_party_max = 1;
        })
        .start()
        .await;
    let episode = app.create(request(2, 40)).await;
    let events = episode.path("/events");
    let listening = app.get(&events).token(&episode.swarm).open().await;
    let problem = app.get(&events).token(&episode.swarm).problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "event_streams_per_party_max", "value": 1 }));
    // A client that has gone has no permit any more.
    drop(listening);
    while app.get(&events).token(&episode.swarm).open().await.status() != 200 {}
    talk(&app, &episode, 40, 100_000).await;
    let export = "/api/v1/exports/acts.jsonl";
    let slow = deaf(&app, export, &episode.swarm).await;
    let problem = app.get(export).token(&episode.swarm).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "exports_open_per_party_max");
    drop(slow);
    while app.get(export).token(&episode.swarm).send().await.status != 200 {}
}

/// A world of about 200 kB in its first round.
fn large() -> Value {
    json!({
        "task": "Synchronization", "num_agents": 1, "width": 256, "height": 256, "view_size": 3,
        "memory": 5, "max_round": 50, "visibility": "public",
    })
}

#[tokio::test]
async fn idle_worlds_leave_memory_when_others_need_it_and_come_back() {
    let app = TestApp::builder()
        .manual_clock()
        .limits(|limits| limits.memory_bytes_max = 2_000_000)
        .start()
        .await;
    let mut games = Vec::new();
    for _ in 0..20 {
        let game = app.create(large()).await;
        app.all_act(&game, "STAY").await;
        games.push((app.obs(game.seat(0)).await, game));
        app.pass(Duration::from_secs(11));
    }
    for (seen, game) in &games {
        assert_eq!(&app.obs(game.seat(0)).await, seen);
        app.pass(Duration::from_secs(11));
    }
    // Nobody waits for the sweep, which comes after five minutes without a request.
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_evictions_total"), "{metrics}");
}

#[tokio::test]
async fn a_full_server_refuses_what_is_large_and_plays_on_what_is_small() {
    let mut app = TestApp::builder()
        .manual_clock()
        .limits(|limits| limits.memory_bytes_max = 2_000_000)
        .start()
        .await;
    let small = app.create(request(2, 3)).await;
    // All of them were just asked for.
    let mut games = Vec::new();
    let refused = loop {
        let answer = app.post("/api/v1/episodes").json(&large()).send().await;
        if answer.status != 201 {
            break answer;
        }
        games.push(Episode::of(&answer.json()));
        assert!(games.len() < 20, "all of them fit");
    };
    assert_eq!((refused.status, refused.header("retry-after")), (503, "5"));
    let limit = json!({ "name": "memory_bytes_max", "value": 2_000_000 });
    assert_eq!(refused.json()["limit"], limit);
    // A state of 65,536 cells is a large answer.
    let problem = app.get(&games[0].path("/state")).problem(503, "overloaded").await;
    assert_eq!(problem["limit"], limit);
    // What is small is created and played as ever, and so is every game that is there.
    let another = app.create(request(2, 3)).await;
    for game in [&small, &another] {
        while app.show(game).await["status"] == "running" {
            app.all_act(game, "STAY").await;
        }
        assert_eq!(number(&app.show(game).await["result"]["rounds"]), 3);
        verified(&app.journal(game).await);
    }
    for game in &games {
        app.all_act(game, "STAY").await;
    }
    // The same holds for games that are recovered after a restart.
    app.restart().await;
    let mut found = 0;
    for game in &games {
        let answer = app.get("/obs").token(game.seat(0)).send().await;
        if answer.status == 200 {
            found += 1;
        } else {
            assert_eq!(answer.json()["limit"], limit);
        }
    }
    assert!((1..games.len()).contains(&found), "{found} of {}", games.len());
    app.pass(Duration::from_secs(11));
    for game in games.iter().rev() {
        app.obs(game.seat(0)).await;
        app.pass(Duration::from_secs(11));
    }
}
