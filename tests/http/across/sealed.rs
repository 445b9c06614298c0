//! Until a competition is closed nothing of its sealed games reaches anybody but organizers.
//!
//! The sealed values are taken from the organizer's own answers: seeds, salts, layouts, states, scores, digests. Then
//! every route is asked with every other kind of token, and all answers and all lines of the log are searched.

use std::collections::BTreeSet;
use std::io::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::mcp::tool_call;
use crate::app::{DOCUMENT, TestApp, list};
use crate::cup::{Attempt, Cup, server};

/// The log of all tests of this process, since the first of these began.
static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

fn log() -> MutexGuard<'static, Vec<u8>> {
    LOG.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Logged;

impl Write for Logged {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        log().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn listen() {
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter("swarmbench=trace")
        .with_writer(|| Logged)
        .with_ansi(false)
        .finish();
    // Another test may listen already, to the same log.
    drop(tracing::subscriber::set_global_default(subscriber));
}

/// Something that nobody is to see.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Canary {
    what: &'static str,
    text: String,
}

fn canary(what: &'static str, text: impl Into<String>) -> Canary {
    Canary { what, text: text.into() }
}

/// A score, as an answer would have it; of no game it may be shown that it is 0.
fn score(score: &Value) -> Option<Canary> {
    (score.as_f64() != Some(0.0)).then(|| canary("score", format!("\"score\":{score}")))
}

/// All that is sealed of a competition, from what an organizer reads.
async fn canaries(app: &TestApp, cup: &Cup) -> BTreeSet<Canary> {
    let path = format!("/api/v1/exports/competitions/{}", cup.id);
    let export = app.get(&path).token(&app.organizer).send().await.text();
    let lines = export.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let records: Vec<Value> = lines.map(|line| line["record"].clone()).collect();
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    let mut found = BTreeSet::new();
    found.insert(canary("salt", text(&records[0]["salt"])));
    for seed in list(&records[0]["seeds"]) {
        found.insert(canary("sealed seed", text(&seed)));
    }
    for record in &records {
        match record["kind"].as_str() {
            Some("opening") => {
                found.insert(canary("seed", record["config"]["seed"].to_string()));
                found.insert(canary("layout", text(&record["digest"])));
                found.insert(canary("salt of an episode", text(&record["salt"])));
            }
            Some("round") => {
                found.insert(canary("state", text(&record["digest"])));
                found.extend(score(&record["score"]));
            }
            _ => {}
        }
    }
    let all = app.get("/api/v1/episodes?limit=1000").token(&app.organizer).ok().await;
    for episode in list(&all["items"]) {
        found.extend(score(&episode["score"]));
        let path = format!("/api/v1/episodes/{}/metrics", text(&episode["id"]));
        let metrics = app.get(&path).token(&app.organizer).ok().await;
        for metric in ["path_length", "crowding"] {
            let value = &metrics["values"][metric];
            let is_rare = value["value"].as_f64().is_some_and(|value| value.fract() != 0.0);
            found.extend(is_rare.then(|| canary("metric", format!("\"{metric}\":{value}"))));
        }
        let path = format!("/api/v1/episodes/{}/replay", text(&episode["id"]));
        for state in list(&app.get(&path).token(&app.organizer).ok().await["states"]) {
            found.insert(canary("positions", format!("\"at\":{}", state["at"])));
        }
        for round in ["", "?round=0"] {
            let path = format!("/api/v1/episodes/{}/state{round}", text(&episode["id"]));
            let state = app.get(&path).token(&app.organizer).ok().await;
            let rows = list(&state["grid"]);
            found.insert(canary("grid", serde_json::to_string(&rows).expect("JSON")));
            // A row with several things in it is in no other answer.
            let is_rare = |row: &str| row.chars().collect::<BTreeSet<_>>().len() >= 3;
            for row in rows.iter().map(text).filter(|row| is_rare(row)) {
                found.insert(canary("row", serde_json::to_string(&row).expect("JSON")));
            }
        }
    }
    found
}

/// An answer, and to whom it was given.
struct Said {
    who: String,
    call: String,
    text: String,
    /// An observation of the caller's own seats, which has their score.
    is_own_look: bool,
}

