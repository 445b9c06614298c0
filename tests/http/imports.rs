//! `/api/v1/imports`: games from files, and who may read them.

use std::io::{Read as _, Write as _};

use serde_json::{Value, json};
use swarmbench::store::Store;
use swarmbench::store::entries::{Entry, ImportRow, ImportedRound};

use crate::app::program::{swarmbench, text};
use crate::app::{Episode, TestApp, list};
use crate::exports::{TASKS, dataset, open, play, request, unpack};

/// Plays, exports, imports into a fresh database: the same scores, and the same grids in every round.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn exported_games_are_imported_with_the_same_scores_and_grids() {
    let app = TestApp::start().await;
    let mut all = Vec::new();
    for task in TASKS {
        all.push(play(&app, request(task)).await);
    }
    let place = tempfile::tempdir().expect("a folder");
    let path = |name: &str| place.path().join(name).display().to_string();
    let db = app.db();

    // Beside the running server: a folder, an archive, and the server's own archive.
    let folder = swarmbench(&["export", &path("games"), "--db", &db]).await;
    assert!(folder.status.success(), "{}", text(&folder.stderr));
    assert!(
        text(&folder.stdout).contains("5 games, 30 rounds, 180 acts"),
        "{}",
        text(&folder.stdout)
    );
    let files = open(&place.path().join("games"));
    assert_eq!(files, dataset(&app, "").await);
    for args in [
        ["export", &path("games.zip"), "--db", &db],
        ["export", &path("sent.zip"), "--server", app.base()],
    ] {
        let output = swarmbench(&args).await;
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    for name in ["games.zip", "sent.zip"] {
        assert_eq!(unpack(&std::fs::read(path(name)).expect("an archive")), files);
    }
    // Nothing is overwritten.
    for name in ["games", "games.zip"] {
        let output = swarmbench(&["export", &path(name), "--db", &db]).await;
        assert!(!output.status.success() && text(&output.stderr).contains("not overwritten"));
    }
    same_tables(&app).await;

    // A server on the database of another organizer.
    let mut there = TestApp::start().await;
    let other = there.db();
    let archive = path("games.zip");
    let import = ["import", &archive, "--db", &other];
    let refused = swarmbench(&import).await;
    assert!(!refused.status.success() && text(&refused.stderr).contains("stop it"));
    there.stop().await;
    let output = swarmbench(&import).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(
        text(&output.stdout).contains("5 games imported with 180 acts"),
        "{}",
        text(&output.stdout)
    );
    let output = swarmbench(&["import", &path("games"), "--db", &other]).await;
    assert!(text(&output.stdout).contains("5 were there already"), "{}", text(&output.stdout));
    there.start_again().await;

    let imports = list(&there.get("/api/v1/imports").ok().await["items"]);
    assert_eq!(imports.len(), 5);
    for played in &all {
        let found = imports.iter().find(|import| import["run_id"] == played.episode.id.as_str());
        let found = found.expect("the game");
        assert_eq!((&found["score"], &found["verified"]), (&played.score, &json!(false)));
        assert_eq!((&found["rounds"], &found["seed"]), (&json!(6), &json!(27)));
        assert_eq!(
            (&found["settings"]["rules"], &found["settings"]["memory"]),
            (&json!("paper"), &json!(5))
        );
        let id = found["id"].as_str().expect("an id");
        assert_eq!(&there.get(&format!("/api/v1/imports/{id}")).ok().await, found);
        for round in 0..=6 {
            let mut here =
                app.get(&played.episode.path(&format!("/state?round={round}"))).ok().await;
            let there = there.get(&format!("/api/v1/imports/{id}/state?round={round}")).ok().await;
            for name in ["block", "distance"] {
                // The format does not tell them.
                here.as_object_mut().expect("an object").remove(name);
            }
            assert_eq!(there, here);
        }
        same_metrics((&app, &played.episode), (&there, id)).await;
        same_replay((&app, &played.episode), (&there, id)).await;
        same_acts((&app, &played.episode), (&there, id)).await;
        there.get(&format!("/api/v1/imports/{id}/state?round=7")).problem(404, "not_found").await;
        let last = there.get(&format!("/api/v1/imports/{id}/state")).ok().await;
        assert_eq!(last["round"], 6);
    }
    // All that the format tells comes out again.
    let output = swarmbench(&["export", &path("again"), "--db", &other, "--imported"]).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(open(&place.path().join("again")), files);
}

