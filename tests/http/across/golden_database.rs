//! Golden databases: what an earlier version kept, every later version opens, shows and plays on.
//!
//! `tests/golden/database/MIGRATION/` holds a database whose newest migration has that number, and `facts.json`: what
//! its server answered and the tokens with which games of it are played on. Both are compressed with gzip.
//! One is recorded by the program of that time:
//!
//! ```sh
//! cargo test --test http -- --ignored golden_database_is_recorded
//! ```
//!
//! Existing files are never written again: see CONTRIBUTING.md.

use std::fs::{self, File};
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use swarmbench_testkit::needs;

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use reqwest::Method;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swarmbench_boards::competition::verify::{Expected, verify as verify_competition};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::verify;

use super::golden::games;
use crate::agent::readers::rehashed;
use crate::app::program::{printed, swarmbench};
use crate::app::{Call, Episode, TestApp, list, until};
use crate::cup::{Attempt, Cup, Entrant};

mod attacks;
mod old_settings;

/// All that has to be so when the database is opened again.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Facts {
    /// The time at which it was closed.
    now: String,
    /// The key of an organizer.
    organizer: String,
    /// A key that may be used, and those that may not.
    member: String,
    refused_keys: Vec<String>,
    /// Recorded answers. Later versions may answer with more fields, never with other values.
    answers: Vec<RecordedAnswer>,
    /// Journals: the path, head, score and number of rounds of each.
    journals: Vec<Journal>,
    /// Running episodes, as they were created; all that had begun, and one that waits for its start.
    running: Vec<Value>,
    waiting: Value,
    /// An episode with open seats.
    lobby: Value,
    /// Running runs, as they were created.
    runs: Vec<Value>,
    /// Creations that are repeated find what they created.
    repeated: Vec<Repeated>,
    cups: Cups,
}

/// Competitions, by what they are in the middle of.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Cups {
    /// A competition that opens later, with the largest settings of its version.
    announced: String,
    opens_in_minutes: u64,
    open: String,
    closes_in_minutes: u64,
    /// An attempt that runs, and the key of an entrant that has one left.
    attempt: String,
    entrant: String,
    used_code: String,
    unused_code: String,
    closed: String,
    commitment: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct RecordedAnswer {
    path: String,
    /// The token with which it was asked; empty for none.
    token: String,
    status: u16,
    answer: Value,
}

#[derive(Debug, Serialize, Deserialize)]
struct Journal {
    path: String,
    head: String,
    score: String,
    rounds: u32,
}

#[derive(Debug, Serialize, Deserialize)]
struct Repeated {
    path: String,
    token: String,
    name: String,
    body: Value,
    /// The part of the answer that must be the same again.
    same: Value,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/database")
}

/// The number of the newest migration, as its file has it.
fn newest_migration() -> String {
    let files = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("migrations/sqlite"));
    let names = files.expect("migrations").map(|file| file.expect("a file").file_name());
    let newest = names.map(|name| name.into_string().expect("UTF-8")).max();
    newest.expect("one").split('_').next().expect("a number").to_owned()
}

fn pack(path: &Path, bytes: &[u8]) {
    let file = File::create_new(path).expect("it is not there yet");
    let mut file = GzEncoder::new(file, Compression::best());
    file.write_all(bytes).and_then(|()| file.finish()).expect("written");
}

fn unpack(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    GzDecoder::new(File::open(path).expect("a file")).read_to_end(&mut bytes).expect("gzip");
    bytes
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("not a text: {value}")).to_owned()
}

/// The time `minutes` from now.
fn at(app: &TestApp, minutes: i64) -> String {
    (app.now() + jiff::SignedDuration::from_mins(minutes)).to_string()
}

fn get(app: &TestApp, path: &str, token: &str) -> Call {
    let call = app.get(path);
    if token.is_empty() { call } else { call.token(token) }
}

