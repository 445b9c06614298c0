//! Seats of one episode that belong to several holders.

use std::time::Duration;

use futures::future::join_all;
use serde_json::{Value, json};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{JournalReport, verify};

use crate::app::{Call, TestApp, fields, list};

/// Seats that somebody holds.
#[derive(Clone, Debug)]
struct Held {
    episode: String,
    swarm: String,
    seats: Vec<(String, String)>,
}

impl Held {
    /// Reads the answer to a creation or to a claim.
    fn of(answer: &Value) -> Self {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let episode = if answer["id"].is_string() { &answer["id"] } else { &answer["episode"] };
        Self {
            episode: text(episode),
            swarm: text(&answer["swarm_token"]),
            seats: list(&answer["seats"])
                .iter()
                .map(|seat| (text(&seat["agent"]), text(&seat["token"])))
                .collect(),
        }
    }

    fn path(&self, rest: &str) -> String {
        format!("/api/v1/episodes/{}{rest}", self.episode)
    }

    fn agents(&self) -> Vec<&str> {
        self.seats.iter().map(|(agent, _)| agent.as_str()).collect()
    }

    /// Whose observations wait for an act of this holder.
    async fn waiting(&self, app: &TestApp) -> Vec<String> {
        let seen = app.get("/swarm/obs?limit=1024").token(&self.swarm).ok().await;
        let agent = |seen: &Value| seen["agent"].as_str().expect("a name").to_owned();
        list(&seen["observations"]).iter().map(agent).collect()
    }