/// Asks every route that the document has, for all that there is.
async fn ask_all(app: &TestApp, who: &str, token: Option<&str>, ids: &[String]) -> Vec<Said> {
    let mut said = Vec::new();
    for (path, item) in DOCUMENT["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations") {
            let id = operation["operationId"].as_str().expect("an id");
            // These would never end, take the token away that is to be tried next, or have ids in too many places.
            let skipped = [
                "stream_run_events",
                "replace_run_token",
                "start_attempt",
                "start_practice",
                "erase_entrant",
                "remove_member",
            ];
            if skipped.contains(&id) {
                continue;
            }
            let path = path.replace("{round}", "0").replace("{agent}", "Agent_0");
            let files = ["episodes.jsonl", "acts.jsonl", "rounds.jsonl", "views.jsonl"];
            let mut paths = match id {
                "download_export" => BTreeSet::from(files.map(|file| path.replace("{file}", file))),
                _ => BTreeSet::from([path]),
            };
            while let Some(open) = paths.iter().find(|path| path.contains('{')).cloned() {
                paths.remove(&open);
                let (before, rest) = open.split_once('{').expect("one");
                let (_, after) = rest.split_once('}').expect("its end");
                paths.extend(ids.iter().map(|id| format!("{before}{id}{after}")));
            }
            for path in paths {
                let queries: &[&str] = match (method.as_str(), id) {
                    ("get", "get_swarm_obs") => &["?prompt=true&limit=1024", "?after=x"],
                    ("get", "show_board") => &["", "?format=csv", "?part=final"],
                    ("get", "show_state") => &["", "?round=0", "?round=1"],
                    ("get", "show_replay") => &["", "?from=1", "?ground=false"],
                    ("get", "download_export") => &["", "?status=running", "?status=finished"],
                    ("get", "list_episodes") => &[
                        "?limit=1000",
                        "?limit=x",
                        "?sort=seed&limit=1000",
                        "?people=true&curves=true",
                    ],
                    ("get", "list_runs") => &["?limit=1000", "?limit=x"],
                    _ => &[""],
                };
                for query in queries {
                    let method: Method = method.to_uppercase().parse().expect("a method");
                    let body = match id {
                        "fork_episode" => json!({ "round": 1 }),
                        _ => json!({ "reason": "x", "labels": ["x"], "seed": 1 }),
                    };
                    let mut call = app.call(method.clone(), &format!("{path}{query}"));
                    if method != Method::GET && method != Method::DELETE {
                        call = call.json(&body);
                    }
                    if let Some(token) = token {
                        call = call.token(token);
                    }
                    let answer = call.send().await;
                    said.push(Said {
                        who: who.to_owned(),
                        call: format!("{method} {path}{query} {}", answer.status),
                        text: answer.text(),
                        is_own_look: id == "get_swarm_obs" && answer.status == 200,
                    });
                }
            }
        }
    }
    for (tool, arguments) in
        [("look", json!({})), ("act", json!({ "round": 0, "action": "STAY", "wait_s": 0 }))]
    {
        let call = app.mcp(&tool_call(tool, &arguments));
        let call = if let Some(token) = token { call.token(token) } else { call };
        let text = call.send().await.text();
        let call = format!("the tool {tool}");
        said.push(Said { who: who.to_owned(), call, text, is_own_look: false });
    }
    said
}

fn search(said: &[Said], canaries: &BTreeSet<Canary>) {
    for Said { who, call, text, is_own_look } in said {
        for canary in canaries {
            let is_own = *is_own_look && canary.what == "score";
            assert!(
                is_own || !text.contains(&canary.text),
                "{who}: {call} tells {canary:?}: {text}"
            );
        }
    }
}