fn post(app: &TestApp, path: &str, token: &str, body: &Value) -> Call {
    let call = app.post(path).json(body);
    if token.is_empty() { call } else { call.token(token) }
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "writes files; only a new migration has something to record"]
async fn golden_database_is_recorded() {
    let folder = folder().join(newest_migration());
    if folder.exists() {
        return;
    }
    let mut app = TestApp::with_manual_clock().await;
    let mut facts = Facts::default();
    without_keys(&app, &mut facts).await;
    app.stop().await;
    app.organizer = app.first_key().await;
    app.start_again().await;
    facts.organizer.clone_from(&app.organizer);
    with_keys(&app, &mut facts).await;
    competitions(&app, &mut facts).await;
    import(&mut app).await;
    facts.now = app.now().to_string();
    app.stop().await;
    let database = fs::read(app.database()).expect("a database");
    // What an organizer reads of sealed games is noted in the audit log, after what is recorded.
    app.start_again().await;
    listen(&app, &mut facts).await;
    fs::create_dir_all(&folder).expect("a folder");
    pack(&folder.join("swarmbench.db.gz"), &database);
    let facts = serde_json::to_vec_pretty(&facts).expect("string keys");
    pack(&folder.join("facts.json.gz"), &facts);
}

/// Settings that later versions may find too large for new games.
fn large() -> Value {
    json!({
        "task": "Synchronization", "seed": 29, "num_agents": 280, "width": 64, "height": 64, "view_size": 61,
        "memory": 0, "max_round": 2, "model": "large",
    })
}

/// Creates something under a name, and notes that it is found again by it.
async fn create_named(
    app: &TestApp,
    facts: &mut Facts,
    path: &str,
    token: &str,
    body: Value,
    same: &[&str],
) -> Value {
    let name = format!("name {:x}", crc32fast::hash(body.to_string().as_bytes()));
    let call = post(app, path, token, &body).header("Idempotency-Key", &name);
    let created = call.ok().await;
    let same = same.iter().map(|field| ((*field).to_owned(), created[field].clone())).collect();
    facts.repeated.push(Repeated {
        path: path.to_owned(),
        token: token.to_owned(),
        name,
        body,
        same,
    });
    created
}

/// Rows of people without keys on a server of their own: all games of the golden journals, and runs.
async fn without_keys(app: &TestApp, facts: &mut Facts) {
    for game in games() {
        game.record(app).await;
    }
    let episodes = "/api/v1/episodes";
    for request in [
        large(),
        json!({ "task": "Pursuit", "seed": 30, "num_agents": 4, "max_round": 6, "noise": 0.3 }),
        json!({
            "task": "Foraging", "seed": 31, "num_agents": 4, "max_round": 5, "control": "centralized", "max_delay": 2,
        }),
        json!({
            "task": "Flocking", "seed": 32, "num_agents": 4, "max_round": 5, "round_deadline_s": 86_000, "bank_s": 60,
            "prompt_template": "{{ round }} {{ score }}",
        }),
    ] {
        let created = app.post(episodes).json(&request).ok().await;
        let episode = Episode::of(&created);
        app.all_act(&episode, "STAY").await;
        // A part of the seats has acted in the open round.
        let act = json!({ "round": 1, "action": "STAY", "message": "ünïcode 🐜" });
        app.act(episode.seat(1), &act).await;
        let refused = json!({ "round": 1, "response": "I will not play.", "failure": "refusal" });
        app.act(episode.seat(2), &refused).await;
        facts.running.push(created);
    }
    let parent = Episode::of(&facts.running[1]);
    let forks = json!({ "round": 1, "count": 2, "model": "forked" });
    let forks = app.post(&parent.path("/fork")).json(&forks).ok().await;
    for created in list(&forks["episodes"]) {
        app.all_act(&Episode::of(&created), "STAY").await;
        facts.running.push(created);
    }
    let waiting = json!({
        "task": "Transport", "seed": 33, "num_agents": 3, "max_round": 2, "start": "manual",
        "agent_meta": { "temperature": 0.7, "note": "ünïcode 🐜" },
    });
    let waiting = create_named(app, facts, episodes, "", waiting, &["id", "config"]).await;
    // A repetition takes new tokens; they are those that count.
    facts.repeated.pop();
    facts.waiting = waiting;
    let named = json!({ "task": "Pursuit", "seed": 34, "num_agents": 2, "max_round": 1 });
    let named = create_named(app, facts, episodes, "", named, &["id", "config"]).await;
    app.all_act(&Episode::of(&named), "STAY").await;

    let run = |model: &str, player: Value| {
        json!({
            "suite": {
                "name": "small", "tasks": ["Synchronization", "Foraging"], "seeds": [4, 9],
                "settings": { "num_agents": 2, "max_round": 2 },
            },
            "model": model, "parallel": 2, "player": player, "temperature": 0.5, "agent_meta": { "n": 1 },
        })
    };
    let runs = "/api/v1/runs";
    for model in ["finished", "another"] {
        let created =
            create_named(app, facts, runs, "", run(model, Value::Null), &["id", "suite"]).await;
        Attempt { run: text(&created["id"]), swarm: text(&created["swarm_token"]), number: 0 }
            .play(app, 2)
            .await;
    }
    let hosted = app.post(runs).json(&run("hosted", json!("default"))).ok().await;
    let path = format!("{runs}/{}", text(&hosted["id"]));
    until("the run ends", async || app.get(&path).ok().await["status"] == "finished").await;
    let aborted = app.post(runs).json(&run("aborted", Value::Null)).ok().await;
    let (id, token) = (text(&aborted["id"]), text(&aborted["swarm_token"]));
    app.delete(&format!("{runs}/{id}")).token(&token).ok().await;
    let running = app.post(runs).json(&run("running", Value::Null)).ok().await;
    let played =
        Attempt { run: text(&running["id"]), swarm: text(&running["swarm_token"]), number: 0 };
    for _ in 0..3 {
        played.act(app, 1).await;
    }
    facts.runs.push(running);
}