/// The replay of a game and of its import are the same, as far as files tell what it needs.
async fn same_replay((app, episode): (&TestApp, &Episode), (there, id): (&TestApp, &str)) {
    for query in ["", "?from=2&rounds=3"] {
        let mut here = app.get(&episode.path(&format!("/replay{query}"))).ok().await;
        let mut imported = there.get(&format!("/api/v1/imports/{id}/replay{query}")).ok().await;
        assert_eq!((&imported["status"], &imported["episode"]), (&json!("imported"), &json!(id)));
        for all in [&mut here, &mut imported] {
            let all = all.as_object_mut().expect("an object");
            assert!(all.remove("status").is_some() && all.remove("episode").is_some());
        }
        for state in imported["states"].as_array_mut().expect("states") {
            // One that escaped has no row.
            if let Some(actions) = state["actions"].as_str() {
                state["actions"] = json!(actions.replace('-', "S"));
            }
        }
        for state in here["states"].as_array_mut().expect("states") {
            let untold = state.as_object_mut().expect("a state");
            for name in ["heard", "invalid", "timeouts", "distance"] {
                untold.remove(name);
            }
            // An agent without an action is written as one that stays.
            if let Some(actions) = untold.get_mut("actions") {
                *actions = json!(actions.as_str().expect("a text").replace('-', "S"));
            }
            if let Some(marks) = untold.get_mut("marks").and_then(Value::as_array_mut) {
                marks.retain(|mark| mark != "invalid");
            }
            untold.retain(|name, value| name != "marks" || *value != json!([]));
        }
        assert_eq!(imported, here);
    }
    let path = format!("/api/v1/imports/{id}/replay?from=7");
    assert_eq!(there.get(&path).problem(404, "not_found").await["round"], 6);
    let scores = app.get(&episode.path("/scores?points=3")).ok().await;
    let imported = there.get(&format!("/api/v1/imports/{id}/scores?points=3")).ok().await;
    assert_eq!((&imported["scores"], &imported["every"]), (&scores["scores"], &scores["every"]));
}

/// Imports have what agents did, too.
async fn same_acts((app, episode): (&TestApp, &Episode), (there, id): (&TestApp, &str)) {
    for agent in 0..6 {
        let place = format!("/rounds/3/agents/Agent_{agent}");
        let here = app.get(&episode.path(&place)).ok().await;
        let imported = there.get(&format!("/api/v1/imports/{id}{place}")).ok().await;
        for field in ["round", "agent", "prompt"] {
            assert_eq!(imported[field], here[field], "{field}");
        }
        // An agent that escaped has neither.
        for field in ["message", "response"] {
            assert_eq!(imported["act"][field], here["act"][field], "{field}");
        }
    }
    for place in ["7/agents/Agent_0", "0/agents/Agent_6", "x/agents/Agent_0"] {
        let path = format!("/api/v1/imports/{id}/rounds/{place}");
        there.get(&path).problem(404, "not_found").await;
    }
}

/// The metrics of a game and of its import are the same, as far as files tell what they need.
async fn same_metrics((app, episode): (&TestApp, &Episode), (there, id): (&TestApp, &str)) {
    // What files do not tell has no value: who heard whom, and tokens.
    let untold = ["delivered", "unheard_share", "echo", "tokens_per_point", "no_action_share"];
    for query in ["?series=true", "?definition=toolkit"] {
        let mut here = app.get(&episode.path(&format!("/metrics{query}"))).ok().await;
        let path = format!("/api/v1/imports/{id}/metrics{query}");
        let mut imported = there.get(&path).ok().await;
        for metric in untold {
            assert_eq!(imported["values"][metric]["value"], json!(null), "{metric}");
            for values in [&mut here["values"], &mut imported["values"]] {
                values.as_object_mut().expect("values").remove(metric);
            }
        }
        // An agent without an action is written as one that stays, and an invalid answer as any other.
        for list in ["no_actions", "stays", "invalid", "timeouts"] {
            for series in [&mut here["series"]["counts"], &mut imported["series"]["counts"]] {
                series.as_object_mut().map(|counts| counts.remove(list));
            }
        }
        for name in ["echo", "no_action_share"] {
            for all in [&mut here, &mut imported] {
                all["values"].as_object_mut().map(|values| values.remove(name));
                all["series"]["values"].as_object_mut().map(|values| values.remove(name));
            }
        }
        assert_eq!((&here["values"], &here["series"]), (&imported["values"], &imported["series"]));
    }
}