    /// All seats of this holder do the same.
    async fn act(&self, app: &TestApp, round: u64, action: &str) {
        let act = |(agent, _): &(String, String)| json!({ "episode": self.episode, "agent": agent, "round": round, "action": action });
        let acts: Vec<Value> = self.seats.iter().map(act).collect();
        let body = json!({ "acts": acts });
        for receipt in
            list(&app.post("/swarm/act").token(&self.swarm).json(&body).ok().await["receipts"])
        {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
    }
}

fn request(open_seats: u64) -> Value {
    json!({ "task": "Synchronization", "num_agents": 4, "max_round": 2, "open_seats": open_seats })
}

/// Asks for seats, with a key where one is named.
fn claim(app: &TestApp, held: &Held, key: &str, body: &Value) -> Call {
    let call = app.post(&held.path("/claims")).json(body);
    if key.is_empty() { call } else { call.token(key) }
}

async fn create(app: &TestApp, key: &str, request: &Value) -> (Value, Held) {
    let call = app.post("/api/v1/episodes").json(request);
    let created = if key.is_empty() { call } else { call.token(key) }.ok().await;
    let held = Held::of(&created);
    (created, held)
}

async fn member(app: &TestApp, name: &str) -> String {
    app.key(json!({ "name": name })).await.0
}

/// The journal of an episode that has ended, proven.
async fn proven(app: &TestApp, held: &Held, key: &str) -> (String, JournalReport) {
    let summary = app.get(&held.path("")).token(key).ok().await;
    let head = summary["result"]["journal_head"].as_str().and_then(Head::parse).expect("a head");
    let journal = app.get(&held.path("/journal")).token(key).send().await;
    assert_eq!(journal.status, 200, "{}", journal.text());
    let report = verify(&*journal.body, Some(head), Solver::Flow, |_, _| ()).expect("a proof");
    (journal.text(), report)
}

#[tokio::test]
async fn seats_are_claimed_and_the_last_one_starts_the_episode() {
    let app = TestApp::builder().keys().start().await;
    let owner = member(&app, "owner").await;
    let (blue, green) = (member(&app, "blue").await, member(&app, "green").await);
    let (created, creator) = create(&app, &owner, &request(3)).await;
    assert_eq!(created["status"], "waiting");
    assert_eq!(created["config"]["open_seats"], 3);
    assert_eq!(created["config"]["seed"], Value::Null, "the creator plays, too");
    assert_eq!(creator.agents(), ["Agent_0"]);

    let by_name = json!({ "agent": "Agent_2", "model": "m2", "agent_meta": { "top_p": 0.5, "x": nested(63) } });
    let first = claim(&app, &creator, &blue, &by_name).ok().await;
    assert_eq!((&first["claim"], &first["status"]), (&json!(1), &json!("waiting")));
    let first = Held::of(&first);
    assert_eq!(first.agents(), ["Agent_2"]);

    // Every holder of a key finds it while it waits.
    let is_listed = async || {
        let items = app.get("/api/v1/episodes").token(&green).ok().await["items"].clone();
        list(&items).iter().any(|item| item["id"] == creator.episode.as_str())
    };
    assert!(is_listed().await);
    // What nobody acts in yet shows nothing to act on.
    assert!(creator.waiting(&app).await.is_empty());
    let shown = app.get(&creator.path("/claims")).token(&green).ok().await;
    assert_eq!(shown["open"], 2);
    let seats = list(&shown["seats"]);
    assert_eq!((&seats[0]["claim"], &seats[0]["holder"]), (&json!(0), &json!("owner")));
    assert_eq!((&seats[2]["claim"], &seats[2]["holder"]), (&json!(1), &json!("blue")));
    assert_eq!((&seats[2]["model"], &seats[1]["model"]), (&json!("m2"), &Value::Null));
    assert!(!shown.to_string().contains("seat_"), "{shown}");

    let second = claim(&app, &creator, &green, &json!({ "seats": 2 })).ok().await;
    assert_eq!((&second["claim"], &second["status"]), (&json!(2), &json!("running")));
    let second = Held::of(&second);
    assert_eq!(second.agents(), ["Agent_1", "Agent_3"]);

    assert!(!is_listed().await);
    // Everybody sees and plays what is theirs.
    for round in 0..2 {
        for held in [&creator, &second, &first] {
            assert_eq!(held.waiting(&app).await, held.agents());
            held.act(&app, round, "SWITCH").await;
        }
    }
    let (journal, report) = proven(&app, &creator, &green).await;
    assert_eq!(report.rounds, 2);
    let seats = report.seats.expect("who held which seat");
    let held: Vec<u32> = seats.seats.iter().map(|seat| seat.holder).collect();
    assert_eq!(held, [0, 2, 1, 2]);
    assert_eq!(seats.holders[1].model, "m2");
    assert_eq!(seats.holders[1].agent_meta.get("top_p"), Some("0.5"));
    assert!(seats.holders.iter().all(|holder| holder.player.is_none()));
    let keys = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    let ids: Vec<Value> = list(&keys["items"]).iter().map(|key| key["id"].clone()).collect();
    for (holder, id) in seats.holders.iter().zip(&ids[1..]) {
        assert_eq!(json!(holder.key), *id);
    }

    // Without that record, or with another one, it is no journal.
    let without: Vec<&str> = journal.lines().filter(|line| !line.contains("\"holders\"")).collect();
    assert_eq!(without.len() + 1, journal.lines().count());
    let rewritten = |lines: Vec<String>| {
        let mut head = Head::START;
        let lines = lines.into_iter().map(|record| {
            head = head.link(record.as_bytes());
            format!("{{\"hash\":\"{head}\",\"record\":{record}}}\n")
        });
        lines.collect::<String>()
    };
    let record = |line: &&str| line[84..line.len() - 1].to_owned();
    let fault = |text: String| {
        let report = verify(text.as_bytes(), None, Solver::Flow, |_, _| ());
        report.expect_err("it is not told who played").to_string()
    };
    let forged = rewritten(without.iter().map(record).collect());
    assert!(fault(forged).contains("before the record of seats"));
    let other = |from: &str, to: &str| {
        let lines: Vec<&str> = journal.lines().collect();
        rewritten(lines.iter().map(record).map(|line| line.replace(from, to)).collect())
    };
    verify(other("m2", "m3").as_bytes(), None, Solver::Flow, |_, _| ()).expect("another model");
    let swapped = other(r#"{"agent":"Agent_1","holder":2}"#, r#"{"agent":"Agent_1","holder":0}"#);
    assert!(fault(swapped).contains("cannot be a seat of holder 0"));
    let strange = other(r#"{"holder":2,"#, r#"{"holder":2,"player":"random","#);
    assert!(fault(strange).contains("another player"));
}

#[tokio::test]
async fn a_seat_has_one_holder_however_many_want_it() {
    let app = TestApp::start().await;
    for _ in 0..5 {
        let (_, creator) = create(&app, "", &request(2)).await;
        let body = json!({ "agent": "Agent_3" });
        let all = (0..20).map(|_| claim(&app, &creator, "", &body).send());
        let answers = join_all(all).await;
        let got = answers.iter().filter(|answer| answer.status == 201).count();
        assert_eq!(got, 1);
        for answer in answers.iter().filter(|answer| answer.status != 201) {
            assert_eq!(answer.json()["code"], "seat_taken", "{}", answer.text());
        }
        // The same where any seat will do.
        let all = (0..20).map(|_| claim(&app, &creator, "", &json!({})).send());
        let got = join_all(all).await.iter().filter(|answer| answer.status == 201).count();
        assert_eq!(got, 1);
        claim(&app, &creator, "", &json!({})).problem(409, "seat_taken").await;
        assert_eq!(app.get(&creator.path("")).ok().await["status"], "running");
    }
}

/// An object with so many in it, itself included: each in the one before.
fn nested(deep: usize) -> Value {
    (1..deep).fold(json!({}), |inner, _| json!({ "x": inner }))
}

#[tokio::test]
async fn a_claim_is_all_or_nothing_and_says_what_is_wrong() {
    let app = TestApp::start().await;
    let (_, creator) = create(&app, "", &request(2)).await;
    let ask = |body: Value| claim(&app, &creator, "", &body);
    ask(json!({ "seats": 3 })).problem(409, "seat_taken").await;
    ask(json!({ "agent": "Agent_1" })).problem(409, "seat_taken").await;
    for (body, wrong) in [
        (json!({ "seats": 0 }), "seats"),
        (json!({ "seats": 5 }), "seats"),
        (json!({ "agent": "Agent_4" }), "agent"),
        (json!({ "agent": "Agent_2", "seats": 1 }), "seats"),
        (json!({ "model": "" }), "model"),
        (json!({ "agent_meta": { "x": "y".repeat(20_000) } }), "agent_meta"),
        (json!({ "agent_meta": nested(65) }), "agent_meta"),
        (json!({ "agents": 2 }), "agents"),
    ] {
        assert_eq!(fields(&ask(body).problem(422, "invalid").await), [wrong]);
    }
    let shown = app.get(&creator.path("/claims")).ok().await;
    assert_eq!(shown["open"], 2, "nothing was given");
    ask(json!({ "seats": 2 })).ok().await;

    // Where the creator has all seats there is nothing to claim.
    let (_, alone) = create(&app, "", &request(0)).await;
    claim(&app, &alone, "", &json!({})).problem(409, "seat_taken").await;
    let shown = app.get(&alone.path("/claims")).ok().await;
    assert_eq!((&shown["open"], &shown["seats"][3]["claim"]), (&json!(0), &json!(0)));
    // Nor where all is over.
    let (_, over) = create(&app, "", &request(2)).await;
    app.delete(&over.path("")).token(&over.swarm).ok().await;
    claim(&app, &over, "", &json!({})).problem(409, "episode_over").await;
    app.get("/api/v1/episodes/ep_unknown/claims").problem(404, "not_found").await;
    let (_, report) = proven(&app, &over, &over.swarm).await;
    assert!(report.seats.is_none(), "it never began");

    for (change, wrong) in [
        (json!({ "open_seats": 5 }), "open_seats"),
        (json!({ "open_seats": -1 }), "open_seats"),
        (json!({ "fill_after_s": 1, "open_seats": 0 }), "fill_after_s"),
        (json!({ "fill_after_s": 100, "idle_timeout_s": 100 }), "fill_after_s"),
        (json!({ "fill_after_s": -1 }), "fill_after_s"),
        (json!({ "fill_with": "random" }), "fill_with"),
        (json!({ "fill_after_s": 1, "fill_with": "close-in" }), "fill_with"),
        (json!({ "player": "nobody" }), "player"),
        (json!({ "player": "random", "open_seats": 4 }), "player"),
    ] {
        let mut request = request(2);
        request
            .as_object_mut()
            .expect("an object")
            .extend(change.as_object().expect("one").clone());
        let problem = app.post("/api/v1/episodes").json(&request).problem(422, "invalid").await;
        assert_eq!(fields(&problem), [wrong], "{problem}");
    }
}

#[tokio::test]
async fn a_token_of_a_claim_opens_its_own_seats_alone() {
    let app = TestApp::builder().keys().start().await;
    let owner = member(&app, "owner").await;
    let blue = member(&app, "blue").await;
    let (_, creator) = create(&app, &owner, &request(2)).await;
    let claimed = Held::of(&claim(&app, &creator, &blue, &json!({ "seats": 2 })).ok().await);
    let act = |agent: &str| json!({ "acts": [{ "episode": creator.episode, "agent": agent, "round": 0, "action": "STAY" }] });
    for (held, other) in [(&creator, "Agent_2"), (&claimed, "Agent_1")] {
        let sent = app.post("/swarm/act").token(&held.swarm).json(&act(other)).ok().await;
        assert_eq!(sent["receipts"][0]["code"], "forbidden", "{sent}");
        assert_eq!(sent["receipts"][0]["status"], 403);
    }
    // Nobody but an organizer sees the whole before the end: not even the creator, who plays, too.
    for token in [&owner, &creator.swarm, &blue, &claimed.swarm, &claimed.seats[0].1] {
        for what in ["/state", "/events", "/journal"] {
            app.get(&creator.path(what)).token(token).problem(403, "forbidden").await;
        }
        let shown = app.get(&creator.path("")).token(token).ok().await;
        assert_eq!((&shown["config"]["seed"], &shown["result"]), (&Value::Null, &Value::Null));
    }
    app.get(&creator.path("")).problem(404, "not_found").await;
    for what in ["/state", "/journal"] {
        let read = app.get(&creator.path(what)).token(&app.organizer).send().await;
        assert_eq!(read.status, 200);
    }
    // A holder may not start or end what is another's, and the creator may.
    app.delete(&creator.path("")).token(&claimed.swarm).problem(403, "forbidden").await;
    app.delete(&creator.path("")).token(&blue).problem(403, "forbidden").await;
    app.delete(&creator.path("")).token(&creator.swarm).ok().await;
    for token in [&owner, &blue, &claimed.swarm] {
        assert_eq!(app.get(&creator.path("/state")).token(token).send().await.status, 200);
    }
}

#[tokio::test]
async fn a_public_episode_hides_only_the_answers_of_its_holders() {
    let app = TestApp::start().await;
    let (created, creator) = create(&app, "", &request(2)).await;
    assert_eq!(created["config"]["seed"], Value::Null);
    claim(&app, &creator, "", &json!({ "seats": 2 })).ok().await;
    for token in ["", &creator.swarm] {
        let get = |path: &str| {
            let call = app.get(&creator.path(path));
            if token.is_empty() { call } else { call.token(token) }
        };
        assert_eq!(get("/state").ok().await["round"], 0);
        assert_eq!(get("").ok().await["config"]["seed"], Value::Null);
        get("/journal").problem(403, "forbidden").await;
    }
}

#[tokio::test]
async fn a_creator_without_seats_stands_for_itself() {
    let app = TestApp::start().await;
    let (created, creator) = create(&app, "", &request(4)).await;
    assert!(creator.seats.is_empty(), "{created}");
    let claimed = Held::of(&claim(&app, &creator, "", &json!({ "seats": 4 })).ok().await);
    assert!(creator.waiting(&app).await.is_empty());
    claimed.act(&app, 0, "SWITCH").await;
    app.delete(&creator.path("")).token(&creator.swarm).ok().await;
    let (_, report) = proven(&app, &creator, &creator.swarm).await;
    let seats = report.seats.expect("who held which seat");
    assert_eq!(seats.holders.iter().map(|holder| holder.holder).collect::<Vec<_>>(), [1]);
}

#[tokio::test]
async fn a_claim_that_is_repeated_gets_the_same_seats_with_new_tokens() {
    let app = TestApp::builder().keys().start().await;
    let (owner, blue) = (member(&app, "owner").await, member(&app, "blue").await);
    let call = || {
        let call = app.post("/api/v1/episodes").token(&owner).json(&request(3));
        call.header("Idempotency-Key", "game")
    };
    let creator = Held::of(&call().ok().await);
    let body = json!({ "seats": 2 });
    let ask = |key: &str, body: &Value| {
        claim(&app, &creator, key, body).header("Idempotency-Key", "mine")
    };
    let first = Held::of(&ask(&blue, &body).ok().await);
    app.obs(&first.seats[0].1).await;
    let again = Held::of(&ask(&blue, &body).ok().await);
    assert_eq!(again.agents(), first.agents());
    assert_ne!(again.swarm, first.swarm);
    for token in [&first.seats[0].1, &first.seats[1].1] {
        app.get("/obs").token(token).problem(401, "unauthorized").await;
    }
    app.get("/swarm/obs").token(&first.swarm).problem(401, "unauthorized").await;
    ask(&blue, &json!({ "seats": 1 })).problem(422, "invalid").await;
    // Somebody else has names of their own, and so has every episode.
    let other = Held::of(&ask(&owner, &json!({})).ok().await);
    assert_eq!(other.agents(), ["Agent_3"]);
    let (_, second) = create(&app, &owner, &request(2)).await;
    let elsewhere = claim(&app, &second, &blue, &body).header("Idempotency-Key", "mine").ok().await;
    assert_eq!(elsewhere["episode"], second.episode);

    // A repeated creation gives the creator new tokens, and nobody else.
    let repeated = Held::of(&call().ok().await);
    assert_eq!(repeated.episode, creator.episode);
    app.get("/obs").token(&creator.seats[0].1).problem(401, "unauthorized").await;
    for held in [&again, &other, &repeated] {
        assert_eq!(held.waiting(&app).await, held.agents());
        app.obs(&held.seats[0].1).await;
    }
}

#[tokio::test]
async fn claims_take_a_key_where_there_are_keys() {
    let app = TestApp::builder().keys().start().await;
    let owner = member(&app, "owner").await;
    let (_, creator) = create(&app, &owner, &request(4)).await;
    claim(&app, &creator, "", &json!({})).problem(401, "unauthorized").await;
    claim(&app, &creator, &creator.swarm, &json!({})).problem(403, "forbidden").await;
    // Any key will do, the creator's own and an organizer's, too, and a holder may claim more.
    for key in [&owner, &app.organizer, &owner] {
        claim(&app, &creator, key, &json!({})).ok().await;
    }
    let shown = app.get(&creator.path("/claims")).token(&owner).ok().await;
    let numbers: Vec<_> = list(&shown["seats"]).iter().map(|seat| seat["claim"].clone()).collect();
    assert_eq!(json!(numbers), json!([1, 2, 3, null]));
}

#[tokio::test]
async fn claims_and_their_tokens_survive_a_restart_and_a_crash() {
    let mut app = TestApp::start().await;
    let (_, creator) = create(&app, "", &request(3)).await;
    let first = Held::of(&claim(&app, &creator, "", &json!({ "agent": "Agent_2" })).ok().await);
    app.restart().await;
    claim(&app, &creator, "", &json!({ "agent": "Agent_2" })).problem(409, "seat_taken").await;
    let mut app = app.after_a_crash().await;
    let second = Held::of(&claim(&app, &creator, "", &json!({ "seats": 2 })).ok().await);
    assert_eq!(second.agents(), ["Agent_1", "Agent_3"]);
    app.restart().await;
    for held in [&creator, &first, &second] {
        held.act(&app, 0, "SWITCH").await;
    }
    let mut app = app.after_a_crash().await;
    for held in [&first, &creator, &second] {
        held.act(&app, 1, "STAY").await;
    }
    app.restart().await;
    let (_, report) = proven(&app, &creator, &creator.swarm).await;
    let held: Vec<u32> = report.seats.expect("it is told").seats.iter().map(|s| s.holder).collect();
    assert_eq!(held, [0, 2, 1, 2]);
}

#[tokio::test]
async fn a_manual_start_waits_for_all_seats_and_for_the_creator() {
    let app = TestApp::start().await;
    let mut request = request(2);
    request["start"] = json!("manual");
    let (_, creator) = create(&app, "", &request).await;
    let start = || app.post(&creator.path("/start")).token(&creator.swarm);
    start().problem(409, "seats_open").await;
    claim(&app, &creator, "", &json!({})).ok().await;
    start().problem(409, "seats_open").await;
    let last = claim(&app, &creator, "", &json!({})).ok().await;
    assert_eq!(last["status"], "waiting", "the creator has not started it");
    app.post(&creator.path("/start"))
        .token(Held::of(&last).swarm.as_str())
        .problem(403, "forbidden")
        .await;
    assert_eq!(start().ok().await["status"], "running");
    assert_eq!(start().ok().await["status"], "running");
    // Without a manual start there is nothing to start by hand either.
    let (_, other) = create(&app, "", &self::request(1)).await;
    let start = app.post(&other.path("/start")).token(&other.swarm);
    start.problem(409, "seats_open").await;
}

#[tokio::test]
async fn seats_that_nobody_wants_are_filled_in_time_also_after_a_restart() {
    for crash in [false, true] {
        let mut app = TestApp::with_manual_clock().await;
        let mut request = request(3);
        request["fill_after_s"] = json!(30);
        let (_, creator) = create(&app, "", &request).await;
        let claimed = Held::of(&claim(&app, &creator, "", &json!({})).ok().await);
        app.pass(Duration::from_secs(29));
        assert_eq!(app.get(&creator.path("")).ok().await["status"], "waiting");
        if crash {
            app = app.after_a_crash().await;
        } else {
            app.restart().await;
        }
        app.pass(Duration::from_secs(1));
        for round in 0..2 {
            // The server plays its own, so the round waits for these two alone.
            for held in [&claimed, &creator] {
                let wait = app.get("/swarm/obs?wait=60").token(&held.swarm).ok().await;
                assert_eq!(wait["observations"][0]["round"], round, "{wait}");
                held.act(&app, round, "SWITCH").await;
            }
            app.obs_after(&creator.seats[0].1, round).await;
        }
        let shown = app.get(&creator.path("/claims")).ok().await;
        let seats = list(&shown["seats"]);
        for seat in &seats[2..] {
            assert_eq!(
                (&seat["holder"], &seat["player"]),
                (&json!("server"), &json!("round-clock"))
            );
        }
        claim(&app, &creator, "", &json!({})).problem(409, "episode_over").await;
        let (_, report) = proven(&app, &creator, &creator.swarm).await;
        let seats = report.seats.expect("who held which seat");
        assert_eq!(seats.holders[2].player.as_deref(), Some("round-clock"));
        assert_eq!(seats.seats.iter().map(|seat| seat.holder).collect::<Vec<_>>(), [0, 1, 2, 2]);
    }
}

#[tokio::test]
async fn an_episode_that_nobody_fills_is_abandoned() {
    let mut app = TestApp::with_manual_clock().await;
    let mut request = request(3);
    request["idle_timeout_s"] = json!(60);
    let (_, creator) = create(&app, "", &request).await;
    claim(&app, &creator, "", &json!({})).ok().await;
    app.pass(Duration::from_secs(59));
    app.restart().await;
    assert_eq!(app.get(&creator.path("")).ok().await["status"], "waiting");
    app.pass(Duration::from_secs(1));
    claim(&app, &creator, "", &json!({})).problem(409, "episode_over").await;
    let shown = app.get(&creator.path("")).ok().await;
    assert_eq!(shown["result"]["reason"], "idle");
    let (_, report) = proven(&app, &creator, &creator.swarm).await;
    assert_eq!((report.rounds, report.seats), (0, None));
}
