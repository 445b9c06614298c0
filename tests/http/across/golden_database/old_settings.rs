//! Games, runs and competitions with settings that no new ones may have are played to their end.

use std::fs;
use swarmbench_testkit::needs;

use serde_json::{Value, json};
use swarmbench::episode::spec::Visibility;
use swarmbench::ids::{RunKey, Token, TokenKind};
use swarmbench::run::definition::Definition;
use swarmbench::store::Store;
use swarmbench::store::entries::{Entry, RunRow};
use swarmbench_boards::competition::verify::verify as verify_competition;
use swarmbench_protocol::suite::{Suite, SuiteSettings};
use swarmbench_testkit::host::SeededEntropy;

use super::*;
use crate::app::{fields, number};
use crate::cup;

/// The database of which a running game and an announced competition are too large for new ones.
const LARGE: &str = "0005";

/// Refusal of windows with too many cells.
const TOO_MANY: &str = "num_agents × cells of a window must be at most 1048576, is 1116300";

/// Has every creation with these settings refused, by the limit that they exceed.
async fn nobody_creates(app: &TestApp, settings: &Value, problem: &str) {
    let mut episode = settings.clone();
    episode["task"] = json!("Synchronization");
    let suite = json!({ "name": "large", "tasks": ["Synchronization"], "seeds": [1], "settings": settings });
    let mut competition = cup::request();
    competition["suite"] =
        json!({ "tasks": ["Synchronization"], "seeds": 2, "settings": settings });
    competition["opens_at"] = json!(at(app, 10));
    competition["closes_at"] = json!(at(app, 60));
    for (path, body, field) in [
        ("episodes", episode, "num_agents"),
        ("runs", json!({ "suite": suite, "model": "m" }), "suite.settings.num_agents"),
        ("competitions", competition, "suite.settings.num_agents"),
    ] {
        let call = post(app, &format!("/api/v1/{path}"), &app.organizer, &body);
        let refused = call.problem(422, "invalid").await;
        assert_eq!(fields(&refused)[0], field, "{refused}");
        let detail = text(&refused["detail"]);
        assert!(detail.contains(problem), "{detail}");
    }
}