/// The tables that are written from the database are those that the server sends.
async fn same_tables(app: &TestApp) {
    let place = tempfile::tempdir().expect("a folder");
    let path = |name: &str| place.path().join(name).display().to_string();
    let db = app.db();
    let tables = swarmbench(&["export", &path("tables"), "--db", &db, "--format", "jsonl"]).await;
    assert!(tables.status.success(), "{}", text(&tables.stderr));
    let tables = place.path().join("tables");
    let read = |name: &str| std::fs::read_to_string(tables.join(name)).expect("a table");
    assert_eq!(read("acts.jsonl"), app.get("/api/v1/exports/acts.jsonl").send().await.text());
    assert!(!tables.join("heard.jsonl").exists() && !tables.join("views.jsonl").exists());
    // The server sends the same tables, and more where they are named.
    let sent = place.path().join("sent");
    let args = [
        "export",
        &path("sent"),
        "--server",
        app.base(),
        "--format",
        "jsonl",
        "--with",
        "heard,views",
    ];
    let output = swarmbench(&args).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    for name in ["episodes.jsonl", "acts.jsonl", "rounds.jsonl"] {
        assert_eq!(std::fs::read_to_string(sent.join(name)).expect("a table"), read(name));
    }
    for name in ["heard", "views"] {
        let here = std::fs::read_to_string(sent.join(format!("{name}.jsonl"))).expect("a table");
        let there = app.get(&format!("/api/v1/exports/{name}.jsonl")).send().await.text();
        assert_eq!(here, there);
        assert!(here.lines().count() > 100, "{name}: {}", here.lines().count());
    }
}

/// A database with one imported game, under a server that is started so.
async fn with_an_import(private: bool) -> (TestApp, String) {
    let app = TestApp::start().await;
    let request = json!({ "task": "Pursuit", "num_agents": 2, "max_round": 1 });
    app.all_act(&app.create(request).await, "STAY").await;
    let place = tempfile::tempdir().expect("a folder");
    let archive = place.path().join("games.zip");
    std::fs::write(&archive, app.get("/api/v1/exports/dataset.zip").send().await.body)
        .expect("written");
    let builder = TestApp::builder().keys();
    let mut there = builder.access(|access| access.private = private).start().await;
    there.stop().await;
    let db = there.db();
    let output = swarmbench(&["import", &archive.display().to_string(), "--db", &db]).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    there.start_again().await;
    let organizer = there.organizer.clone();
    let listed = there.get("/api/v1/imports").token(&organizer).ok().await;
    let id = listed["items"][0]["id"].as_str().expect("an id").to_owned();
    (there, id)
}

#[tokio::test]
async fn imported_games_are_as_public_as_games_that_have_ended() {
    for private in [false, true] {
        let (app, id) = with_an_import(private).await;
        let (member, _) = app.key(json!({ "name": "member" })).await;
        let episode = app.create_with(&member, request("Pursuit")).await;
        for (token, knows) in [
            (None, !private),
            (Some(episode.seat(0)), !private),
            (Some(episode.swarm.as_str()), !private),
            (Some(&member), true),
        ] {
            let ask = |path: String| {
                let call = app.get(&path);
                match token {
                    Some(token) => call.token(token),
                    None => call,
                }
            };
            let listed = ask("/api/v1/imports".to_owned()).ok().await;
            assert_eq!(list(&listed["items"]).len(), usize::from(knows), "{private} {token:?}");
            for rest in ["", "/state?round=1"] {
                let answer = ask(format!("/api/v1/imports/{id}{rest}")).send().await;
                assert_eq!(answer.status, if knows { 200 } else { 404 }, "{private} {token:?}");
            }
        }
    }
}

