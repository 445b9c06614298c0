//! An inert setting on its way through everything that has settings.

use std::process::Command;

use serde_json::json;
use swarmbench::eval::plan::Plan;
use swarmbench::journal::replay::verify;
use swarmbench::run::suite::{Suite, SuiteSettings};
use swarmbench_engine::physics::Solver;

use crate::app::{TestApp, fields, list};
use crate::cup::{Cup, server};

#[tokio::test]
async fn it_is_asked_for_checked_shown_recorded_and_played() {
    let app = TestApp::start().await;
    for (fog, is_written) in [(3, true), (0, false)] {
        let request = json!({
            "task": "Synchronization", "num_agents": 2, "max_round": 2, "seed": 1, "fog": fog,
        });
        let episode = app.create(request).await;
        assert_eq!(episode.config.get("fog").is_some(), is_written);
        app.all_act(&episode, "STAY").await;
        app.all_act(&episode, "STAY").await;
        let journal = app.journal(&episode).await;
        assert_eq!(journal.contains(r#""max_delay":0,"fog":3,"round_deadline_ms""#), is_written);
        assert_eq!(journal.contains("fog"), is_written);
        let report = verify(journal.as_bytes(), None, Solver::Flow, |_, _| ()).expect("sound");
        assert_eq!(report.opening.config.fog, fog);
    }
    for fog in [-1, 11] {
        let request = json!({ "task": "Synchronization", "fog": fog });
        let refused = app.post("/api/v1/episodes").json(&request).problem(422, "invalid").await;
        assert_eq!(fields(&refused), ["fog"]);
        assert!(refused.to_string().contains(&format!("must be from 0 to 10, is {fog}")));
    }
}

#[tokio::test]
async fn runs_and_competitions_have_it() {
    let app = TestApp::start().await;
    let run = |fog: i64| {
        let suite = json!({
            "name": "foggy", "tasks": ["Foraging"], "seeds": [1],
            "settings": { "num_agents": 2, "max_round": 2, "fog": fog },
        });
        app.post("/api/v1/runs").json(&json!({ "suite": suite, "model": "m" }))
    };
    let created = run(2).ok().await;
    assert_eq!(created["suite"]["settings"]["fog"], 2);
    let episodes = app.get("/api/v1/episodes").ok().await;
    assert_eq!(list(&episodes["items"])[0]["config"]["fog"], 2);
    let refused = run(11).problem(422, "invalid").await;
    assert_eq!(fields(&refused), ["suite.settings.fog"]);

    let app = server().await;
    let suite = json!({
        "tasks": ["Synchronization", "Pursuit"], "seeds": 2,
        "settings": { "num_agents": 3, "max_round": 3, "fog": 4 },
    });
    let cup = Cup::open(&app, json!({ "suite": suite })).await;
    assert_eq!(cup.created["suite"]["settings"]["fog"], 4);
    let entrant = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &entrant).await;
    let run = app.get(&format!("/api/v1/runs/{}", attempt.run)).token(&attempt.swarm).ok().await;
    assert_eq!(run["suite"]["settings"]["fog"], 4);
}

#[test]
fn suites_without_it_have_the_bytes_that_they_had() {
    let usual = Suite::built_in("standard", "paper").expect("built in");
    let json = serde_json::to_string(&usual).expect("JSON");
    assert!(!json.contains("fog"), "{json}");
    assert_eq!(serde_json::from_str::<Suite>(&json).expect("a suite"), usual);
    let settings = SuiteSettings { fog: 1, ..usual.settings.clone() };
    assert_ne!(Suite { settings, ..usual.clone() }.digest(), usual.digest());
}

#[test]
fn experiments_and_their_options_vary_it() {
    let text = "players = 'random'\n[settings]\nfog = [0, 3]";
    let plan = Plan::of(&toml::from_str(text).expect("an experiment"), None).expect("a plan");
    assert_eq!(plan.varied, ["fog"]);
    assert_eq!(plan.runs[1].setting("fog").as_deref(), Some("3"));
    assert!(plan.runs[1].suite.name.ends_with("fog 3"), "{}", plan.runs[1].suite.name);
    let eval = |fog| {
        let args = ["eval", "--player", "random", "--dry-run", "--fog", fog];
        let done = Command::new(env!("CARGO_BIN_EXE_swarmbench")).args(args).output();
        let done = done.expect("it runs");
        [done.stdout, done.stderr].map(|text| String::from_utf8(text).expect("UTF-8")).concat()
    };
    assert!(eval("0,3").contains("2 runs"), "{}", eval("0,3"));
    assert!(eval("11").contains("fog must be from 0 to 10, is 11"), "{}", eval("11"));
}