/// Proves a game as anybody can who reads its journal, and its states.
async fn prove(app: &TestApp, episode: &str) {
    let path = format!("/api/v1/episodes/{episode}");
    let shown = app.get(&path).token(&app.organizer).ok().await;
    assert_eq!(shown["status"], "finished", "{shown}");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("game.jsonl");
    let journal = app.get(&format!("{path}/journal")).token(&app.organizer).send().await;
    fs::write(&file, &journal.body).expect("written");
    let head = text(&shown["result"]["journal_head"]);
    let output = swarmbench(&["verify", &file.display().to_string(), "--head", &head]).await;
    assert!(output.status.success(), "{}", printed(&output));
    for round in 0..=number(&shown["round"]) {
        let path = format!("{path}/state?round={round}");
        let state = app.get(&path).token(&app.organizer).ok().await;
        assert_eq!(state["round"], round);
        let agents = number(&shown["config"]["num_agents"]);
        assert_eq!(list(&state["agents"]).len() as u64, agents);
    }
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_old_game_and_an_old_competition_are_played_on_with_what_no_new_one_may_have() {
    let (mut app, facts) = open(LARGE).await;
    let episode = Episode::of(&facts.running[0]);
    let announced = Cup { id: facts.cups.announced.clone(), created: Value::Null };
    let settings = announced.show(&app).await["suite"]["settings"].clone();
    for field in ["num_agents", "view_size", "width", "height", "memory"] {
        assert_eq!(settings[field], episode.config[field], "{field}");
    }
    nobody_creates(&app, &settings, TOO_MANY).await;

    // Seat by seat, as its agents hold it.
    let before = app.state(&episode).await;
    for (number, token) in episode.seats().enumerate() {
        let seen = if number % 50 == 0 { app.obs(token).await } else { json!({ "round": 1 }) };
        assert_eq!(seen["round"], 1);
        if seen["acted"] != true && number != 1 {
            let act = json!({ "round": 1, "action": "SWITCH", "message": "all at once" });
            assert_eq!(app.act(token, &act).await["duplicate"], false);
        }
    }
    app.restart().await;
    prove(&app, &episode.id).await;
    let again = app.get(&episode.path("/state?round=1")).token(&episode.swarm).ok().await;
    check_same("the state that was played again", &before, &again);

    crate::cup::pass_minutes(&app, facts.cups.opens_in_minutes).await;
    let entrant = announced.enter(&app, "late").await;
    let attempt = announced.start(&app, &entrant).await;
    attempt.play(&app, 1).await;
    for played in attempt.episodes(&app).await {
        prove(&app, &text(&played["id"])).await;
    }
    crate::cup::pass_minutes(&app, 120).await;
    announced.closed(&app).await;
    let export = announced.export(&app).await;
    let none = Expected { commitment: None, head: None };
    verify_competition(export.as_bytes(), none, Solver::Flow, |_| ()).expect("a proof");
    nobody_creates(&app, &settings, TOO_MANY).await;
    sound(&app.database().display().to_string()).await;
}

/// The largest settings that there ever were, of a run: an earlier version kept it, and opened none of its games.
async fn keep_old_run(app: &TestApp) -> (String, String) {
    let settings = SuiteSettings {
        num_agents: 1024,
        width: 256,
        height: 256,
        view_size: 513,
        memory: 0,
        max_round: 2,
        ..SuiteSettings::default()
    };
    let suite = Suite {
        name: "large".to_owned(),
        tasks: vec!["Synchronization".to_owned()],
        seeds: vec![7.into()],
        seeds_by_task: false,
        rules: "paper".to_owned(),
        settings,
    };
    let definition = Definition {
        model: "an old one".to_owned(),
        temperature: None,
        top_p: None,
        meta: swarmbench_protocol::carried::Carried::default(),
        prompt_template: None,
        prompt_revision: 1,
        player: None,
        holders: Vec::new(),
        parallel: 1,
        visibility: Visibility::Public.name().to_owned(),
        idle_timeout_ms: 86_400_000,
        closes_at: None,
        own_games: false,
        suite,
    };
    let token = Token::new(TokenKind::Swarm, &SeededEntropy::new(5));
    let store = Store::open(&app.database()).await.expect("it opens");
    let row = RunRow {
        run: RunKey(store.last_run_key().await.expect("a number") + 1),
        id: "run_019ca94f30ce7c01a83ffbc190ebffff".to_owned(),
        owner: None,
        suite: definition.suite.name.clone(),
        digest: definition.suite.digest(),
        model: definition.model.clone(),
        visibility: Visibility::Public.name(),
        attempt: None,
        replays: None,
        closes_at: None,
        at: app.now(),
        idempotency: None,
        definition: serde_json::to_string(&definition).expect("string keys"),
    };
    let id = row.id.clone();
    let hash = token.hash();
    let token_of_run = Entry::ReplaceRunToken { run: row.run, holder: None, hash };
    store.keep(vec![Entry::OpenRun(Box::new(row)), token_of_run]).await.expect("it is kept");
    store.close().await;
    (id, token.reveal().to_owned())
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_old_run_is_played_with_the_largest_settings_that_there_were() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    app.stop().await;
    let (run, swarm) = keep_old_run(&app).await;
    app.start_again().await;
    let largest = json!({
        "num_agents": 1024, "width": 256, "height": 256, "view_size": 513, "memory": 0, "max_round": 2,
    });
    nobody_creates(&app, &largest, "must be at most 1048576, is 269485056").await;
    let look = || async { app.get("/swarm/obs?limit=1&wait=5").token(&swarm).ok().await };
    for round in 0..2 {
        let seen = list(&look().await["observations"])[0].clone();
        assert_eq!(seen["round"], round);
        assert_eq!(list(&seen["view"]["cells"]).len(), 513);
        assert_eq!(list(&seen["messages"]).len(), usize::from(round == 1));
        let act = |agent: u32| {
            let message = (agent == 1023).then_some("everybody hears me");
            json!({
                "episode": seen["episode"], "agent": format!("Agent_{agent}"), "round": round,
                "action": "SWITCH", "message": message,
            })
        };
        let acts: Vec<Value> = (0..1024).map(act).collect();
        let body = json!({ "acts": acts });
        let receipts =
            app.post("/swarm/act").token(&swarm).json(&body).ok().await["receipts"].clone();
        assert_eq!(list(&receipts).iter().filter(|receipt| receipt["valid"] == true).count(), 1024);
    }
    assert_eq!(look().await["finished"], true);
    let shown = app.get(&format!("/api/v1/runs/{run}")).ok().await;
    assert_eq!(shown["status"], "finished", "{shown}");
    app.restart().await;
    let games = app.get(&format!("/api/v1/episodes?run={run}")).ok().await;
    prove(&app, &text(&list(&games["items"])[0]["id"])).await;
    sound(&app.database().display().to_string()).await;
}
