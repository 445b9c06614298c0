//! SIGTERM: all that waits is answered, nothing that was acknowledged is lost, and the process is gone soon.

use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use reqwest::RequestBuilder;
use serde_json::{Value, json};
use swarmbench_protocol::act::{ActResponse, SwarmObsResponse};
use swarmbench_protocol::episode::{CreatedEpisode, RoundEvent};
use swarmbench_protocol::observation::Observation;
use swarmbench_testkit::dice::{Dice, seed};
use swarmbench_testkit::program::{Server, Site, complaints};
use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use crate::campaign::audit::{audit, check_left_behind};
use crate::campaign::clients::{Clients, while_playing};

/// Stops of the server while many play.
const STOPS: u64 = 5;

/// Stops a server in good order and checks what it leaves behind.
async fn stop(site: &Site, server: Server) {
    let base = site.door.after(server.run - 1).await.base;
    let (status, taken, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "after {taken:?}: {log:#?}");
    assert_eq!(complaints(&log), Vec::<&String>::new());
    let port = base.trim_start_matches("http://");
    TcpListener::bind(port).await.expect("the port is free");
    check_left_behind(site).await;
}

pub(crate) async fn games_go_on_after_every_stop() {
    let seed = seed("stop");
    let site = Site::new();
    let clients = Clients::new(seed, site.door.clone());
    let mut tables = clients.sit_down(4);
    while_playing(&mut tables, async {
        for number in 0..STOPS {
            let mut server = site.start();
            server.ready().await;
            clients.all_checked(server.run).await;
            let more = 20 + Dice::of(seed, &format!("stop {number}")).below(60);
            clients.further(&clients.acknowledged, more).await;
            stop(&site, server).await;
        }
    })
    .await;
    let mut server = site.start();
    server.ready().await;
    clients.finish(tables).await;
    audit(&site, server, &clients).await;
}

/// A server with one episode of four seats, and who asks it.
struct Waiting {
    http: reqwest::Client,
    base: String,
    episode: CreatedEpisode,
}

impl Waiting {
    async fn new(site: &Site, run: u64) -> Self {
        let request = json!({ "task": "Synchronization", "num_agents": 4, "seed": 1 });
        Self::at(site, run, request).await
    }

    async fn at(site: &Site, run: u64, request: Value) -> Self {
        let http = reqwest::Client::new();
        let base = site.door.after(run - 1).await.base;
        let created = http.post(format!("{base}/api/v1/episodes")).json(&request).send().await;
        let episode = created.expect("an answer").json().await.expect("an episode");
        Self { http, base, episode }
    }

    fn get(&self, path: &str, token: &str) -> RequestBuilder {
        self.http.get(format!("{}{path}", self.base)).bearer_auth(token)
    }

    fn act(&self, seat: usize, query: &str, round: u32) -> RequestBuilder {
        let call = self.http.post(format!("{}/act{query}", self.base));
        let act = json!({ "round": round, "action": "SWITCH", "message": "before the stop" });
        call.bearer_auth(self.token(seat)).json(&act)
    }

    fn token(&self, seat: usize) -> &str {
        &self.episode.seats[seat].token
    }

    async fn read<T: serde::de::DeserializeOwned>(call: RequestBuilder) -> T {
        let answer = call.send().await.expect("an answer");
        assert_eq!(answer.status(), 200);
        answer.json().await.expect("a whole answer")
    }

    /// Waits until so many requests wait for something.
    async fn all_wait(&self, count: usize) {
        let expected = format!("swarmbench_waits {count}");
        for _ in 0..10_000 {
            let metrics = self.http.get(format!("{}/metrics", self.base)).send().await;
            let metrics = metrics.expect("an answer").text().await.expect("a text");
            if metrics.lines().any(|line| line == expected) {
                return;
            }
        }
        panic!("there are not {count} waits");
    }
}

