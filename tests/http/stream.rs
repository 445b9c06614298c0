//! Long answers and slow readers.

use serde_json::{Value, json};
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpSocket, TcpStream};

use crate::app::{Episode, TestApp, list, verified};

/// Plays rounds in which each seat sends a long text.
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
    let app = TestApp::builder().limits(|limits| limits.heavy_at_once_max = 1).start().await;
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
async fn strangers_leave_streams_and_exports_to_each_other_and_to_organizers() {
    let builder = TestApp::builder().keys().access(|access| {
        access.trusted_proxies = vec!["127.0.0.0/8".parse().expect("a net")];
    });
    let limits = builder.limits(|limits| {
        (limits.event_streams_max, limits.exports_open_max) = (8, 8);
        limits.journal_bytes_per_key_s_max = 0;
    });
    let app = limits.start().await;
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 40, "visibility": "public" });
    let (key, _) = app.key(json!({ "name": "blue" })).await;
    let episode = app.create_with(&key, request).await;
    let events = episode.path("/events");
    let listen =
        |number: usize| app.get(&events).header("x-forwarded-for", &format!("198.51.100.{number}"));
    let mut listening = Vec::new();
    for number in 0..8 {
        loop {
            let stream = listen(number).open().await;
            if stream.status() != 200 {
                break;
            }
            listening.push((number, stream));
        }
    }
    let of_first = listening.iter().filter(|(number, _)| *number == 0).count();
    assert_eq!((listening.len(), of_first), (8, 4), "half for the first, and so on");
    let problem = listen(9).problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "event_streams_max", "value": 8 }));
    assert_eq!(app.get(&events).token(&app.organizer).open().await.status(), 200);
    // A client that has gone has no stream any more.
    drop(listening);
    while listen(9).open().await.status() != 200 {}
    talk(&app, &episode, 20, 250_000).await;
    app.delete(&episode.path("")).token(&key).ok().await;
    let export = "/api/v1/exports/acts.jsonl";
    let mut slow = Vec::new();
    let refused = loop {
        assert!(slow.len() <= 8, "the limit");
        slow.push(deaf(&app, export, &key).await);
        let mut status = [0; 12];
        while slow.last().expect("one").peek(&mut status).await.expect("an answer") < 12 {}
        if status.ends_with(b"503") {
            break slow.len() - 1;
        }
    };
    assert_eq!(refused, 4, "half of all for one key");
    let lines = app.get(export).token(&app.organizer).send().await;
    assert_eq!((lines.status, lines.text().lines().count()), (200, 40));
}