#[tokio::test]
async fn imported_games_are_listed_page_by_page() {
    let app = TestApp::start().await;
    for task in ["Pursuit", "Foraging", "Pursuit"] {
        let request = json!({ "task": task, "model": task, "num_agents": 2, "max_round": 1 });
        let episode = app.create(request).await;
        app.all_act(&episode, "STAY").await;
    }
    let place = tempfile::tempdir().expect("a folder");
    let archive = place.path().join("games.zip");
    std::fs::write(&archive, app.get("/api/v1/exports/dataset.zip").send().await.body)
        .expect("written");
    let mut there = TestApp::start().await;
    there.stop().await;
    let db = there.db();
    let output = swarmbench(&["import", &archive.display().to_string(), "--db", &db]).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    there.start_again().await;
    let count = async |query: &str| {
        list(&there.get(&format!("/api/v1/imports?{query}")).ok().await["items"]).len()
    };
    assert_eq!(
        (count("").await, count("task=Pursuit").await, count("model=Foraging").await),
        (3, 2, 1)
    );
    let (mut seen, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = there.get(&format!("/api/v1/imports?limit=1{cursor}")).ok().await;
        seen.extend(list(&page["items"]).iter().map(|item| item["id"].clone()));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    let all = list(&there.get("/api/v1/imports").ok().await["items"]);
    assert_eq!(seen, all.iter().map(|item| item["id"].clone()).collect::<Vec<_>>());
    for (query, code) in
        [("limit=0", 400), ("task=Chess", 400), ("cursor=x", 400), ("colour=red", 400)]
    {
        there.get(&format!("/api/v1/imports?{query}")).problem(code, "malformed").await;
    }
    for path in ["imp_0", "imp_0/state"] {
        there.get(&format!("/api/v1/imports/{path}")).problem(404, "not_found").await;
    }
    // They are no episodes.
    assert!(list(&there.get("/api/v1/episodes").ok().await["items"]).is_empty());
}

/// A game as earlier versions imported it: with any number of acts, of any size.
fn stored(number: u8, state_bytes: usize, acts: &[&str], blank_bytes: usize) -> ImportRow {
    let agents: Vec<Value> =
        (0..2).map(|agent| json!({ "id": format!("Agent_{agent}"), "x": agent, "y": 0 })).collect();
    let state = json!({ "timestamp": null, "grid": ["A."], "agents": agents, "messages": [] });
    let level = flate2::Compression::fast();
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), level);
    for act in acts {
        packed.write_all(act.as_bytes()).expect("memory");
    }
    std::io::copy(&mut std::io::repeat(b' ').take(blank_bytes as u64), &mut packed)
        .expect("memory");
    let settings = json!({
        "num_agents": 2, "max_round": 9, "width": 2, "height": 1, "view_size": 3, "rules": null, "control": null,
        "memory": null, "noise": null, "max_delay": null,
    });
    ImportRow {
        id: format!("imp_{number}"),
        digest: [number; 32],
        run_id: format!("run-{number}"),
        meta: "{}".to_owned(),
        model: "m".to_owned(),
        task: "Pursuit".to_owned(),
        seed: 1,
        settings: serde_json::from_value(settings).expect("settings"),
        score: 0.0,
        resolved: 0,
        acts: acts.len() as u64,
        rounds: vec![ImportedRound {
            round: 0,
            score: 0.0,
            state: state.to_string() + &" ".repeat(state_bytes),
            acts: Some(packed.finish().expect("memory")),
        }],
    }
}

#[tokio::test]
async fn what_earlier_versions_imported_is_read_within_bounds() {
    const MIB: usize = 1024 * 1024;
    let act = "{\"agent_id\": \"Agent_1\", \"action\": \"UP\", \"message\": \"up\"}\n";
    let mut app = TestApp::start().await;
    app.stop().await;
    let store = Store::open(app.location()).await.expect("it opens");
    let games = [
        stored(0, 0, &[act; 2], 0),
        stored(1, 0, &[act; 1000], 0),
        stored(2, 0, &[act], 129 * MIB),
        stored(3, 33 * MIB, &[act], 0),
    ];
    for game in games {
        let entry = Entry::Import { game: Box::new(game), at: jiff::Timestamp::UNIX_EPOCH };
        store.keep(vec![entry]).await.expect("stored");
    }
    store.close().await;
    app.start_again().await;
    let looks = ["replay", "metrics", "rounds/0/agents/Agent_1"];
    for look in looks.into_iter().chain(["state"]) {
        app.get(&format!("/api/v1/imports/imp_0/{look}")).ok().await;
        let path = format!("/api/v1/imports/imp_3/{look}");
        let problem = app.get(&path).problem(422, "invalid").await;
        assert_eq!(problem["limit"]["name"], "import_state_bytes_max", "{problem}");
    }
    for (game, said) in [("imp_1", "more acts than its 2 agents"), ("imp_2", "134217728 bytes")] {
        for look in looks {
            let path = format!("/api/v1/imports/{game}/{look}");
            let problem = app.get(&path).problem(422, "invalid").await;
            assert_eq!(problem["limit"]["name"], "import_state_bytes_max", "{problem}");
            assert!(
                problem["detail"].as_str().is_some_and(|detail| detail.contains(said)),
                "{problem}"
            );
        }
    }
}