/// Rows of people with keys of every kind.
async fn with_keys(app: &TestApp, facts: &mut Facts) {
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    let (second, _) = app.key(json!({ "name": "second", "role": "organizer" })).await;
    let (revoked, id) = app.key(json!({ "name": "revoked" })).await;
    app.delete(&format!("/api/v1/keys/{id}")).token(&second).ok().await;
    let expiring = json!({ "name": "expired", "expires_at": at(app, 60) });
    let (expired, _) = app.key(expiring).await;
    app.create_with(&expired, json!({ "task": "Pursuit", "num_agents": 2, "idle_timeout_s": 60 }))
        .await;
    facts.refused_keys = vec![revoked, expired];
    let episodes = "/api/v1/episodes";
    let private = json!({
        "task": "Foraging", "seed": 35, "num_agents": 2, "max_round": 2, "visibility": "owner",
        "model": "private",
    });
    let created = create_named(app, facts, episodes, &member, private, &["id", "config"]).await;
    app.all_act(&Episode::of(&created), "STAY").await;
    let path = Episode::of(&created).path("/fork");
    create_named(app, facts, &path, &member, json!({ "round": 1 }), &["fork"]).await;
    let voided = app
        .create_with(
            &member,
            json!({ "task": "Pursuit", "seed": 36, "num_agents": 2, "max_round": 1 }),
        )
        .await;
    app.all_act(&voided, "STAY").await;
    let void = json!({ "reason": "a power cut" });
    app.post(&voided.path("/void")).token(&app.organizer).json(&void).ok().await;
    // A game of several holders that is over, and one that still has open seats.
    let seats = json!({
        "task": "Synchronization", "seed": 37, "num_agents": 4, "max_round": 2, "open_seats": 3,
        "model": "creator",
    });
    for is_full in [true, false] {
        let created = post(app, episodes, &member, &seats).ok().await;
        let path = format!("{episodes}/{}/claims", text(&created["id"]));
        let claim = json!({ "seats": 1, "model": "claimed", "agent_meta": { "top_p": 0.9 } });
        let claimed = create_named(app, facts, &path, &second, claim, &["claim", "episode"]).await;
        if !is_full {
            facts.lobby = created;
            break;
        }
        facts.repeated.pop();
        let rest = json!({ "seats": 2, "model": "the rest" });
        let rest = post(app, &path, &member, &rest).ok().await;
        let swarms = [&created, &claimed, &rest].map(|held| Attempt {
            run: String::new(),
            swarm: text(&held["swarm_token"]),
            number: 0,
        });
        for _ in 0..2 {
            for swarm in &swarms {
                swarm.act(app, 1).await;
            }
        }
    }
    facts.member = member;
}