#[tokio::test]
async fn nothing_of_a_sealed_game_reaches_anybody_but_organizers() {
    listen();
    let app = server().await;
    let suite = json!({
        "tasks": ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"], "seeds": 2,
        "settings": { "num_agents": 5, "max_round": 3 },
    });
    let cup = Cup::open(&app, json!({ "suite": suite, "parallel": 10, "attempts": 1 })).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let (played, running) = (cup.start(&app, &blue).await, cup.start(&app, &red).await);
    played.play(&app, 2).await;
    running.act(&app, 2).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let canaries = canaries(&app, &cup).await;
    let kinds: BTreeSet<&str> = canaries.iter().map(|canary| canary.what).collect();
    let expected = [
        "grid",
        "layout",
        "metric",
        "positions",
        "row",
        "salt",
        "salt of an episode",
        "score",
        "sealed seed",
        "seed",
        "state",
    ];
    assert_eq!(kinds, BTreeSet::from(expected), "there is something of each kind to be found");

    let mut ids = vec![cup.id.clone(), blue.id.clone(), played.run.clone(), running.run.clone()];
    let episode = |attempt: &Attempt, all: &[Value]| {
        let own = all.iter().find(|episode| {
            episode["status"] == if attempt.run == played.run { "finished" } else { "running" }
        });
        own.expect("one of them")["id"].as_str().expect("an id").to_owned()
    };
    let all =
        list(&app.get("/api/v1/episodes?limit=1000").token(&app.organizer).ok().await["items"]);
    ids.extend([episode(&played, &all), episode(&running, &all)]);

    // Where something is to be found, it is found.
    let said = ask_all(&app, "an organizer", Some(&app.organizer), &ids[4..]).await;
    for what in ["seed", "score", "layout", "positions", "row", "salt of an episode"] {
        let found = canaries.iter().filter(|canary| canary.what == what);
        let mut found =
            found.filter(|canary| said.iter().any(|said| said.text.contains(&canary.text)));
        assert!(found.next().is_some(), "an organizer sees no {what}");
    }

    let tokens = [
        ("nobody", None),
        ("an entrant", Some(blue.key.as_str())),
        ("another entrant", Some(red.key.as_str())),
        ("a member", Some(member.as_str())),
        ("the swarm that has played", Some(played.swarm.as_str())),
        ("the swarm that plays", Some(running.swarm.as_str())),
        ("a stranger", Some("swarm_nonsense")),
    ];
    let mut asked = 0;
    for (who, token) in tokens {
        let said = ask_all(&app, who, token, &ids).await;
        search(&said, &canaries);
        asked += said.len();
    }
    assert!(asked > 500, "{asked} answers");
    // Nobody has ended or changed anything by that.
    let rows = cup.rows(&app, Some(&app.organizer)).await;
    assert_eq!(rows[0]["run_status"], "finished", "{rows:?}");

    let logged = String::from_utf8(log().clone()).expect("text");
    assert!(logged.contains(&played.run) && logged.contains(&cup.id), "the log says too little");
    let lines = logged.lines().filter(|line| line.contains("ended") || line.contains("created"));
    assert!(lines.count() > 20, "{} bytes were logged", logged.len());
    for canary in &canaries {
        // A short number may be a part of something else.
        let is_long = canary.text.len() >= 12;
        assert!(!is_long || !logged.contains(&canary.text), "the log tells {canary:?}");
    }

    // Afterwards everything is open to all.
    crate::cup::pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let shown = cup.show(&app).await.to_string() + &cup.export(&app).await;
    for what in ["sealed seed", "seed", "salt", "layout", "state", "salt of an episode"] {
        let all: Vec<_> = canaries.iter().filter(|canary| canary.what == what).collect();
        let found = all.iter().filter(|canary| shown.contains(&canary.text)).count();
        assert_eq!(found, all.len(), "{what}");
    }
    let path = format!("/api/v1/episodes/{}/state?round=0", ids[4]);
    assert!(app.get(&path).ok().await["grid"].is_array());
}

/// Work in tasks of its own, which no hang-up breaks off, belongs to its request all the same.
#[tokio::test]
async fn log_lines_of_spawned_tasks_have_the_id_of_their_request() {
    listen();
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let run = json!({ "suite": "quick", "model": "m" });
    for (path, token, body, target) in [
        (
            "/api/v1/episodes".to_owned(),
            &app.organizer,
            json!({ "task": "Pursuit" }),
            "episode::registry",
        ),
        ("/api/v1/runs".to_owned(), &app.organizer, run, "run::manager"),
        (cup.path("/attempts"), &blue.key, json!({}), "run::manager"),
    ] {
        let answer = app.post(&path).token(token).json(&body).send().await;
        assert_eq!(answer.status, 201, "{path}: {}", answer.text());
        let id = format!("id=\"{}\"", answer.header("x-request-id"));
        let logged = String::from_utf8(log().clone()).expect("text");
        let mut created =
            logged.lines().filter(|line| line.contains("created") && line.contains(target));
        assert!(created.any(|line| line.contains(&id)), "{path} {id}");
    }
}

/// Log lines about long requests are short, so that a sender of such requests fills no disk.
#[tokio::test]
async fn log_lines_name_the_beginning_of_a_request() {
    listen();
    let app = server().await;
    let long = "Z".repeat(3000);
    let method = long.parse::<Method>().expect("a method");
    let answer = app.call(method, &format!("/{long}")).send().await;
    assert!((400..500).contains(&answer.status), "{}", answer.text());
    let id = format!("id=\"{}\"", answer.header("x-request-id"));
    let logged = String::from_utf8(log().clone()).expect("text");
    let lines: Vec<_> = logged.lines().filter(|line| line.contains(&id)).collect();
    assert!(!lines.is_empty() && lines.iter().all(|line| line.len() < 1000), "{lines:?}");
}