pub(crate) async fn whoever_waits_is_answered_in_full() {
    let site = Site::new();
    let mut server = site.start();
    server.ready().await;
    let waiting = Waiting::new(&site, server.run).await;
    // One round is over, in the next one the first seat has acted.
    for seat in 0..4 {
        Waiting::read::<ActResponse>(waiting.act(seat, "", 0)).await;
    }
    Waiting::read::<ActResponse>(waiting.act(0, "", 1)).await;

    let swarm = &waiting.episode.swarm_token;
    let seen: SwarmObsResponse = Waiting::read(waiting.get("/swarm/obs", swarm)).await;
    assert_eq!(seen.observations.len(), 3);
    let look = format!("/swarm/obs?wait=60&after={}", seen.cursor);
    let spawn_value =
        |call: RequestBuilder| -> JoinHandle<Value> { tokio::spawn(Waiting::read(call)) };
    let mut looks = Vec::new();
    for seat in 0..4 {
        for _ in 0..10 {
            looks.push(spawn_value(waiting.get("/obs?after=1&wait=60", waiting.token(seat))));
        }
    }
    let looks_of_all: Vec<_> = (0..10).map(|_| spawn_value(waiting.get(&look, swarm))).collect();
    let act = spawn_value(waiting.act(1, "?wait=60", 1));
    let id = &waiting.episode.id;
    let mut events = Vec::new();
    for _ in 0..5 {
        let call = waiting.http.get(format!("{}/api/v1/episodes/{id}/events", waiting.base));
        let mut stream = call.send().await.expect("an answer");
        let first = stream.chunk().await.expect("no break").expect("an event");
        events.push(tokio::spawn(async move {
            let mut text = first.to_vec();
            while let Some(more) = stream.chunk().await.expect("the stream ends in good order") {
                text.extend(more);
            }
            String::from_utf8(text).expect("UTF-8")
        }));
    }
    waiting.all_wait(looks.len() + looks_of_all.len() + 1).await;

    let told = tokio::spawn(async move { server.terminate().await });
    for (place, look) in looks.into_iter().enumerate() {
        let seen: Observation = parse(look.await.expect("an answer"));
        let (seat, acted) = (place / 10, place < 20);
        assert_eq!(seen.sight.agent, format!("Agent_{seat}"));
        assert_eq!((seen.sight.round, seen.moment.acted), (1, acted), "{seen:?}");
    }
    for look in looks_of_all {
        let seen: SwarmObsResponse = parse(look.await.expect("an answer"));
        assert!(seen.observations.is_empty() && !seen.finished, "{seen:?}");
    }
    let receipt: ActResponse = parse(act.await.expect("an answer"));
    assert!(!receipt.receipt.duplicate && receipt.obs.is_none(), "{receipt:?}");
    for stream in events {
        let text = stream.await.expect("a whole stream");
        let data = text.strip_prefix("event: round\nid: 1\ndata: ").expect("one event");
        let event: RoundEvent = serde_json::from_str(data.trim_end()).expect("its data");
        assert_eq!(event.round, 1);
    }
    let (status, taken, log) = told.await.expect("no panic");
    assert_eq!(status.code(), Some(0), "after {taken:?}: {log:#?}");
    assert_eq!(complaints(&log), Vec::<&String>::new());

    // The act that waited is there, and so is the one before it.
    let mut server = site.start();
    server.ready().await;
    let again = Waiting { base: site.door.after(1).await.base, ..waiting };
    let seen: SwarmObsResponse =
        Waiting::read(again.get("/swarm/obs", &again.episode.swarm_token)).await;
    let waits: Vec<_> = seen.observations.iter().map(|seen| seen.sight.agent.as_str()).collect();
    assert_eq!(waits, ["Agent_2", "Agent_3"]);
    let same: ActResponse = Waiting::read(again.act(1, "", 1)).await;
    assert!(same.receipt.duplicate);
    assert_eq!(same.receipt.waiting_for, receipt.receipt.waiting_for);
    stop(&site, server).await;
}

pub(crate) async fn a_client_that_never_ends_its_request_holds_nobody_up() {
    let site = Site::new();
    let mut server = site.start();
    server.ready().await;
    let waiting = Waiting::new(&site, server.run).await;
    let port = waiting.base.trim_start_matches("http://");
    let mut slow = TcpStream::connect(port).expect("it is open");
    let token = waiting.token(0);
    let head = format!(
        "POST /act HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{\"round\":"
    );
    slow.write_all(head.as_bytes()).expect("it is taken");
    // The others come after it, and are answered.
    Waiting::read::<ActResponse>(waiting.act(1, "", 0)).await;
    let (status, taken, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "after {taken:?}: {log:#?}");
    assert!(!site.wal().exists(), "what was written lately is not in the database");
    let mut server = site.start();
    server.ready().await;
    let again = Waiting { base: site.door.after(1).await.base, ..waiting };
    assert!(Waiting::read::<ActResponse>(again.act(1, "", 0)).await.receipt.duplicate);
    stop(&site, server).await;
}

pub(crate) async fn acts_that_came_while_the_process_was_frozen_are_in_time() {
    let site = Site::new();
    let mut server = site.start();
    server.ready().await;
    let request = json!({
        "task": "Synchronization", "num_agents": 4, "seed": 1, "round_deadline_s": 3, "max_round": 200,
    });
    let waiting = Waiting::at(&site, server.run, request).await;
    let seen: Observation = Waiting::read(waiting.get("/obs", waiting.token(0))).await;
    let round = seen.sight.round;
    server.freeze();
    let acts: Vec<_> =
        (0..4).map(|seat| tokio::spawn(waiting.act(seat, "", round).send())).collect();
    // Longer than the clock of the round.
    tokio::time::sleep(Duration::from_secs(6)).await;
    server.thaw();
    for act in acts {
        let answer = act.await.expect("no panic").expect("an answer");
        assert_eq!(answer.status(), 200, "{:?}", answer.text().await);
    }
    stop(&site, server).await;
}

fn parse<T: serde::de::DeserializeOwned>(value: Value) -> T {
    serde_json::from_value(value).expect("of its kind")
}