/// Competitions of every phase, with all that entrants may come to.
async fn competitions(app: &TestApp, facts: &mut Facts) {
    let small = json!({
        "tasks": ["Synchronization", "Pursuit"], "seeds": 1,
        "settings": { "num_agents": 2, "max_round": 3 },
    });
    let closed = json!({
        "suite": small, "entries_per_key": 3, "opens_at": at(app, 10), "closes_at": at(app, 60),
    });
    let closed = Cup::with(app, closed).await;
    let announced = json!({
        "name": "announced", "opens_at": at(app, 240), "closes_at": at(app, 360),
        "suite": {
            "tasks": ["Synchronization"], "seeds": 2,
            "settings": {
                "num_agents": 280, "width": 64, "height": 64, "view_size": 61, "memory": 0, "max_round": 1,
            },
        },
        "board": "frozen", "board_freezes_at": at(app, 300), "attempts": [
            { "opens_at": at(app, 240), "closes_at": at(app, 330) },
            { "opens_at": at(app, 330), "closes_at": at(app, 360) },
        ],
    });
    let announced = Cup::with(app, announced).await;
    announced.enter(app, "early").await;
    crate::cup::pass_minutes(app, 10).await;
    let names = ["blue", "red", "withdrawn", "disqualified", "late"];
    let mut entrants = Vec::new();
    for name in names {
        entrants.push(closed.enter(app, name).await);
    }
    let [blue, red, withdrawn, disqualified, late] = &entrants[..] else { unreachable!() };
    for (entrant, skill) in [(blue, 3), (red, 1), (withdrawn, 2), (disqualified, 2), (blue, 1)] {
        closed.start(app, entrant).await.play(app, skill).await;
    }
    let voided = closed.start(app, red).await;
    voided.play(app, 3).await;
    closed.void(app, &voided, "a power cut").await;
    for (entrant, status) in [(withdrawn, "withdrawn"), (disqualified, "disqualified")] {
        closed.change(app, entrant, json!({ "status": status, "reason": "for a test" })).await;
    }
    closed.change(app, blue, json!({ "vouched": true })).await;
    // Its last games end when the competition closes.
    closed.start(app, late).await.act(app, 1).await;

    let open = json!({
        "name": "open", "opens_at": at(app, 10), "closes_at": at(app, 170),
        "suite": small, "entry": "codes", "board": "hidden", "clocks": { "round_deadline_s": 7200 },
    });
    let open = Cup::with(app, open).await;
    let codes = json!({ "labels": ["used", "unused", "never"] });
    let codes =
        app.post(&open.path("/codes")).token(&app.organizer).json(&codes).ok().await["items"]
            .clone();
    let (used, unused) = (text(&codes[0]["code"]), text(&codes[1]["code"]));
    let entry = json!({
        "name": "an invited one", "model": "invited", "code": used, "temperature": 0.3, "top_p": 0.9,
        "agent_meta": { "family": "x" }, "prompt_template": "{{ round }}",
    });
    let made = app.post(&open.path("/entrants")).json(&entry).ok().await;
    let entrant = Entrant { id: text(&made["id"]), key: text(&made["key"]) };
    let renamed = app.call(Method::PATCH, &open.path(&format!("/entrants/{}", entrant.id)));
    renamed.token(&entrant.key).json(&json!({ "name": "an old one" })).ok().await;
    crate::cup::pass_minutes(app, 60).await;
    closed.closed(app).await;
    crate::cup::pass_minutes(app, 60).await;
    let attempt = open.start(app, &entrant).await;
    attempt.act(app, 1).await;
    facts.cups = Cups {
        announced: announced.id,
        opens_in_minutes: 110,
        open: open.id,
        closes_in_minutes: 50,
        attempt: attempt.swarm,
        entrant: entrant.key,
        used_code: used,
        unused_code: unused,
        commitment: text(&closed.created["commitment"]),
        closed: closed.id,
    };
}

/// Reads the games of a run in from the public data format, while the server is stopped.
async fn import(app: &mut TestApp) {
    let place = tempfile::tempdir().expect("a folder");
    let archive = place.path().join("games.zip");
    let path = "/api/v1/exports/dataset.zip?model=another";
    let answer = app.get(path).token(&app.organizer).send().await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    fs::write(&archive, answer.body).expect("written");
    app.stop().await;
    let (archive, db) = (archive.display().to_string(), app.database().display().to_string());
    let output = swarmbench(&["import", &archive, "--db", &db]).await;
    assert!(output.status.success(), "{}", printed(&output));
    app.start_again().await;
}

/// The ids in a list.
async fn ids(app: &TestApp, path: &str, token: &str) -> Vec<String> {
    let listed = get(app, path, token).ok().await;
    assert_eq!(listed["next_cursor"], Value::Null, "{path} has one page");
    list(&listed["items"]).iter().map(|item| text(&item["id"])).collect()
}

/// Notes what the server answers.
async fn listen(app: &TestApp, facts: &mut Facts) {
    let organizer = facts.organizer.clone();
    // Before anything is added to the audit log.
    let mut paths = vec!["/api/v1/audit".to_owned()];
    ask(app, facts, &paths).await;
    paths.clear();
    for id in ids(app, "/api/v1/episodes?limit=1000", &organizer).await {
        let path = format!("/api/v1/episodes/{id}");
        let journal = app.get(&format!("{path}/journal")).token(&organizer).send().await;
        let report = verify(&*journal.body, None, Solver::Flow, |_, _| ()).expect("a proof");
        facts.journals.push(Journal {
            path: format!("{path}/journal"),
            head: report.head.to_string(),
            score: report.score.to_string(),
            rounds: report.rounds,
        });
        // States of large maps would take most of the file.
        if report.opening.config.num_agents < 100 {
            paths.push(format!("{path}/state"));
        }
        paths.extend([path.clone(), format!("{path}/claims")]);
    }
    for id in ids(app, "/api/v1/runs?limit=1000", &organizer).await {
        paths.push(format!("/api/v1/runs/{id}"));
    }
    for id in ids(app, "/api/v1/competitions?limit=100", &organizer).await {
        let path = format!("/api/v1/competitions/{id}");
        paths.extend(["", "/entrants", "/attempts", "/board"].map(|rest| format!("{path}{rest}")));
    }
    for id in ids(app, "/api/v1/imports?limit=100", &organizer).await {
        paths.push(format!("/api/v1/imports/{id}"));
        paths.push(format!("/api/v1/imports/{id}/state?round=1"));
    }
    for list in ["keys", "leaderboard?suite=small", "cross-play"] {
        paths.push(format!("/api/v1/{list}"));
    }
    ask(app, facts, &paths).await;
}

/// Asks for all of these, as strangers and as those who may see more.
async fn ask(app: &TestApp, facts: &mut Facts, paths: &[String]) {
    let (organizer, member) = (facts.organizer.clone(), facts.member.clone());
    let entrant = facts.cups.entrant.clone();
    for path in paths {
        for token in ["", &*organizer, &*member, &*entrant] {
            // Others are asked for what is theirs; strangers and organizers for everything.
            let is_theirs = path.contains("/attempts") || path.ends_with("/board");
            if token.is_empty() || token == organizer || is_theirs {
                let answer = get(app, path, token).send().await;
                let status = answer.status;
                let answer = if status == 200 { answer.json() } else { Value::Null };
                let (path, token) = (path.clone(), token.to_owned());
                facts.answers.push(RecordedAnswer { path, token, status, answer });
            }
        }
    }
}

/// Fails where a field of `before` is gone or has another value.
fn check_same(place: &str, before: &Value, now: &Value) {
    match (before, now) {
        (Value::Object(before), Value::Object(now)) => {
            // Intervals are computed by another method since.
            for (field, before) in before.iter().filter(|(field, _)| *field != "difference") {
                let now = now.get(field).unwrap_or_else(|| panic!("{place} has no {field} now"));
                // Earlier versions named a prompt of players that read none.
                if field == "prompt" && (now == "none" || now.is_null()) {
                    continue;
                }
                check_same(&format!("{place} → {field}"), before, now);
            }
        }
        (Value::Array(before), Value::Array(now)) => {
            assert_eq!(before.len(), now.len(), "{place}: {now:?}");
            for (number, (before, now)) in before.iter().zip(now).enumerate() {
                check_same(&format!("{place}[{number}]"), before, now);
            }
        }
        _ => assert_eq!(normalized(before), normalized(now), "{place}"),
    }
}

/// A value, or a time however many digits its seconds have.
fn normalized(value: &Value) -> Value {
    let time = value.as_str().and_then(|text| text.parse::<jiff::Timestamp>().ok());
    time.map_or_else(|| value.clone(), |time| json!(time))
}

/// Opens a golden database that is as it was.
async fn open(migration: &str) -> (TestApp, Facts) {
    let folder = folder().join(migration);
    let facts: Facts =
        serde_json::from_slice(&unpack(&folder.join("facts.json.gz"))).expect("facts");
    let database = unpack(&folder.join("swarmbench.db.gz"));
    let builder = TestApp::builder().clock_at(&facts.now).key_of(&facts.organizer);
    (builder.database(database).start().await, facts)
}

/// The migrations of which there are golden databases.
fn recorded() -> Vec<String> {
    let folders = fs::read_dir(folder()).expect("golden databases");
    let name = |entry: fs::DirEntry| entry.file_name().into_string().expect("UTF-8");
    let mut names: Vec<_> = folders.map(|entry| name(entry.expect("an entry"))).collect();
    names.sort_unstable();
    names
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_golden_database_says_what_it_said() {
    assert!(!recorded().is_empty());
    for migration in recorded() {
        let (mut app, facts) = open(&migration).await;
        assert!(facts.answers.len() > 150 && facts.journals.len() > 50, "{migration}");
        for told in &facts.answers {
            let answer = get(&app, &told.path, &told.token).send().await;
            assert_eq!(answer.status, told.status, "{migration} {}", told.path);
            if told.status == 200 {
                check_same(&told.path, &told.answer, &answer.json());
            }
        }
        for journal in &facts.journals {
            check_journal(&app, &facts, journal).await;
        }
        let path = format!("/api/v1/exports/competitions/{}", facts.cups.closed);
        let export = app.get(&path).send().await;
        let commitment = Head::parse(&facts.cups.commitment).expect("a hash").0;
        let expected = Expected { commitment: Some(commitment), head: None };
        verify_competition(&*export.body, expected, Solver::Flow, |_| ()).expect("a proof");
        if recorded().last() == Some(&migration) {
            // Beside the server, too.
            sound(&app.database().display().to_string()).await;
        }
        commands_work(&mut app).await;
    }
}

/// The journal is the recorded one, byte by byte. `verify --db` plays all of them again, and compares their scores.
async fn check_journal(app: &TestApp, facts: &Facts, journal: &Journal) {
    let Journal { path, head, .. } = journal;
    let answer = app.get(path).token(&facts.organizer).send().await.text();
    assert_eq!(rehashed(&answer), answer, "{path}");
    let last = answer.lines().last().unwrap_or_else(|| panic!("{path} is empty"));
    assert!(last.starts_with(&format!("{{\"hash\":\"{head}\"")), "{path}: {last}");
}

/// The commands for databases, of which the first copies it.
async fn commands_work(app: &mut TestApp) {
    let folder = tempfile::tempdir().expect("a folder");
    let (db, copy) = (app.database(), folder.path().join("copy.db"));
    let (db, copy) = (db.display().to_string(), copy.display().to_string());
    let output = swarmbench(&["backup", &copy, "--db", &db]).await;
    assert!(output.status.success(), "{}", printed(&output));
    app.stop().await;
    sound(&copy).await;
    let output = swarmbench(&["board", "rebuild", "--replay", "--db", &copy]).await;
    assert!(output.status.success(), "{}", printed(&output));
    assert!(printed(&output).contains("None has changed."), "{}", printed(&output));
}

async fn sound(db: &str) {
    let output = swarmbench(&["verify", "--db", db]).await;
    let said = printed(&output);
    assert!(output.status.success() && said.contains("no damage was found"), "{said}");
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_golden_database_is_played_on() {
    for migration in recorded() {
        let (mut app, facts) = open(&migration).await;
        // Names that were given without a key are nobody's since there are keys.
        for repeated in facts.repeated.iter().filter(|repeated| !repeated.token.is_empty()) {
            let call = post(&app, &repeated.path, &repeated.token, &repeated.body);
            let again = call.header("Idempotency-Key", &repeated.name).ok().await;
            check_same(&repeated.path, &repeated.same, &again);
        }
        for key in &facts.refused_keys {
            app.get("/api/v1/episodes").token(key).problem(401, "unauthorized").await;
        }
        let small = json!({ "task": "Pursuit", "num_agents": 2, "max_round": 1 });
        app.all_act(&app.create_with(&facts.member, small).await, "STAY").await;

        let waiting = Episode::of(&facts.waiting);
        app.post(&waiting.path("/start")).token(&waiting.swarm).ok().await;
        for created in facts.running.iter().chain([&facts.waiting]) {
            play_on(&app, &Episode::of(created)).await;
        }
        // The last seats of the game that waits for holders.
        let lobby = Episode::of(&facts.lobby);
        let claim = json!({ "seats": 2, "model": "later" });
        let claimed = app.post(&lobby.path("/claims")).token(&facts.member).json(&claim).ok().await;
        assert_eq!(claimed["status"], "running");
        for run in &facts.runs {
            let (id, swarm) = (text(&run["id"]), text(&run["swarm_token"]));
            Attempt { run: id.clone(), swarm, number: 0 }.play(&app, 2).await;
            let shown = app.get(&format!("/api/v1/runs/{id}")).token(&facts.organizer).ok().await;
            assert_eq!(shown["status"], "finished", "{shown}");
            let board = app.get("/api/v1/leaderboard?suite=small").ok().await;
            assert!(board.to_string().contains("\"running\""), "its model has a row: {board}");
        }
        competitions_go_on(&app, &facts.cups).await;
        app.restart().await;
        sound(&app.database().display().to_string()).await;
    }
}

/// Plays a game to its end with the tokens that it had, and proves its journal.
async fn play_on(app: &TestApp, episode: &Episode) {
    let mut round = app.obs(episode.seat(0)).await["round"].as_u64().expect("a round");
    let act = json!({ "round": round, "action": "STAY" });
    app.act(episode.seat(0), &act).await;
    while app.show(episode).await["status"] == "running" {
        assert!(app.all_act(episode, "STAY").await >= round);
        round += 1;
    }
    let shown = app.show(episode).await;
    assert_eq!(shown["status"], "finished", "{shown}");
    let head = shown["result"]["journal_head"].as_str().and_then(Head::parse);
    let journal = app.journal(episode).await;
    verify(journal.as_bytes(), head, Solver::Flow, |_, _| ()).expect("a proof");
}

async fn competitions_go_on(app: &TestApp, cups: &Cups) {
    let open = Cup { id: cups.open.clone(), created: Value::Null };
    let enter = |code: &str| {
        let entry = json!({ "name": "a later one", "model": "later", "code": code });
        app.post(&open.path("/entrants")).json(&entry)
    };
    enter(&cups.used_code).problem(403, "forbidden").await;
    enter(&cups.unused_code).ok().await;
    let first = Attempt { run: String::new(), swarm: cups.attempt.clone(), number: 1 };
    first.play(app, 3).await;
    let entrant = Entrant { id: String::new(), key: cups.entrant.clone() };
    open.start(app, &entrant).await.play(app, 1).await;
    crate::cup::pass_minutes(app, cups.closes_in_minutes).await;
    assert_eq!(open.closed(app).await["phase"], "closed");
    let rows = open.rows(app, None).await;
    assert_eq!(rows[0]["rank"], 1, "{rows:?}");
    // The announced one opens, with what it was announced with.
    let announced = Cup { id: cups.announced.clone(), created: Value::Null };
    crate::cup::pass_minutes(app, cups.opens_in_minutes - cups.closes_in_minutes).await;
    let entrant = announced.enter(app, "late").await;
    announced.start(app, &entrant).await.play(app, 1).await;
    let call = app.call(Method::GET, &announced.path("/board"));
    assert_eq!(list(&call.ok().await["items"]).len(), 2);
}
